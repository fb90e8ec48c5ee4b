"""A small calibrated RBF machine: trained by scikit-learn, kept as arrays, quick for one sample."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.recognition.histograms.intersection import pair_coefficients
from skinmap.recognition.prediction_sets import rejection_threshold

FOLDS = 5
PENALTY = 10.0  # C of the machine
WIDTH = 0.9  # gamma times columns: 0.03 for the thirty numbers that it was found with
# Numbers that spread by less (2 %) are as good as one: what noise adds to them would be taken for
# much. Those of simulated touches on one part spread by 10 % and more.
SAME = 0.02
ITSELF = 1e-8  # squared distance of a row that was learnt; single precision keeps 1e-12
MARGIN = 4.0  # one-against-one decisions beyond this say no more
# What a fitted machine is.
FITTED = (
    "classes", "mean", "scale", "gamma", "vectors", "offsets", "weights", "worth", "bias", "reject",
)  # fmt: skip


class RbfMachine(ClassifierMixin, BaseEstimator):
    """RBF support vector machine on logarithms of non-negative numbers, with probabilities.

    One-against-one decisions of held-out folds teach a multinomial logistic regression what they
    are worth; one final machine learns from all rows. A fitted machine is a handful of arrays.
    """

    most_rows = 6000  # some ten seconds

    def fit(self, X: ArrayLike, y: ArrayLike) -> RbfMachine:
        """Learn from rows (m, d), all non-negative, and their labels (m,)."""
        from sklearn.linear_model import LogisticRegression
        from sklearn.model_selection import StratifiedKFold
        from sklearn.utils.multiclass import check_classification_targets

        rows, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        self.classes_, number = np.unique(labels, return_inverse=True)
        if len(self.classes_) < 2:
            raise ValueError(f"one class only: {str(self.classes_[0])!r}; an RBF machine needs two")
        scaled = np.log1p(np.maximum(rows, 0.0))
        self.mean_ = scaled.mean(axis=0)
        self.scale_ = scaled.std(axis=0)
        self.scale_[self.scale_ < SAME] = 1.0
        self.gamma_ = WIDTH / rows.shape[1]
        scaled = (scaled - self.mean_) / self.scale_
        folds = min(FOLDS, int(np.bincount(number).min()))
        held_out = np.zeros((len(rows), self._pairs))
        if folds >= 2:
            split = StratifiedKFold(folds, shuffle=True, random_state=0)
            for learn, test in split.split(scaled, number):
                self._train(scaled[learn], number[learn])
                held_out[test] = self._decisions(scaled[test])
        self._train(scaled, number)
        if folds < 2:
            held_out = self._decisions(scaled)
        worth = LogisticRegression(C=1.0, max_iter=1000).fit(held_out, number)
        self.worth_, self.bias_ = worth.coef_, worth.intercept_
        sure = worth.predict_proba(held_out)
        self.reject_ = rejection_threshold(sure.max(axis=1), sure.argmax(axis=1) == number)
        if len(self.classes_) == 2:
            self.worth_ = np.concatenate([-self.worth_, self.worth_]) / 2.0
            self.bias_ = np.concatenate([-self.bias_, self.bias_]) / 2.0
        # Held-out decisions of labels that cannot be told apart lie on the wrong side as often as
        # not: a worth that turns round what the machine learnt gives way to the labels' shares.
        own = self._decisions(scaled) @ self.worth_.T + self.bias_
        count = np.bincount(number)
        right = np.bincount(number[own.argmax(axis=1) == number], minlength=len(count))
        if (right / count).mean() < 1.0 / len(count):
            self.worth_, self.bias_ = np.zeros_like(self.worth_), np.log(count / len(number))
        return self

    def predict_proba(self, X: ArrayLike) -> FloatArray:
        """(m, c) probability of each of `classes_`."""
        check_is_fitted(self)
        return self.probabilities(validate_data(self, X, dtype=np.float64, reset=False))

    def probabilities(self, rows: FloatArray, near: FloatArray | None = None) -> FloatArray:
        """As `predict_proba`, of rows (m, d) that need no check: for one touch at a time.

        `near` are their `squares`, if they are known.
        """
        decided = self._decided(self.squares(rows) if near is None else near)
        scores = decided @ self.worth_.T + self.bias_
        share = np.exp(scores - scores.max(axis=1, keepdims=True))
        return np.asarray(share / share.sum(axis=1, keepdims=True))

    def strangeness(self, rows: FloatArray, near: FloatArray | None = None) -> FloatArray:
        """(m,) distance of rows (m, d) from the nearest other vector, in deviations a column."""
        near = self.squares(rows) if near is None else near
        near = np.partition(near, 1, axis=1)[:, :2] / rows.shape[1]
        return np.asarray(np.sqrt(np.where(near[:, 0] < ITSELF, near[:, 1], near[:, 0])))

    def predict(self, X: ArrayLike) -> Any:
        """(m,) most probable labels."""
        share = self.predict_proba(X)
        return self.classes_[np.argmax(share, axis=1)]

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """All that a fitted machine is."""
        check_is_fitted(self)
        made = {name: np.asarray(getattr(self, f"{name}_")) for name in FITTED}
        return made | {"settings": np.array([PENALTY, np.nan, 0])}  # versions before want them

    def from_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take what `to_arrays` gave.

        Raises
        ------
        InvalidArrayError
            Arrays that do not fit together.
        """
        classes = np.asarray(arrays["classes"])
        if classes.ndim != 1 or len(np.unique(classes)) != len(classes) or len(classes) < 2:
            raise InvalidArrayError("an RBF machine needs two classes or more, each once")
        pairs, (vectors, columns) = len(classes) * (len(classes) - 1) // 2, arrays["vectors"].shape
        shapes: dict[str, tuple[int, ...]] = {
            "mean": (columns,), "scale": (columns,), "gamma": (), "vectors": (vectors, columns),
            "offsets": (pairs,), "weights": (pairs, vectors), "worth": (len(classes), pairs),
            "bias": (len(classes),), "reject": (),
        }  # fmt: skip
        found = {name: np.asarray(arrays[name], np.float64) for name in shapes}
        for name, shape in shapes.items():
            if found[name].shape != shape or not np.isfinite(found[name]).all():
                raise InvalidArrayError(f"an RBF machine's {name} do not fit together")
        if (found["scale"] <= 0.0).any():
            raise InvalidArrayError("an RBF machine's scale is not positive")
        self.classes_, self.n_features_in_ = classes, columns
        for name, value in found.items():
            setattr(self, f"{name}_", float(value) if value.ndim == 0 else value)
        self.squares_ = np.einsum("ij,ij->i", self.vectors_, self.vectors_)

    @property
    def _pairs(self) -> int:
        return len(self.classes_) * (len(self.classes_) - 1) // 2

    def _train(self, scaled: FloatArray, number: np.ndarray) -> None:
        from sklearn.svm import SVC

        machine = SVC(C=PENALTY, gamma=self.gamma_, decision_function_shape="ovo")
        machine.fit(scaled, number)
        self.vectors_ = machine.support_vectors_
        self.squares_ = np.einsum("ij,ij->i", self.vectors_, self.vectors_)
        self.offsets_ = np.asarray(machine.intercept_, np.float64)
        # One matrix product gives all one-against-one decisions.
        self.weights_ = pair_coefficients(machine)

    def _decisions(self, scaled: FloatArray) -> FloatArray:
        return self._decided(self._squares(scaled))

    def _decided(self, near: FloatArray) -> FloatArray:
        """(m, pairs) one-against-one decisions by squares, cut off where they say no more."""
        kernel = np.exp(-self.gamma_ * near)
        return np.clip(kernel @ self.weights_.T + self.offsets_, -MARGIN, MARGIN)

    def squares(self, rows: FloatArray) -> FloatArray:
        """(m, vectors) squared distances of rows (m, d) from the vectors, in deviations."""
        return self._squares((np.log1p(np.maximum(rows, 0.0)) - self.mean_) / self.scale_)

    def _squares(self, scaled: FloatArray) -> FloatArray:
        near = scaled @ self.vectors_.T
        near *= -2.0
        near += self.squares_
        near += np.einsum("ij,ij->i", scaled, scaled)[:, None]
        return np.maximum(near, 0.0)

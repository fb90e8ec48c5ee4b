"""Support vector machine with the histogram intersection kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.recognition.histograms.additive import AdditiveFunction, intersection_function


def intersection_kernel(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) sums of the smaller of each two bins, for histograms (n, d) and (m, d).

    Swain and Ballard, "Color Indexing", International Journal of Computer Vision 7(1), 1991.
    """
    from scipy.spatial.distance import cdist

    # min(x, y) = (x + y - |x - y|) / 2: one compiled pass without a table of all bins, exact for
    # counts, as their sums are whole numbers far below 2^53.
    sums = a.sum(axis=1)[:, None] + b.sum(axis=1)[None]
    return np.asarray(0.5 * (sums - cdist(a, b, "cityblock")))


class IntersectionSVC(ClassifierMixin, BaseEstimator):
    """SVM on histograms (n, d) of non-negative counts.

    It is trained on the Gram matrix by scikit-learn's SVC (800 MB for 10,000 histograms) and
    evaluated exactly, bin by bin (`AdditiveFunction`).

    Parameters
    ----------
    C : float
        Penalty, as in scikit-learn's SVC. The kernel is divided by its mean on the training
        histograms, so that C means the same for few and for many votes.
    """

    def __init__(self, C: float = 10.0) -> None:
        self.C = C

    def fit(self, X: ArrayLike, y: ArrayLike) -> IntersectionSVC:
        """Train on histograms (n, d) with labels (n,).

        Raises
        ------
        InvalidArrayError
            Negative counts: the kernel is indefinite there, and the SVM would not notice.
        """
        from sklearn.svm import SVC  # takes 0.2 s to import, and only training needs it

        histograms, labels = validate_data(self, X, y, dtype=np.float64)
        _refuse_negative(histograms)
        self.scale_ = float(histograms.sum(axis=1).mean()) or 1.0
        gram = intersection_kernel(histograms, histograms)
        svc = SVC(kernel="precomputed", C=self.C).fit(gram / self.scale_, labels)
        self.classes_ = svc.classes_
        self.support_histograms_ = histograms[svc.support_]
        self.coefficients_ = _pair_coefficients(svc) / self.scale_
        self.intercept_ = np.asarray(svc.intercept_)
        self.function_ = self._make_function()
        return self

    def _make_function(self) -> AdditiveFunction:
        """What the decision values are evaluated with."""
        parts = (self.support_histograms_, self.coefficients_, self.intercept_)
        return intersection_function(*parts)

    def decision_values(self, X: FloatArray) -> FloatArray:
        """(n, q) of each pair of classes; not checked."""
        return self.function_(X)

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """(n,) or (n, classes) decision values of histograms (n, d), as of scikit-learn's SVC."""
        values = self._checked(X)
        if len(self.classes_) == 2:
            return np.asarray(values[:, 0])
        return one_vs_rest(values, len(self.classes_))

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """(n,) labels of histograms (n, d)."""
        values = self._checked(X)
        if len(self.classes_) == 2:
            return np.asarray(self.classes_[(values[:, 0] > 0).astype(np.int64)])
        first, second = _pairs(len(self.classes_))
        votes = (values > 0) @ first + (values <= 0) @ second  # as libsvm counts them
        return np.asarray(self.classes_[votes.argmax(axis=1)])

    def _checked(self, X: ArrayLike) -> FloatArray:
        check_is_fitted(self)
        histograms = validate_data(self, X, dtype=np.float64, reset=False)
        _refuse_negative(histograms)
        return self.decision_values(histograms)

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be made again."""
        state = dict(super().__getstate__())
        state.pop("function_", None)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make it again."""
        super().__setstate__(state)
        if hasattr(self, "classes_"):
            self.function_ = self._make_function()

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = True
        return tags


def one_vs_rest(values: FloatArray, classes: int) -> FloatArray:
    """(n, classes) votes of the pairs (n, q), ties broken by their values: as SVC does it."""
    first, second = _pairs(classes)
    votes = (values >= 0) @ first + (values < 0) @ second
    sure = values @ (first - second)
    return np.asarray(votes + sure / (3.0 * (np.abs(sure) + 1.0)))


def _pairs(classes: int) -> tuple[FloatArray, FloatArray]:
    """(q, classes) which class is first and which second in each pair."""
    one, other = np.triu_indices(classes, 1)
    return np.eye(classes)[one], np.eye(classes)[other]


def _pair_coefficients(svc: Any) -> FloatArray:
    """(q, m) coefficient of each support vector in the decision of each pair of classes."""
    dual, count = svc.dual_coef_, svc.n_support_
    if len(svc.classes_) == 2:
        return np.asarray(dual)
    owner = np.repeat(np.arange(len(count)), count)
    one, other = np.triu_indices(len(count), 1)
    # Row j - 1 of the coefficients of class i < j is for the pair (i, j), and row i of j's.
    first = np.where(owner == one[:, None], dual[other - 1], 0.0)
    return np.asarray(first + np.where(owner == other[:, None], dual[one], 0.0))


def _refuse_negative(histograms: FloatArray) -> None:
    if histograms.size and histograms.min() < 0:
        raise InvalidArrayError(
            f"Negative values in data: histograms count votes, got {histograms.min()}"
        )

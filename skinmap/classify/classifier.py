"""Classifiers of touches: a descriptor and a scikit-learn estimator under one name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.classify.catalogue import BUILT_IN, DEFAULT, classifiers
from skinmap.classify.descriptors import Descriptor, Touch
from skinmap.classify.intersection import IntersectionSVC, one_vs_rest
from skinmap.classify.prediction_sets import (
    SetCalibration,
    calibrate_sets,
    check_coverage,
    likely_names,
)
from skinmap.classify.rejection import AGES, UNKNOWN, early_doubt
from skinmap.classify.trained_skin import SkinDifference, TrainedSkin, compare_skin, remember
from skinmap.errors import InvalidArrayError, NotFittedError
from skinmap.skin.skin import Skin
from skinmap.summary import Summary, listed
from skinmap.touch.contacts import ACTIVE
from skinmap.touch.prepared_skin import PreparedSkin

__all__ = [
    "BUILT_IN",
    "DEFAULT",
    "NO_CONTACT",
    "Classifier",
    "Prediction",
    "TouchClassifier",
    "calibrated",
    "classifiers",
]

NO_CONTACT = "no_contact"
CALIBRATION_FOLDS = 5
ROWS = 1200  # training rows at most: the cost of a Gram matrix grows with the square
YOUNG = 600  # touches at most whose beginnings are looked at
Probabilities = Callable[[FloatArray], FloatArray]
# Classifiers quick enough to train that `skinmap train` also calibrates sets of names.
WITH_SETS = (DEFAULT, "histogram", "histogram-chi2", "histogram-sqrt")


def felt_rows(touch: Touch) -> IntArray:
    """Which of a touch's samples anything is felt in."""
    return np.flatnonzero((touch.samples > ACTIVE).any(axis=1))


def learnable(touches: Sequence[Touch]) -> list[Touch]:
    """Simulated touches of the gestures that come often enough to be learnt.

    A gesture that hardly fits on a skin, such as a hand on a hand, is left out.
    """
    counts = Counter(touch.label for touch in touches)
    return [touch for touch in touches if counts[touch.label] >= CALIBRATION_FOLDS]


@dataclass(frozen=True, slots=True)
class Prediction:
    """Label of a touch, with a confidence of 0 to 1.

    `names` hold the truth as often as was asked for; None where that was not asked for.
    """

    label: str
    confidence: float
    names: tuple[str, ...] | None = None


class Classifier(Summary):
    """Names touches; `skinmap.train` makes one, `Classifier.load` reads one.

    Parameters
    ----------
    name : str
        Under which it was registered.
    descriptor : Descriptor
        Turns the samples of a touch into rows of numbers.
    estimator : scikit-learn classifier
        With `predict_proba`.

    Attributes
    ----------
    labels : tuple of str
        Names that it can give, once it is trained.
    trained_on : tuple of TrainedSkin
        Part and taxel positions (n, 3) [m] of the skins that it was trained on.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> gestures = ["poke", "full_finger"]
    >>> touches = skinmap.simulate(robot.skin("torso"), gestures=gestures, per_gesture=8, rng=0)
    >>> classifier = skinmap.train(touches, robot)
    >>> classifier.save("touch.skinmodel")
    >>> skinmap.Classifier.load("touch.skinmodel")
    Classifier(name=contact-geometry, labels=full_finger, poke, trained_on=torso)
    """

    def __init__(self, name: str, descriptor: Descriptor, estimator: Any) -> None:
        self.name, self.descriptor, self.estimator = name, descriptor, estimator
        self.trained_on: tuple[TrainedSkin, ...] = ()
        self.sets: SetCalibration | None = None
        self.coverage: float | None = None
        self.doubt: FloatArray | None = None
        self._quick: tuple[Any, Callable[[FloatArray], FloatArray]] | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """Names that the classifier can give.

        Raises
        ------
        NotFittedError
            Before training.
        """
        if not hasattr(self.estimator, "classes_"):
            raise NotFittedError(f"the classifier {self.name!r} is not trained yet")
        return tuple(map(str, self.estimator.classes_))

    def fit(
        self,
        touches: Sequence[Touch],
        *,
        rng: np.random.Generator,
        sets: bool = False,
        least: int = CALIBRATION_FOLDS,
    ) -> TouchClassifier:
        """Train on labelled touches; with `sets` so that sets of names can be promised, too.

        That takes a training for each of five groups of parts or persons left out, and a look at
        the beginnings of touches, so that young ones are doubted as they should be. Fewer than
        `least` touches of a label are refused; of more rows than an estimator is meant for some are
        drawn.

        Raises
        ------
        InvalidArrayError
            Fewer than two labels, or a label with fewer than five touches in contact.
        """
        skins = dict.fromkeys(touch.skin for touch in touches)
        self.trained_on = tuple(remember(skin.skin) for skin in skins)
        self.descriptor.fit(touches, rng=rng)
        labels = np.array([touch.label for touch in touches])
        _check_labels(labels, least)  # of all: before minutes are spent on those that are felt
        rows = [self.descriptor.describe(touch) for touch in touches]
        _check_labels(labels[np.array([len(row) > 0 for row in rows], bool)], least)
        table = np.concatenate(rows)
        named = np.repeat(labels, [len(row) for row in rows])
        most = getattr(self.estimator, "most_rows", ROWS)
        if len(table) > most:
            some = np.sort(rng.choice(len(table), most, replace=False))
            table, named = table[some], named[some]
        self.estimator.fit(table, named)
        self.sets = self._calibrated_sets(touches, rows) if sets else None
        self._quick = None
        moving = getattr(self.descriptor, "moving", False)
        self.doubt = self._early_doubt(touches, rng) if sets and moving else None
        return self

    def save(self, path: str | Path) -> None:
        """Write a trained classifier (`.skinmodel`).

        Parameters
        ----------
        path : str or Path
            File to write; one that is there is replaced.

        Raises
        ------
        NotFittedError
            Before training.
        OutputError
            The file cannot be written.
        """
        from skinmap.classify.model_file import save_classifier

        save_classifier(self, path)

    @staticmethod
    def load(path: str | Path) -> TouchClassifier:
        """Read what `save` or `skinmap train` wrote; nothing in the file is executed.

        Parameters
        ----------
        path : str or Path
            A file ending in .skinmodel.

        Returns
        -------
        Classifier
            Trained.

        Raises
        ------
        MissingFileError
            No such file.
        DataFormatError
            It is no Skinmap model, or holds types that a model has no use for.
        UnknownNameError
            A classifier whose plug-in is not installed.
        """
        from skinmap.classify.model_file import load_classifier

        return load_classifier(path)

    def _calibrated_sets(
        self, touches: Sequence[Touch], rows: Sequence[FloatArray]
    ) -> SetCalibration:
        used = [k for k, row in enumerate(rows) if len(row)]
        return calibrate_sets(
            self.estimator,
            np.stack([rows[k].mean(axis=0) for k in used]),
            np.array([touches[k].label for k in used]),
            [touches[k].skin.skin.part for k in used],
            np.array([touches[k].person for k in used]),
        )

    def _early_doubt(self, touches: Sequence[Touch], rng: np.random.Generator) -> FloatArray:
        """(len(AGES),) how far the names of touches so young are to be doubted."""
        some = rng.choice(len(touches), min(len(touches), YOUNG), replace=False)
        place = {label: k for k, label in enumerate(self.labels)}
        rows: list[list[FloatArray]] = [[] for _ in AGES]
        truth: list[list[int]] = [[] for _ in AGES]
        for touch in (touches[k] for k in some):
            felt = felt_rows(touch)
            for number, age in enumerate(AGES):
                end = felt[0] + max(1, round(age * touch.rate)) if len(felt) else 0
                if len(felt) == 0 or end > felt[-1] or touch.label not in place:
                    continue  # over by then
                begun = Touch(touch.skin, touch.samples[:end], rate=touch.rate)
                share = self.probabilities(begun)
                if share is not None:
                    rows[number].append(share)
                    truth[number].append(place[touch.label])
        return early_doubt(rows, truth)

    def promise(self, coverage: float) -> None:
        """Give `names` with each prediction that hold the truth in this share of all touches.

        Raises
        ------
        InvalidArrayError
            No share between 0 and 1.
        NotFittedError
            A model without held-out touches to promise by.
        """
        if self.sets is None:
            raise NotFittedError(
                f"this {self.name!r} model keeps no held-out touches to promise a coverage by; "
                f"`skinmap train` keeps them for {', '.join(WITH_SETS)}"
            )
        self.coverage = check_coverage(coverage)

    def prepare(self, skin: PreparedSkin) -> None:
        """Make ready to name touches on a skin one at a time, by compiled loops where numba is.

        Nothing has to be prepared; the first touches only take longer without.
        """
        for one in getattr(self, "members", (self,)):
            if hasattr(one.descriptor, "counter"):
                one.descriptor.counter(skin, compiled=True)
            compile_decisions(one.estimator)

    def difference(self, skin: Skin) -> SkinDifference:
        """How a skin differs from those trained on, and whether touches can be named there."""
        one_skin = bool(getattr(self.descriptor, "one_skin", False))
        return compare_skin(self.trained_on, skin, one_skin=one_skin)

    def probabilities(self, touch: Touch) -> FloatArray | None:
        """Probability of each of `labels`, the mean over rows; None without contact."""
        labels = self.labels
        rows = self.descriptor.describe(touch)
        if len(rows) == 0:
            return None
        if self._quick is None or self._quick[0] is not self.estimator:
            self._quick = (self.estimator, quick_probabilities(self.estimator))
        mean = np.asarray(self._quick[1](rows)).mean(axis=0)
        return mean.reshape(len(labels))

    def predict(self, touch: Touch, *, ended: bool = True) -> Prediction:
        """Label and confidence of a touch.

        `no_contact` where nothing is touched, `unknown` below the confidence that the estimator
        chose on held-out touches (its `reject_`, if it has one). A touch that goes on is named
        with doubt while it is young, by a classifier that looks at how touches go on: a finger
        that has just landed looks like a tap.
        """
        share = self.probabilities(touch)
        if share is not None and self.doubt is not None and not ended:
            felt = felt_rows(touch)
            age = (len(touch.samples) - int(felt[0])) / touch.rate if len(felt) else 0.0
            doubt = float(np.interp(age, AGES, self.doubt))
            share = (1.0 - doubt) * share + doubt / len(share)
        if share is None:
            return Prediction(NO_CONTACT, 1.0, None if self.coverage is None else (NO_CONTACT,))
        best = int(np.argmax(share))
        known = share[best] >= getattr(self.estimator, "reject_", 0.0)
        names = None
        if self.sets is not None and self.coverage is not None:
            part = touch.skin.skin.part
            threshold = self.sets.threshold(self.coverage, part, touch.person)
            names = likely_names(share, self.labels, threshold)
        return Prediction(self.labels[best] if known else UNKNOWN, float(share[best]), names)

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        trained = hasattr(self.estimator, "classes_")
        return {
            "name": self.name,
            "labels": listed(self.labels) if trained else "not trained",
            "trained_on": listed(one.part for one in self.trained_on),
        }


TouchClassifier = Classifier


def _check_labels(labels: NDArray[np.str_], least: int) -> None:
    """Refuse fewer than two labels, or fewer than `least` touches of one."""
    kinds, count = np.unique(labels, return_counts=True)
    if len(kinds) < 2 or count.min() < least:
        have = ", ".join(f"{n} {kind}" for kind, n in zip(kinds, count, strict=True))
        raise InvalidArrayError(
            f"training needs two labels or more, and of each {least} touches in contact; got: "
            f"{have or 'none'}"
        )


def calibrated(estimator: Any) -> Any:
    """Probabilities by Platt's sigmoid on held-out folds, one final model on all the data."""
    from sklearn.calibration import CalibratedClassifierCV

    return CalibratedClassifierCV(estimator, method="sigmoid", cv=CALIBRATION_FOLDS, ensemble=False)


def quick_probabilities(estimator: Any) -> Probabilities:
    """A function that gives what `estimator.predict_proba` gives for sound rows (n, d).

    Checking a row costs scikit-learn more than a small classifier does. Estimators may offer
    `probabilities` themselves; calibrated intersection SVMs are evaluated from their arrays;
    for all others it is `predict_proba`.
    """
    if hasattr(estimator, "probabilities"):
        return estimator.probabilities
    inner = getattr(estimator, "calibrated_classifiers_", [])
    if len(inner) == 1 and isinstance(inner[0].estimator, IntersectionSVC):
        curves = inner[0].calibrators
        if all(hasattr(curve, "a_") and hasattr(curve, "b_") for curve in curves):
            slope, offset = np.array([(float(c.a_), float(c.b_)) for c in curves]).T
            return _Platt(inner[0].estimator, slope, offset)
    return estimator.predict_proba


def compile_decisions(estimator: Any) -> None:
    """Have the decision values of a calibrated intersection SVM computed by compiled code."""
    for inner in getattr(estimator, "calibrated_classifiers_", []):
        if isinstance(inner.estimator, IntersectionSVC):
            inner.estimator.function_.compile()


class _Platt:
    """Decision values through one sigmoid a class, as scikit-learn's calibration does it."""

    def __init__(self, svc: IntersectionSVC, slope: FloatArray, offset: FloatArray) -> None:
        self.svc, self.slope, self.offset = svc, slope, offset

    def __call__(self, rows: FloatArray) -> FloatArray:
        """(n, classes) probabilities of rows (n, d)."""
        values, classes = self.svc.decision_values(rows), len(self.svc.classes_)
        if classes > 2 and self.svc.one_vs_one_:
            values = one_vs_rest(values, classes)
        # tanh instead of exp: it cannot overflow.
        share = 0.5 - 0.5 * np.tanh(0.5 * (self.slope * values + self.offset))
        if classes == 2:
            return np.concatenate([1.0 - share, share], axis=1)
        total = share.sum(axis=1, keepdims=True)
        even = np.full_like(share, 1.0 / classes)
        return np.divide(share, total, out=even, where=total > 0)

"""Classifiers of touches: a descriptor and a scikit-learn estimator under one name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.classify.descriptors import ContactGeometry, Descriptor, Histograms, Touch
from skinmap.errors import InvalidArrayError, NotFittedError
from skinmap.registry import Registry

NO_CONTACT = "no_contact"
ROWS = 1200  # training rows at most: the cost of a Gram matrix grows with the square
DEFAULT = "contact-geometry"


@dataclass(frozen=True, slots=True)
class Prediction:
    """A label and how sure the classifier is of it, 0 to 1."""

    label: str
    confidence: float


class TouchClassifier:
    """Names touches.

    Parameters
    ----------
    name : str
        Under which it was registered.
    descriptor : Descriptor
    estimator : scikit-learn classifier
        With `predict_proba`.
    """

    def __init__(self, name: str, descriptor: Descriptor, estimator: Any) -> None:
        self.name, self.descriptor, self.estimator = name, descriptor, estimator

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

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> TouchClassifier:
        """Train on labelled touches.

        Raises
        ------
        InvalidArrayError
            Fewer than two labels, or a label with fewer than five touches in contact.
        """
        self.descriptor.fit(touches, rng=rng)
        rows = [self.descriptor.describe(touch) for touch in touches]
        labels = np.array([touch.label for touch in touches])
        touched = np.array([len(row) > 0 for row in rows], bool)
        kinds, count = np.unique(labels[touched], return_counts=True)
        if len(kinds) < 2 or count.min() < CALIBRATION_FOLDS:
            have = ", ".join(f"{n} {kind}" for kind, n in zip(kinds, count, strict=True))
            raise InvalidArrayError(
                f"training needs two labels with {CALIBRATION_FOLDS} touches in contact each, "
                f"got: {have or 'none'}"
            )
        table = np.concatenate(rows)
        named = np.repeat(labels, [len(row) for row in rows])
        if len(table) > ROWS:
            some = np.sort(rng.choice(len(table), ROWS, replace=False))
            table, named = table[some], named[some]
        self.estimator.fit(table, named)
        return self

    def probabilities(self, touch: Touch) -> FloatArray | None:
        """Probability of each of `labels`, the mean over rows; None without contact."""
        labels = self.labels
        rows = self.descriptor.describe(touch)
        if len(rows) == 0:
            return None
        mean = np.asarray(self.estimator.predict_proba(rows)).mean(axis=0)
        return mean.reshape(len(labels))

    def predict(self, touch: Touch) -> Prediction:
        """Label and confidence of a touch; `no_contact` where nothing is touched."""
        share = self.probabilities(touch)
        if share is None:
            return Prediction(NO_CONTACT, 1.0)
        best = int(np.argmax(share))
        return Prediction(self.labels[best], float(share[best]))


CALIBRATION_FOLDS = 5


def _calibrated(estimator: Any) -> Any:
    """Probabilities by Platt's sigmoid on held-out folds, one final model on all the data."""
    from sklearn.calibration import CalibratedClassifierCV

    return CalibratedClassifierCV(estimator, method="sigmoid", cv=CALIBRATION_FOLDS, ensemble=False)


classifiers: Registry[Callable[[], TouchClassifier]] = Registry("classifier", "skinmap.classifiers")


@classifiers.register(DEFAULT)
def contact_geometry_classifier() -> TouchClassifier:
    """The default: lengths, areas and counts of the contacts, RBF SVM on their logarithms."""
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer, StandardScaler
    from sklearn.svm import SVC

    # C and gamma by 4-fold cross-validation over parts on simulated touches; flat around here.
    machine = make_pipeline(
        FunctionTransformer(np.log1p), StandardScaler(), SVC(C=10.0, gamma=0.05)
    )
    return TouchClassifier(DEFAULT, ContactGeometry(), _calibrated(machine))


@classifiers.register("histogram")
def histogram_classifier() -> TouchClassifier:
    """Histograms of periodic structures, rest dropped, and the intersection-kernel SVM."""
    from skinmap.classify.intersection import IntersectionSVC

    return TouchClassifier("histogram", Histograms(), _calibrated(IntersectionSVC()))


@classifiers.register("paper")
def paper_classifier() -> TouchClassifier:
    """The first paper's literal method: rest counts, no rotation, a label a sample."""
    from skinmap.classify.intersection import IntersectionSVC

    return TouchClassifier("paper", Histograms(literal=True), _calibrated(IntersectionSVC()))

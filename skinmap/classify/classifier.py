"""Classifiers of touches: a descriptor and a scikit-learn estimator under one name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.classify.descriptors import Descriptor, Touch
from skinmap.classify.rejection import UNKNOWN
from skinmap.classify.trained_skin import SkinDifference, TrainedSkin, compare_skin, remember
from skinmap.errors import InvalidArrayError, NotFittedError
from skinmap.registry import Registry
from skinmap.skin.skin import Skin
from skinmap.touch.prepared_skin import PreparedSkin

NO_CONTACT = "no_contact"
CALIBRATION_FOLDS = 5
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
        self.trained_on: tuple[TrainedSkin, ...] = ()
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

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> TouchClassifier:
        """Train on labelled touches.

        Raises
        ------
        InvalidArrayError
            Fewer than two labels, or a label with fewer than five touches in contact.
        """
        skins = dict.fromkeys(touch.skin for touch in touches)
        self.trained_on = tuple(remember(skin.skin) for skin in skins)
        self.descriptor.fit(touches, rng=rng)
        rows = [self.descriptor.describe(touch) for touch in touches]
        labels = np.array([touch.label for touch in touches])
        touched = np.array([len(row) > 0 for row in rows], bool)
        kinds, count = np.unique(labels[touched], return_counts=True)
        if len(kinds) < 2 or count.min() < CALIBRATION_FOLDS:
            have = ", ".join(f"{n} {kind}" for kind, n in zip(kinds, count, strict=True))
            raise InvalidArrayError(
                f"training needs two labels or more, and of each {CALIBRATION_FOLDS} touches in "
                f"contact; got: {have or 'none'}"
            )
        table = np.concatenate(rows)
        named = np.repeat(labels, [len(row) for row in rows])
        if len(table) > ROWS:
            some = np.sort(rng.choice(len(table), ROWS, replace=False))
            table, named = table[some], named[some]
        self.estimator.fit(table, named)
        self._quick = None
        return self

    def prepare(self, skin: PreparedSkin) -> None:
        """Make ready to name touches on a skin one at a time, by compiled loops where numba is.

        Nothing has to be prepared; the first touches only take longer without.
        """
        from skinmap.classify.fast_probabilities import compile_decisions

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
            from skinmap.classify.fast_probabilities import quick_probabilities

            self._quick = (self.estimator, quick_probabilities(self.estimator))
        mean = np.asarray(self._quick[1](rows)).mean(axis=0)
        return mean.reshape(len(labels))

    def predict(self, touch: Touch) -> Prediction:
        """Label and confidence of a touch.

        `no_contact` where nothing is touched, `unknown` below the confidence that the estimator
        chose on held-out touches (its `reject_`, if it has one).
        """
        share = self.probabilities(touch)
        if share is None:
            return Prediction(NO_CONTACT, 1.0)
        best = int(np.argmax(share))
        known = share[best] >= getattr(self.estimator, "reject_", 0.0)
        return Prediction(self.labels[best] if known else UNKNOWN, float(share[best]))


def calibrated(estimator: Any) -> Any:
    """Probabilities by Platt's sigmoid on held-out folds, one final model on all the data."""
    from sklearn.calibration import CalibratedClassifierCV

    return CalibratedClassifierCV(estimator, method="sigmoid", cv=CALIBRATION_FOLDS, ensemble=False)


def _plugged_in(name: str, thing: object) -> Callable[[], TouchClassifier]:
    """A factory of ours for what an entry point of another distribution gave."""
    from skinmap.classify.plugins import plugged_in

    return plugged_in(name, thing)


# One line a classifier: a function without arguments that gives an untrained TouchClassifier,
# in a file of its own, imported when the name is first looked up.
BUILT_IN = {
    # the geometry of the contacts
    "contact-geometry": "skinmap.classify.geometry_classifier:contact_geometry_classifier",
    # the first paper
    "histogram": "skinmap.classify.histogram_classifier:histogram_classifier",
    "paper": "skinmap.classify.paper_classifier:paper_classifier",
    # what it is compared with
    "raw-rbf": "skinmap.classify.raw_classifiers:raw_rbf_classifier",
    "raw-intersection": "skinmap.classify.raw_classifiers:raw_intersection_classifier",
    "histogram-chi2": "skinmap.classify.feature_map_classifiers:chi2_classifier",
    "histogram-sqrt": "skinmap.classify.feature_map_classifiers:sqrt_classifier",
    # the second paper
    "bovw": "skinmap.classify.bovw_classifier:bovw_classifier",
    "cnn": "skinmap.classify.cnn_classifier:cnn_classifier",
    # the first two, pooled
    "fusion": "skinmap.classify.fusion:fusion_classifier",
    "fusion-images": "skinmap.classify.fusion:fusion_images_classifier",
}
classifiers: Registry[Callable[[], TouchClassifier]] = Registry(
    "classifier", "skinmap.classifiers", built_in=BUILT_IN, adapt=_plugged_in
)

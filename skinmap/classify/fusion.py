"""The classifier `fusion`: several classifiers pooled, never worse than the best of them.

Plainly joining the numbers of two descriptions was worse than the better one alone. Here each
classifier keeps its own description, and their probabilities are multiplied with exponents (a
logarithmic opinion pool; Genest and Zidek, Statistical Science 1(1), 1986). The exponents are
chosen on parts that were left out of the training, since that is how touches on a new robot look.
The pool of one classifier alone is among the choices, and a mixture is taken only where it is
better by more than chance: on the held-out touches it cannot be worse than the best member.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from skinmap.arrays import FloatArray, IntArray
from skinmap.classify.classifier import CALIBRATION_FOLDS, TouchClassifier, classifiers
from skinmap.classify.descriptors import Touch
from skinmap.classify.rejection import rejection_threshold
from skinmap.classify.trained_skin import remember
from skinmap.errors import InvalidArrayError

MEMBERS = ("contact-geometry", "histogram")
FOLDS = 4  # groups of parts, each left out once
STEPS = 4  # weights are multiples of 1 / STEPS
LEAST = 1e-4  # no member may rule a label out altogether


class Pool(BaseEstimator):
    """What a fusion has learnt beside its members.

    Attributes
    ----------
    classes_ : (c,) array of str
    weights_ : (members,) float
        Exponents, not negative, sum 1.
    estimators_ : list
        The fitted estimators of the members.
    reject_ : float
        Touches named with less confidence are unknown.
    held_out_ : (members,) float
        Share of the held-out touches that each member alone named right.
    held_out_pool_ : float
        And the pool.
    """


class FusionClassifier(TouchClassifier):
    """A logarithmic opinion pool of classifiers.

    Parameters
    ----------
    name : str
    members : sequence of str
        Names of registered classifiers, the most trusted first.
    """

    def __init__(self, name: str = "fusion", members: Sequence[str] = MEMBERS) -> None:
        if len(members) < 2:
            raise InvalidArrayError(f"a fusion needs two members, got {', '.join(members)}")
        self.member_names = tuple(members)
        self.members = [classifiers.get(member)() for member in members]
        super().__init__(name, MemberDescriptors(self.members), Pool())

    def fit(
        self,
        touches: Sequence[Touch],
        *,
        rng: np.random.Generator,
        sets: bool = False,
        least: int = CALIBRATION_FOLDS,
    ) -> FusionClassifier:
        """Choose the weights on parts left out in turn, then train all members on everything.

        Raises
        ------
        InvalidArrayError
            Fewer than two labels, or a label with too few touches in contact.
        """
        self.trained_on = tuple(
            remember(skin.skin) for skin in dict.fromkeys(touch.skin for touch in touches)
        )
        touches = [touch for touch in touches if len(self.members[0].descriptor.describe(touch))]
        labels = np.array([touch.label for touch in touches])
        classes = np.unique(labels)
        fold = part_folds(touches, rng=rng)
        shares = np.full((len(self.members), len(touches), len(classes)), 1.0 / len(classes))
        tested = np.zeros(len(touches), bool)
        for number in np.unique(fold):
            learn = [touch for touch, f in zip(touches, fold, strict=True) if f != number]
            if not _enough(learn):
                continue
            tested |= fold == number
            for row, member in enumerate(self.member_names):
                model = classifiers.get(member)().fit(learn, rng=rng)
                for place in np.flatnonzero(fold == number):
                    shares[row, place] = _share(model, touches[place], classes)
        for model in self.members:
            model.fit(touches, rng=rng, least=least)
        learnt = np.searchsorted(classes, labels)
        self.estimator = learn_pool(shares[:, tested], learnt[tested], classes)
        self.estimator.estimators_ = [model.estimator for model in self.members]
        if self.estimator.weights_.max() == 1.0:
            # Alone, a member knows best when it knows nothing.
            best = self.members[int(np.argmax(self.estimator.weights_))]
            self.estimator.reject_ = float(getattr(best.estimator, "reject_", 0.0))
        return self

    def probabilities(self, touch: Touch) -> FloatArray | None:
        """Probability of each of `labels`; None without contact."""
        classes = np.array(self.labels)
        if len(self.descriptor.describe(touch)) == 0:
            return None
        for member, estimator in zip(self.members, self.estimator.estimators_, strict=True):
            member.estimator = estimator  # a model file brings them here
        used = [k for k, weight in enumerate(self.estimator.weights_) if weight > 0]
        shares = np.array([_share(self.members[k], touch, classes) for k in used])
        return np.asarray(pool(shares[:, None], self.estimator.weights_[used])[0])


class MemberDescriptors:
    """The descriptors of all members; the first decides whether there is contact."""

    def __init__(self, members: Sequence[TouchClassifier]) -> None:
        self._members = members

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> None:
        """Members learn for themselves."""

    def describe(self, touch: Touch) -> FloatArray:
        """Rows of the first member."""
        return self._members[0].descriptor.describe(touch)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What all members' descriptors have learnt, under `number/name`."""
        return {
            f"{number}/{name}": array
            for number, member in enumerate(self._members)
            if hasattr(member.descriptor, "to_arrays")
            for name, array in member.descriptor.to_arrays().items()
        }

    def from_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take what `to_arrays` gave."""
        for number, member in enumerate(self._members):
            if hasattr(member.descriptor, "from_arrays"):
                start = f"{number}/"
                own = {k[len(start) :]: v for k, v in arrays.items() if k.startswith(start)}
                member.descriptor.from_arrays(own)


def part_folds(touches: Sequence[Touch], *, rng: np.random.Generator) -> IntArray:
    """(m,) fold of each touch: whole parts together; single touches where there is one part."""
    skins = list(dict.fromkeys(touch.skin for touch in touches))
    if len(skins) < 2:
        return rng.permutation(len(touches)) % FOLDS
    number = {skin: k % FOLDS for k, skin in zip(rng.permutation(len(skins)), skins, strict=True)}
    return np.array([number[touch.skin] for touch in touches])


def pool(shares: FloatArray, weights: FloatArray) -> FloatArray:
    """(m, c) product of probabilities (members, m, c), each to the power of its weight."""
    scores = np.tensordot(weights, np.log(np.maximum(shares, LEAST)), axes=1)
    scores = np.exp(scores - scores.max(axis=1, keepdims=True))
    return np.asarray(scores / scores.sum(axis=1, keepdims=True))


def learn_pool(shares: FloatArray, labels: IntArray, classes: np.ndarray) -> Pool:
    """Weights chosen on held-out probabilities (members, m, c) of touches with labels (m,).

    The best member alone, or the mixture that names most touches right if it beats that member by
    more than one standard error of the difference.
    """
    members = len(shares)
    right = np.argmax(shares, axis=2) == labels
    alone = right.mean(axis=1) if right.size else np.zeros(members)
    best = int(np.argmax(alone))
    weights = np.eye(members)[best]
    gain = 0.0
    for candidate in _simplex(members):
        named = np.argmax(pool(shares, candidate), axis=1) == labels
        change = named.astype(np.float64) - right[best]
        if len(change) == 0:
            break
        error = change.std() / np.sqrt(len(change))
        if change.mean() > max(gain, error):
            weights, gain = candidate, float(change.mean())
    found = Pool()
    found.classes_ = np.asarray(classes)
    found.weights_ = weights
    pooled = pool(shares, weights)
    hit = np.argmax(pooled, axis=1) == labels
    found.held_out_, found.held_out_pool_ = alone, float(hit.sum() / max(len(hit), 1))
    found.reject_ = rejection_threshold(pooled.max(axis=1), hit)
    return found


def _simplex(members: int) -> list[FloatArray]:
    """All weights that are multiples of 1 / STEPS and sum to 1."""
    steps = itertools.product(range(STEPS + 1), repeat=members)
    return [np.array(one) / STEPS for one in steps if sum(one) == STEPS]


def _enough(touches: Sequence[Touch]) -> bool:
    """Whether a member can be trained on these."""
    count = np.unique([touch.label for touch in touches], return_counts=True)[1]
    return len(count) >= 2 and bool(count.min() >= 5)


def _share(model: TouchClassifier, touch: Touch, classes: np.ndarray) -> FloatArray:
    """(c,) probabilities of one member for the labels of the fusion; even where it sees nothing."""
    share: Any = model.probabilities(touch)
    even = np.full(len(classes), 1.0 / len(classes))
    if share is None:
        return even
    known = np.searchsorted(classes, np.array(model.labels))
    even[:] = LEAST
    even[known] = np.maximum(share, LEAST)
    return np.asarray(even / even.sum())


def fusion_classifier() -> FusionClassifier:
    """Contact geometry and histograms, pooled."""
    return FusionClassifier()


def fusion_images_classifier() -> FusionClassifier:
    """Contact geometry, histograms and contact images (bags of visual words), pooled.

    Under a name of its own, as the images need the extra `images`.
    """
    return FusionClassifier("fusion-images", (*MEMBERS, "bovw"))

"""Sets of names with a promise: the smallest that hold the truth in, say, nine of ten touches.

Split conformal prediction (Vovk, Gammerman and Shafer, "Algorithmic Learning in a Random World",
2005; Sadinle, Lei and Wasserman, JASA 114, 2019, for the smallest sets): of touches that the
classifier did not learn from, it is kept how surprising their true names were. A name belongs to
the set of a new touch if it is no more surprising than the threshold. That is

- on a skin that was calibrated, by the layout's fingerprint, the quantile of its own touches, and
  by someone new at least the quantile that holds for each of three or more people, left out;
- on another skin the quantile that holds as often as promised on each skin in turn, left out
  (parts that are mirror images of each other are one). Where skins differ by more than so few can
  show, no quantile does, and all names belong to the set.

What is surprising is judged by how strange a touch is, its distance from all that was learnt: on a
skin, by a hand or in a physics that is elsewhere, names are believed less and sets are wider.

The promise is about the whole set: where even the likeliest name is too surprising the set is
empty, and that is `unknown`. A touch that goes on has one name at least.

A touch is also called `unknown` below a confidence that is chosen on held-out touches, and names of
a touch that is young are doubted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, freeze
from skinmap.errors import InvalidArrayError
from skinmap.skin.checks import twin_parts
from skinmap.touch.contacts.skin_geometry import ACTIVE

if TYPE_CHECKING:
    from skinmap.recognition.classifier import Classifier
    from skinmap.recognition.descriptors import Touch

FOLDS = 5  # groups of parts, people or touches that are left out one after the other
LEAST = 20  # scores of a skin or person that its own quantile is taken from
GROUPS = 3  # skins, or people, that show how skins, or people, differ
STEPS = 101  # levels that are tried, from the coverage to 1
# Surprise is divided by how strange a touch is, against the median of those held out, to this power
# (normalised conformal prediction: Papadopoulos, Gammerman and Vovk, 2008). Chosen on MuJoCo's
# variants, and `judge` was seen too when power and floor were chosen: it is frozen for names, for
# sets nothing is. With 0, sets of a model of our touches promised for 90 % held 80 to 87 % of
# theirs, with 4 88 to 93 %; by a light and small hand 68 and 78 %. Higher powers only make sets
# larger. Touches nearer than a share of that are alike.
DOUBT, FAMILIAR = 4.0, 0.5
IMPOSSIBLE = 1e-9  # probability below which all names are as improbable
OR = " or "
WORDS = ("skins", "shapes", "people")


@dataclass(frozen=True, eq=False, slots=True)
class SetCalibration:
    """How improbable m held-out touches found their true names, and how strange they were.

    Attributes
    ----------
    shares : (m,) float
        Probability of the true name, by a classifier that never saw the group; 0 of a touch that
        was not felt.
    strange : (m,) float
        Distance from what that classifier learnt; all 0 where that is not measured.
    skins : tuple of str
        Fingerprint of the skin of each.
    shapes : tuple of str
        The same word for skins of one shape, reflected or not.
    people : tuple of str
        By whom, by name; empty where that is not known.
    usual : float
        How strange the median touch is.
    """

    shares: FloatArray
    strange: FloatArray
    skins: tuple[str, ...]
    shapes: tuple[str, ...]
    people: tuple[str, ...]
    usual: float = field(init=False)
    _found: dict[tuple[float, str, str], float] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        shares = check_finite(self.shares, "shares", (None,))
        strange = check_finite(self.strange, "strange", (len(shares),))
        words = (self.skins, self.shapes, self.people)
        if len(shares) == 0 or any(len(one) != len(shares) for one in words):
            raise InvalidArrayError(f"{len(shares)} shares of {len(self.skins)} touches")
        freeze(self, shares=shares, strange=strange)
        object.__setattr__(self, "usual", float(np.median(strange)) or 1.0)

    def surprise(self, shares: ArrayLike, strange: ArrayLike) -> FloatArray:
        """How surprising names of these probabilities are, of touches as strange as that."""
        nats = -np.log(np.maximum(shares, IMPOSSIBLE))
        return np.asarray(nats / np.maximum(np.divide(strange, self.usual), FAMILIAR) ** DOUBT)

    def threshold(self, coverage: float, skin: str = "", person: str = "") -> float:
        """The surprise up to which a name belongs to the set; inf where all names do.

        Parameters
        ----------
        coverage : float
            Share of the touches whose set is to hold the truth.
        skin : str
            Fingerprint of the layout.
        person : str
            By name. Of a person with `LEAST` touches it is what is enough for these, too; of
            another, where three or more were named, what is enough for each of them, left out.
        """
        key = (coverage, skin, person)
        if key not in self._found:
            self._found[key] = self._threshold(*key)
        return self._found[key]

    def _threshold(self, coverage: float, skin: str, person: str) -> float:
        scores = self.surprise(self.shares, self.strange)
        by, groups = left_out_by(self.shapes, self.people)
        if by != "parts" and skin not in self.skins:
            return float("inf")  # nothing was left out that could show it
        own, theirs = np.array(self.skins) == skin, np.array(self.people) == person
        by_whom = np.unique(np.array(self.people), return_inverse=True)[1]
        their = -np.inf
        if person and theirs.sum() >= LEAST:
            their = quantile(scores[theirs], coverage)
        elif by_whom.max() + 1 >= GROUPS:
            their = left_out_quantile(scores, by_whom, coverage)
        if by == "people" and np.isfinite(their):
            return their
        if by == "touches" and person not in ("", *self.people):
            return float("inf")
        if by == "parts" and own.sum() >= LEAST:
            return max(quantile(scores[own], coverage), their)
        return max(left_out_quantile(scores, groups, coverage), their)

    def names(
        self, share: FloatArray, labels: Sequence[str], strange: float, threshold: float
    ) -> tuple[str, ...]:
        """Labels of probabilities (c,) that surprise by no more than that, the likeliest first."""
        surprise = self.surprise(share, strange)
        order = np.argsort(-share, kind="stable")
        return tuple(labels[k] for k in order if surprise[k] <= threshold)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file keeps."""
        words = {name: np.array(getattr(self, name), np.str_) for name in WORDS}
        return {"shares": self.shares, "strange": self.strange, **words}


def set_calibration_from(arrays: Mapping[str, NDArray[Any]]) -> SetCalibration:
    """What `to_arrays` gave."""
    skins, shapes, people = (tuple(map(str, arrays[name])) for name in WORDS)
    return SetCalibration(arrays["shares"], arrays["strange"], skins, shapes, people)


def left_out_by(shapes: Sequence[str], people: Sequence[str]) -> tuple[str, IntArray]:
    """What touches are left out by, parts, people or touches, and (m,) the group of each."""
    for by, words in (("parts", shapes), ("people", people)):
        groups = np.unique(np.array(words), return_inverse=True)[1]
        if groups.max(initial=0) + 1 >= GROUPS:
            return by, groups
    return "touches", np.arange(len(shapes))


def folds_of(
    touches: Sequence[Touch],
) -> tuple[tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]], IntArray]:
    """Skins, shapes and people of m touches, and (m,) the fold that each is left out with.

    Parts are left out with their mirror images where there are three or more, else people by name,
    else touches at random.
    """
    shape_of = twin_parts({touch.skin.fingerprint: touch.skin.skin for touch in touches})
    known = tuple(touch.skin.fingerprint for touch in touches)
    shapes, people = tuple(shape_of[one] for one in known), tuple(one.person for one in touches)
    return (known, shapes, people), left_out_by(shapes, people)[1] % FOLDS


def quantile(scores: FloatArray, coverage: float) -> float:
    """The score that a new one of the same kind exceeds no more often than promised."""
    rank = int(np.ceil((len(scores) + 1) * coverage))
    return float(np.sort(scores)[rank - 1]) if rank <= len(scores) else float("inf")


def left_out_quantile(scores: FloatArray, groups: IntArray, coverage: float) -> float:
    """The score that a new one of another group exceeds no more often than promised.

    Each group counts alike. The level is the least at which the groups without one hold as many of
    that one as promised, on the mean over all: groups that differ much need a higher one, and few
    that differ more than that have none. Where each group is one score it is `quantile`.

    Parameters
    ----------
    scores : (m,) float
    groups : (m,) int
    coverage : float

    Returns
    -------
    float
        inf where no level is enough.
    """
    kinds, number, count = np.unique(groups, return_inverse=True, return_counts=True)
    if len(kinds) == len(scores):
        return quantile(scores, coverage)
    order = np.argsort(scores, kind="stable")
    scores, number = scores[order], number[order]
    weight = 1.0 / count[number]
    levels = np.linspace(coverage, 1.0, STEPS)

    def at(used: BoolArray) -> FloatArray:
        share = np.cumsum(weight[used])
        place = np.searchsorted(share, levels * share[-1] * (1.0 - 1e-12))
        return np.asarray(scores[used][place])

    if len(kinds) < 2:
        return float("inf")
    limits = np.array([at(number != kind) for kind in range(len(kinds))])
    held = [
        (scores[number == kind, None] <= limit).mean(axis=0) for kind, limit in enumerate(limits)
    ]
    enough = np.flatnonzero(np.mean(held, axis=0) >= coverage)
    # Their largest: of all groups at once the same level is one rank lower.
    return float(limits[:, enough[0]].max()) if len(enough) else float("inf")


def check_coverage(coverage: float) -> float:
    """A coverage strictly between 0 and 1."""
    if not 0.0 < coverage < 1.0:  # false for NaN
        raise InvalidArrayError(f"coverage must lie between 0 and 1, got {coverage:g}")
    return float(coverage)


def enough_names(share: FloatArray, labels: Sequence[str], coverage: float) -> tuple[str, ...]:
    """The fewest labels whose probabilities (c,) sum to the coverage, the likeliest first."""
    order = np.argsort(-share, kind="stable")
    count = int(np.searchsorted(np.cumsum(share[order]), coverage * (1.0 - 1e-12))) + 1
    return tuple(labels[k] for k in order[:count])


YOUNG = 600  # touches at most whose beginnings are looked at
LEARNT = 2  # touches of a label that a copy may learn from


def held_out(
    copy: Callable[[], Classifier], touches: Sequence[Touch], *, rng: np.random.Generator
) -> tuple[SetCalibration, list[list[float]]]:
    """How improbable copies of a classifier find the true names of touches they never saw.

    Groups are left out in turn (`folds_of`). Each copy learns all anew, its descriptor too.

    Parameters
    ----------
    copy : callable
        Gives an untrained classifier.
    touches : sequence of Touch
        Labelled.
    rng : numpy.random.Generator

    Returns
    -------
    SetCalibration
        Of all touches.
    list of list of float
        For each of `AGES` the probabilities of the true names of touches that went on so long.
    """
    words, fold = folds_of(touches)
    young = rng.permutation(len(touches)) < YOUNG
    shares, strange = np.zeros(len(touches)), np.zeros(len(touches))
    early: list[list[float]] = [[] for _ in AGES]
    for number in np.unique(fold):
        model = copy()
        try:
            learnt = [one for one, own in zip(touches, fold, strict=True) if own != number]
            model.fit(learnt, rng=rng, least=LEARNT)
        except ValueError:
            continue  # nothing to learn from: their names stay impossible
        for k in np.flatnonzero(fold == number).tolist():
            shares[k] = _of_the_truth(model, touches[k], touches[k].label)
            strange[k] = model.strangeness(touches[k])
            if young[k]:
                for age, begun in _beginnings(touches[k]):
                    early[age].append(_of_the_truth(model, begun, touches[k].label))
    return SetCalibration(shares, strange, *words), early


def felt_rows(touch: Touch) -> IntArray:
    """Which of a touch's samples anything is felt in."""
    return np.flatnonzero((touch.samples > ACTIVE).any(axis=1))


def _of_the_truth(model: Classifier, touch: Touch, label: str) -> float:
    """The probability of a name; 0 of one that was not learnt, or where nothing is felt."""
    share = model.probabilities(touch)
    known = share is not None and label in model.labels
    return float(share[model.labels.index(label)]) if known and share is not None else 0.0


def _beginnings(touch: Touch) -> Iterator[tuple[int, Touch]]:
    """The touch as it was at each of `AGES` (by number) while it went on."""
    felt = felt_rows(touch)
    for number, age in enumerate(AGES):
        end = felt[0] + max(1, round(age * touch.rate)) if len(felt) else 0
        if len(felt) == 0 or end > felt[-1]:
            return  # over by then
        yield number, replace(touch, samples=touch.samples[:end])


UNKNOWN = "unknown"
# Ages at which touches are looked at that go on [s], and how many are needed to say anything.
AGES = (0.02, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5)
ENOUGH = 20
LOST = 0.02  # share of the rightly named held-out touches that may be rejected at most


def rejection_threshold(confidence: ArrayLike, right: ArrayLike, *, lost: float = LOST) -> float:
    """The confidence below which held-out touches are named wrong more often than right.

    Parameters
    ----------
    confidence : (m,) array-like of float
        Of held-out touches, 0 to 1.
    right : (m,) array-like of bool
        Whether each was named right.
    lost : float
        The threshold rejects at most this share of those named right.

    Returns
    -------
    float
        0 where nothing is gained by rejecting.
    """
    sure = np.asarray(confidence, np.float64)
    good = np.asarray(right, bool)
    order = np.argsort(sure, kind="stable")
    # Rejecting the k least sure gains their wrong names and loses their right ones.
    gain = np.concatenate([[0], np.cumsum(np.where(good[order], -1, 1))])
    rejected = np.concatenate([[0], np.cumsum(good[order])])
    gain[rejected > lost * good.sum()] = -1
    best = int(np.argmax(gain))
    if best == 0:
        return 0.0
    upper = sure[order[best]] if best < len(order) else sure[order[-1]]
    return float(0.5 * (sure[order[best - 1]] + upper))


def early_doubt(own: Sequence[Sequence[float]], names: int) -> FloatArray:
    """How far names are to be doubted while a touch goes on, at each of `AGES`.

    Names are learnt from whole touches, and of the beginning of one they are too sure. With a
    doubt of d the probabilities are (1 - d) p + d / c of c names: the d under which the true names
    are the most likely. It never grows with age, and is 0 at the last age. Where no touches say how
    sure to be, any of the names is as likely as another: 1 - 1 / c.

    Parameters
    ----------
    own : sequence over `AGES` of sequence of float
        Probabilities that the true names of held-out touches of this age were given.
    names : int
        c.

    Returns
    -------
    (len(AGES),) float
        0 to 1.
    """
    grid = np.linspace(0.0, 0.99, 100)
    found = np.full(len(AGES), 1.0 - 1.0 / names)
    for number, shares in enumerate(own):
        if len(shares) >= ENOUGH:
            told = (1.0 - grid) * np.array(shares)[:, None] + grid / names
            found[number] = grid[int(np.argmax(np.log(np.maximum(told, 1e-300)).sum(axis=0)))]
        elif number:
            found[number] = found[number - 1]
    found[-1] = 0.0
    return np.asarray(np.minimum.accumulate(found))


def doubt_from(array: ArrayLike) -> FloatArray:
    """The doubt that a model file keeps.

    Raises
    ------
    InvalidArrayError
        Not a share of 0 to 1 for each age.
    """
    doubt = check_finite(array, "doubt", (len(AGES),))
    if (doubt < 0.0).any() or (doubt >= 1.0).any():
        raise InvalidArrayError("a doubt is a share from 0 to 1")
    return doubt

"""Sets of names with a promise: the smallest that hold the truth in, say, nine of ten touches.

Split conformal prediction (Vovk, Gammerman and Shafer, "Algorithmic Learning in a Random World",
2005; Sadinle, Lei and Wasserman, JASA 114, 2019, for the smallest sets): of touches that the
classifier did not learn from, it is kept how surprising their true names were. A name belongs to
the set of a new touch if it is no more surprising than the threshold. That is

- on a skin that was calibrated, by the layout's fingerprint, the quantile of its own touches;
- on another skin the quantile that holds as often as promised on each skin in turn, left out
  (parts that are mirror images of each other are one). Where skins differ by more than so few can
  show, no quantile does, and all names belong to the set.

What is surprising is judged by how strange a touch is, its distance from all that was learnt: on a
skin, by a hand or in a physics that is elsewhere, names are believed less and sets are wider.

The promise is about the whole set: where even the likeliest name is too surprising the set is
empty, and that is `unknown`. A touch that goes on has one name at least.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, freeze
from skinmap.errors import InvalidArrayError

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
        Fingerprint of the skin of each; empty words in files of before, which kept the part's name.
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
            By name. Of a person with `LEAST` touches it is what is enough for these, too.
        """
        key = (coverage, skin, person)
        if key not in self._found:
            self._found[key] = self._threshold(*key)
        return self._found[key]

    def _threshold(self, coverage: float, skin: str, person: str) -> float:
        scores = self.surprise(self.shares, self.strange)
        if not any(self.skins):  # mirror images were not left out together: as the worst part needs
            parts = np.array(self.shapes)
            return max(quantile(scores[parts == one], coverage) for one in np.unique(parts))
        by, groups = left_out_by(self.shapes, self.people)
        if by != "parts" and skin not in self.skins:
            return float("inf")  # nothing was left out that could show it
        own, theirs = np.array(self.skins) == skin, np.array(self.people) == person
        their = quantile(scores[theirs], coverage) if person and theirs.sum() >= LEAST else -np.inf
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
    """What `to_arrays` gave, or files of before, that name parts and know no layout."""
    if "parts" in arrays:
        shares, nobody = 1.0 - arrays["scores"], ("",) * len(arrays["scores"])
        parts = tuple(map(str, arrays["parts"]))
        return SetCalibration(shares, np.zeros(len(shares)), nobody, parts, nobody)
    skins, shapes, people = (tuple(map(str, arrays[name])) for name in WORDS)
    return SetCalibration(arrays["shares"], arrays["strange"], skins, shapes, people)


def left_out_by(shapes: Sequence[str], people: Sequence[str]) -> tuple[str, IntArray]:
    """What touches are left out by, parts, people or touches, and (m,) the group of each."""
    for by, words in (("parts", shapes), ("people", people)):
        groups = np.unique(np.array(words), return_inverse=True)[1]
        if groups.max(initial=0) + 1 >= GROUPS:
            return by, groups
    return "touches", np.arange(len(shapes))


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

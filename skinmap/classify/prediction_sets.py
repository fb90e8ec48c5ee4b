"""Sets of names with a promise: the smallest that hold the truth in, say, nine of ten touches.

Split conformal prediction (Vovk, Gammerman and Shafer, "Algorithmic Learning in a Random World",
2005; Sadinle, Lei and Wasserman, JASA 114, 2019, for the smallest sets): of touches that the
classifier did not learn from, it is kept how improbable it found their true names. A name belongs
to the set of a new touch if it is no more improbable than that quantile of them. The quantile is
that of the touch's own part where it is known (Mondrian). Parts differ, so that of a part that was
not calibrated is what is enough for as large a share of those that were.

The promise holds for touches like those of the calibration. It is about the whole set: where even
the likeliest name is too improbable the set is empty, and that is `unknown`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray, check_finite, check_whole, freeze
from skinmap.errors import InvalidArrayError

FOLDS = 5  # groups of parts, persons or touches that are left out one after the other
LEAST = 20  # scores of a group that its own quantile is taken from
GROUPS = 3  # parts that say how parts differ
NOBODY = -1  # a person who is not known
OR = " or "


@dataclass(frozen=True, eq=False, slots=True)
class SetCalibration:
    """How improbable m held-out touches found their true names.

    Attributes
    ----------
    scores : (m,) float
        One minus the probability of the true name, by a classifier that never saw the group.
    parts : tuple of str
        Of each touch.
    persons : (m,) int
        Who touched; `NOBODY` where that is not known.
    """

    scores: FloatArray
    parts: tuple[str, ...]
    persons: IntArray
    _found: dict[tuple[float, str, int], float] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        scores = check_finite(self.scores, "scores", (None,))
        if len(scores) == 0 or len(self.parts) != len(scores):
            raise InvalidArrayError(f"{len(scores)} scores of {len(self.parts)} touches")
        persons = check_whole(self.persons, "persons", (len(scores),))
        freeze(self, scores=scores, persons=persons)

    def threshold(self, coverage: float, part: str, person: int = NOBODY) -> float:
        """The score up to which a name belongs to the set; inf where all names do.

        Of the part's own touches where there are `LEAST`. Of another part, what would have been
        enough for the promised share of the parts, or of the person's touches where that is more.
        """
        key = (coverage, part, person)
        if key not in self._found:
            self._found[key] = self._threshold(*key)
        return self._found[key]

    def _threshold(self, coverage: float, part: str, person: int) -> float:
        parts = np.array(self.parts)
        names, count = np.unique(parts, return_counts=True)
        large = names[count >= LEAST]
        if part in large:
            return quantile(self.scores[parts == part], coverage)
        if len(large) >= GROUPS:
            each = [quantile(self.scores[parts == one], coverage) for one in large]
            found = [float(np.quantile(each, coverage, method="higher"))]
        else:
            found = [quantile(self.scores, coverage)]
        own = self.persons == person
        if person != NOBODY and own.sum() >= LEAST:
            theirs = quantile(self.scores[own], coverage)
            found = [*found, theirs] if len(large) >= GROUPS else [theirs]
        return max(found)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file keeps."""
        parts = np.array(self.parts, np.str_)
        return {"scores": self.scores, "parts": parts, "persons": self.persons}


def quantile(scores: FloatArray, coverage: float) -> float:
    """The score that a new one of the same kind exceeds no more often than promised."""
    rank = int(np.ceil((len(scores) + 1) * coverage))
    return float(np.sort(scores)[rank - 1]) if rank <= len(scores) else float("inf")


def set_calibration_from(arrays: Mapping[str, NDArray[Any]]) -> SetCalibration:
    """What `to_arrays` gave."""
    parts = tuple(map(str, arrays["parts"]))
    return SetCalibration(arrays["scores"], parts, arrays["persons"])


def check_coverage(coverage: float) -> float:
    """A coverage strictly between 0 and 1."""
    if not 0.0 < coverage < 1.0:  # false for NaN
        raise InvalidArrayError(f"coverage must lie between 0 and 1, got {coverage:g}")
    return float(coverage)


def likely_names(share: FloatArray, labels: Sequence[str], threshold: float) -> tuple[str, ...]:
    """Labels whose improbability 1 - share (c,) is at most the threshold, the likeliest first."""
    order = np.argsort(-share, kind="stable")
    return tuple(labels[k] for k in order if 1.0 - share[k] <= threshold)


def calibrate_sets(
    estimator: Any,
    rows: FloatArray,
    labels: NDArray[Any],
    parts: Sequence[str],
    persons: IntArray,
) -> SetCalibration:
    """Scores of all touches by copies of an estimator that never saw their group.

    Groups are the parts where there are three or more, else the persons, else touches at random.

    Parameters
    ----------
    estimator : scikit-learn classifier
    rows : (m, d) float
        One a touch.
    labels : (m,) str
    parts : sequence of str
    persons : (m,) int
    """
    from sklearn.base import clone

    groups = _groups(np.array(parts), persons)
    scores = np.ones(len(rows))
    for fold in range(groups.max() + 1):
        test = groups == fold
        kinds, count = np.unique(labels[~test], return_counts=True)
        if len(kinds) < 2 or count.min() < 2:
            continue  # nothing to learn from: their names stay improbable
        model = clone(estimator).fit(rows[~test], labels[~test])
        share = model.predict_proba(rows[test])
        place = {str(name): k for k, name in enumerate(model.classes_)}
        own = np.array([place.get(str(name), -1) for name in labels[test]])
        scores[test] = 1.0 - np.where(own >= 0, share[np.arange(len(own)), own], 0.0)
    return SetCalibration(scores, tuple(map(str, parts)), persons)


def _groups(parts: NDArray[Any], persons: IntArray) -> IntArray:
    """(m,) which fold each touch is left out with."""
    for kind in (np.unique(parts, return_inverse=True)[1], _ranks(persons)):
        if kind.max() + 1 >= 3:
            return np.asarray(kind % FOLDS)
    return np.arange(len(parts)) % FOLDS


def _ranks(persons: IntArray) -> IntArray:
    return np.asarray(np.unique(persons, return_inverse=True)[1])

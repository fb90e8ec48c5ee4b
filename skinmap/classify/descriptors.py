"""Descriptors: from the samples of a touch to rows of numbers that a classifier learns from."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import FloatArray
from skinmap.classify.intersection import IntersectionSVC
from skinmap.classify.prediction_sets import NOBODY
from skinmap.errors import InvalidArrayError, NotFittedError
from skinmap.neighbours.offsets import LATTICE, Neighbourhoods, concatenate
from skinmap.neighbours.structures import Structures, assign, find_structures
from skinmap.touch.codebook import (
    COUNTS,
    WORDS,
    Codebook,
    codebook_arrays,
    codebook_from_arrays,
    learn_codebook,
)
from skinmap.touch.contact_geometry import contact_geometry
from skinmap.touch.contacts import check_pressures, pool_event, pressed
from skinmap.touch.histogram import Mode, PatchSamples, StructureHistogram
from skinmap.touch.motion_features import MOTION_FEATURES, MOVES, in_time, motion_features
from skinmap.touch.nearest_structure import Coverage, adopt_nearest, coverage
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.rest import felt
from skinmap.touch.votes import VoteCounter

ROWS = 8  # samples of one touch that histograms are counted on: neighbours in time are alike
BOOK_SAMPLES = 120  # samples of one part that the codebook is learnt from
Unseen = Literal["skip", "nearest"]
Distance = Literal["euclidean", "geodesic"]
Search = Literal["plain", "compiled"]
Precision = Literal["float64", "float32"]
logger = logging.getLogger(__name__)
HELP_FOLDS = 3
HELPS = 0.75  # motion is looked at where it leaves no more of the errors than this
CANDIDATES = (2, 4, 8, 16)
FOLDS = 4


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class Touch:
    """One touch: its skin, samples (k, n) of 0 to 255 counts, and label and person if known.

    `rate` are its samples a second.
    """

    skin: PreparedSkin
    samples: NDArray[np.uint8]
    label: str = ""
    person: int = NOBODY
    rate: float = 50.0


def recorded_touches(skin: PreparedSkin, recording: Recording) -> list[Touch]:
    """The touches of a recording with their labels, and nothing of what is none of them.

    Spikes, stuck taxels and what does not exceed a taxel's own noise at rest are 0.
    """
    rest, beside, rate = recording.rest(), skin.geometry.beside, recording.rate
    return [
        Touch(skin, felt(samples, rest, beside), label, int(recording.subjects[event]), rate)
        for event, label, samples in recording.touches()
    ]


class Descriptor(Protocol):
    """What a classifier sees of a touch."""

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> None:
        """Learn what the description needs (codebooks, say) from training touches."""

    def describe(self, touch: Touch) -> FloatArray:
        """(rows, d) numbers of one touch; no row where nothing is touched."""


class ContactGeometry:
    """One row a touch: lengths, areas and counts of the contacts, and how they go on in time.

    Parameters
    ----------
    motion : bool, optional
        Whether the numbers of `motion_features` are among them. By default they are where the
        training touches go on in time, and held-out ones are named better by it: touches that
        all stay where they are named as before.
    """

    REACH: ClassVar[int] = MOTION_FEATURES.index("reach_mm")
    # What is measured is not learnt, so each touch is once, however many classifiers look at it.
    _still: ClassVar[WeakKeyDictionary[Touch, FloatArray]] = WeakKeyDictionary()
    _moving: ClassVar[WeakKeyDictionary[Touch, FloatArray]] = WeakKeyDictionary()

    def __init__(self, *, motion: bool | None = None) -> None:
        self.motion = motion
        self.moving = bool(motion)
        self.blurred = False  # models of before also looked at shapes of touches that move

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> None:
        """Find out whether motion helps, unless that was said."""
        del rng
        if self.motion is None:
            self.moving = False
            self.moving = self._motion_helps(touches)

    def describe(self, touch: Touch) -> FloatArray:
        """(1, d) numbers: `FEATURES` and, with motion, `MOTION_FEATURES` in turn.

        (0, d) where nothing is touched. Pooled over a way, a shape is mostly the way: with motion,
        the `FEATURES` of a touch that moves are 0, and its shape is that of single samples.
        """
        row = self._still.get(touch)
        if row is None:
            row = self._still[touch] = self._measure(touch)
        return self._joined(row, self._motion(touch)[: len(row)]) if self.moving else row

    def _joined(self, still: FloatArray, motion: FloatArray) -> FloatArray:
        stays = self.blurred | (motion[:, self.REACH] <= MOVES)
        return np.concatenate([still * stays[:, None], motion], axis=1)

    def _motion(self, touch: Touch) -> FloatArray:
        row = self._moving.get(touch)
        if row is None:
            found = motion_features(touch.skin.geometry, touch.samples, touch.rate)
            row = self._moving[touch] = found[None]
        return row

    @staticmethod
    def _measure(touch: Touch) -> FloatArray:
        geometry = touch.skin.geometry
        check_pressures(touch.samples, geometry)
        row = contact_geometry(geometry, pool_event(touch.samples))[None]
        return row if row[0, 0] > 0 else row[:0]

    def _motion_helps(self, touches: Sequence[Touch]) -> bool:
        """Whether touches go on in time, and held-out ones are named better by their motion."""
        from sklearn.model_selection import StratifiedKFold, cross_val_score

        from skinmap.classify.rbf_machine import RbfMachine

        used = [touch for touch in touches if len(self.describe(touch))]
        labels = np.array([touch.label for touch in used])
        kinds, count = np.unique(labels, return_counts=True)
        if len(kinds) < 2 or count.min() < HELP_FOLDS:
            return False
        motion = np.concatenate([self._motion(touch) for touch in used])
        goes_on = in_time(motion)
        if max(goes_on[labels == kind].mean() for kind in kinds) < 0.5:
            return False
        still = np.concatenate([self.describe(touch) for touch in used])
        split = StratifiedKFold(HELP_FOLDS, shuffle=True, random_state=0)
        without, using = (
            float(cross_val_score(RbfMachine(), rows, labels, cv=split).mean())
            for rows in (still, self._joined(still, motion))
        )
        return 1.0 - using <= HELPS * (1.0 - without)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file keeps."""
        return {"moving": np.array(self.moving), "blurred": np.array(self.blurred)}

    def from_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take what `to_arrays` gave."""
        self.moving = bool(arrays["moving"])
        self.blurred = bool(arrays.get("blurred", True))


class Histograms:
    """Votes for codewords of periodic structures (the first paper).

    Parameters
    ----------
    literal : bool
        As published: no rotation, rest counted, one row a sample. Else rotations by pi / 3,
        rest dropped and one row a touch, the mean over its samples.
    words : int or "cv"
        Codewords a structure; "cv" chooses them by cross-validation (`choose_words`).
    unseen : {"skip", "nearest"}
        What becomes of taxels that match no learnt structure: they do not vote, or vote as
        the structure that is nearest to theirs.
    radius : float, optional
        Of the neighbourhoods [m]; the skin's own by default.
    rotations : {1, 4, 6}, optional
        Turns that leave a structure the same; 6, or 1 where `literal`.
    distance : {"euclidean", "geodesic"}
        How the radius is measured.
    search : {"plain", "compiled"}, optional
        How the nearest codeword is looked for; "compiled" where numba is and pays by default.
    precision : {"float64", "float32"}
        Of the distances from codewords.
    """

    def __init__(
        self,
        *,
        literal: bool = False,
        words: int | Literal["cv"] = WORDS,
        unseen: Unseen = "skip",
        radius: float | None = None,
        rotations: int | None = None,
        distance: Distance = "euclidean",
        search: Search | None = None,
        precision: Precision = "float64",
    ) -> None:
        self.literal, self.words, self.unseen = literal, words, unseen
        self.radius, self.rotations, self.distance = radius, rotations, distance
        self.search, self.precision = search, precision
        self.codebook: Codebook | None = None
        self._counters: dict[PreparedSkin, tuple[VoteCounter, Structures, Coverage]] = {}

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> None:
        """Find the structures of all skins together and learn the codebook from their samples."""
        skins = list(dict.fromkeys(touch.skin for touch in touches))
        rotations = self.rotations or (1 if self.literal else LATTICE)
        hoods = {skin: self._hoods(skin, rotations) for skin in skins}
        found = find_structures(concatenate(list(hoods.values())), rotations=rotations)
        self._counters = {}
        matched = {skin: assign(own, found.prototypes) for skin, own in hoods.items()}
        words = self._choose(touches, matched, rng) if self.words == "cv" else self.words
        pools = []
        for skin in skins:
            own = [touch.samples for touch in touches if touch.skin is skin]
            samples = np.concatenate([pressed(block) for block in own])
            some = rng.choice(len(samples), min(BOOK_SAMPLES, len(samples)), replace=False)
            pools.append((matched[skin], samples[some] / COUNTS))
        self.codebook = learn_codebook(pools, rng=rng, words=words, literal=self.literal)

    def _hoods(self, skin: PreparedSkin, rotations: int) -> Neighbourhoods:
        symmetry = rotations if rotations > 1 else LATTICE
        return skin.neighbourhoods(radius=self.radius, distance=self.distance, symmetry=symmetry)

    def _choose(
        self,
        touches: Sequence[Touch],
        matched: Mapping[PreparedSkin, Structures],
        rng: np.random.Generator,
    ) -> int:
        held = [(touch, pressed(touch.samples)) for touch in touches]
        used = [(touch, samples) for touch, samples in held if len(samples)]
        words, scores = choose_words(
            [PatchSamples(matched[touch.skin], samples / COUNTS) for touch, samples in used],
            [touch.label for touch, _ in used],
            rng=rng,
            mode="paper" if self.literal else "rest-dropped",
        )
        logger.info("%d words a structure; accuracy of each choice: %s", words, scores)
        return words

    def describe(self, touch: Touch) -> FloatArray:
        """(rows, bins) votes of one touch."""
        counter = self.counter(touch.skin)
        samples = pressed(touch.samples)
        some = np.linspace(0, len(samples) - 1, min(ROWS, len(samples))).astype(np.int64)
        votes = counter.count(samples[some] / COUNTS)
        if self.literal or len(votes) == 0:
            return votes.astype(np.float64)
        return votes.mean(axis=0, keepdims=True)

    def counter(self, skin: PreparedSkin, *, compiled: bool | None = None) -> VoteCounter:
        """What counts the votes on a skin, made once; compiled as soon as that is asked for."""
        if self.codebook is None:
            raise NotFittedError("no codebook yet: train the classifier first")
        known = self._counters.get(skin)
        if known is None or (compiled and not known[0].compiled and self._may_compile):
            hoods = self._hoods(skin, self.codebook.prototypes.rotations)
            matched = assign(hoods, self.codebook.prototypes)
            used = adopt_nearest(hoods, matched) if self.unseen == "nearest" else matched
            counter = self._counter(used, compiled)
            self._counters[skin] = (counter, used, coverage(matched, used))
            logger.info("%s: %s", skin.skin.part, self._counters[skin][2])
        return self._counters[skin][0]

    def _counter(self, structures: Structures, compiled: bool | None) -> VoteCounter:
        """As asked for in `search` and `precision`, which win over what is asked for here."""
        book = self.codebook
        if book is None:
            raise NotFittedError("no codebook yet: train the classifier first")
        single = self.precision == "float32"
        if not self._may_compile:
            compiled = False
        elif self.search == "compiled":
            compiled = True
        return VoteCounter(book, structures, compiled=compiled, single=single)

    @property
    def _may_compile(self) -> bool:
        return self.search != "plain" and self.precision == "float64"

    def structures(self, skin: PreparedSkin) -> Structures:
        """The structures of a skin among those that were learnt; -1 for taxels that do not vote."""
        self.counter(skin)
        return self._counters[skin][1]

    def coverage(self, skin: PreparedSkin) -> Coverage:
        """How many taxels of a skin vote, and as what."""
        self.counter(skin)
        return self._counters[skin][2]

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file keeps: the codebook and its structures."""
        if self.codebook is None:
            raise NotFittedError("no codebook to save: train the classifier first")
        kept = {"hoods": np.array([self.radius or np.nan, float(self.distance == "geodesic")])}
        how = {"counting": np.array([self.search or "", self.precision])}
        return {**codebook_arrays(self.codebook), **kept, **how}

    def from_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take what `to_arrays` gave."""
        self.codebook = codebook_from_arrays(arrays)
        if "hoods" in arrays:  # models of before could not be told
            radius, geodesic = map(float, arrays["hoods"])
            self.radius = radius if np.isfinite(radius) and radius > 0 else None
            self.distance = "geodesic" if geodesic else "euclidean"
        if "counting" in arrays:
            search, precision = map(str, arrays["counting"])
            self.search = "plain" if search == "plain" else "compiled" if search else None
            self.precision = "float32" if precision == "float32" else "float64"


def choose_words(
    touches: Sequence[PatchSamples],
    labels: ArrayLike,
    *,
    rng: np.random.Generator,
    groups: ArrayLike | None = None,
    candidates: Sequence[int] = CANDIDATES,
    mode: Mode = "rest-dropped",
) -> tuple[int, dict[int, float]]:
    """The number of codewords with which an intersection SVM names most held-out touches right.

    Codebooks are learnt anew on the training touches of each fold.

    Parameters
    ----------
    touches : sequence of PatchSamples
        One touch, or one sample, each.
    labels : (n,) array-like of str
    rng : numpy.random.Generator
    groups : (n,) array-like of int, optional
        Event of each sample where touches have several: kept on one side of every fold.
    candidates : sequence of int
        Numbers to try.
    mode : {"rest-dropped", "paper"}

    Returns
    -------
    int
        The smallest of the best: within one standard error of the best mean.
    dict of int to float
        Mean accuracy of each candidate.

    Raises
    ------
    InvalidArrayError
        A label with fewer than two touches (or events).
    """
    from sklearn.model_selection import GridSearchCV, StratifiedGroupKFold
    from sklearn.pipeline import make_pipeline

    names = np.asarray(labels)
    events = np.arange(len(names)) if groups is None else np.asarray(groups)
    least = min((len(np.unique(events[names == name])) for name in np.unique(names)), default=0)
    if least < 2:
        raise InvalidArrayError(f"choosing words needs two touches of each label, got {least}")
    seed = int(rng.integers(2**31))
    folds = StratifiedGroupKFold(min(FOLDS, least), shuffle=True, random_state=seed)
    machine = make_pipeline(StructureHistogram(mode=mode, random_state=seed), IntersectionSVC())
    grid = {"structurehistogram__words": sorted(candidates)}
    search = GridSearchCV(machine, grid, cv=folds, refit=False, error_score="raise")
    search.fit(list(touches), names, groups=events)
    mean, spread = search.cv_results_["mean_test_score"], search.cv_results_["std_test_score"]
    best = int(np.argmax(mean))
    error = spread[best] / np.sqrt(folds.get_n_splits())
    smallest = int(np.flatnonzero(mean >= mean[best] - error)[0])
    words = sorted(candidates)
    return words[smallest], dict(zip(words, map(float, mean), strict=True))

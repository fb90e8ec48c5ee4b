"""Descriptors: from the samples of a touch to rows of numbers that a classifier learns from.

Plug-ins ask for one of them by name, their input kind. Image classifiers get the second paper's
contact image.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, Literal, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, NotFittedError, SkinMismatchError, check_known
from skinmap.neighbours.offsets import LATTICE, Neighbourhoods, concatenate
from skinmap.neighbours.structures import adopt_nearest, assign, find_structures
from skinmap.touch.contacts.contact_geometry import contact_geometry
from skinmap.touch.contacts.motion_features import MOTION_FEATURES, MOVES, in_time, motion_features
from skinmap.touch.contacts.rest import felt
from skinmap.touch.contacts.skin_geometry import check_pressures, pool_event, pressed
from skinmap.touch.histograms.codebook import (
    COUNTS,
    WORDS,
    Codebook,
    VoteCounter,
    codebook_arrays,
    codebook_from_arrays,
    learn_codebook,
)
from skinmap.touch.images.contact_image import SIZE, paper_images
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording

ROWS = 8  # samples of one touch that histograms are counted on: neighbours in time are alike
BOOK_SAMPLES = 120  # samples of one part that the codebook is learnt from
Distance = Literal["euclidean", "geodesic"]
logger = logging.getLogger(__name__)
HELP_FOLDS = 3
HELPS = 0.75  # motion is looked at where it leaves no more of the errors than this


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class Touch:
    """One touch on a skin.

    Attributes
    ----------
    skin : PreparedSkin
        n taxels.
    samples : (k, n) array of 0 to 255
        Pressures [counts]; rest is 0.
    label : str
        Its name; empty where that is not known.
    person : str
        By whom, by name; empty where that is not known.
    rate : float
        Samples a second [Hz]: what goes on in time is measured by it.
    """

    skin: PreparedSkin
    samples: NDArray[np.uint8]
    label: str = ""
    person: str = ""
    rate: float = field(kw_only=True)


def recorded_touches(skin: PreparedSkin, recording: Recording) -> list[Touch]:
    """The touches of a recording with their labels, and nothing of what is none of them.

    Spikes, stuck taxels and what does not exceed a taxel's own noise at rest are 0.

    Parameters
    ----------
    skin : PreparedSkin
        That was recorded, n taxels.
    recording : Recording
        Pressures (t, n) of 0 to 255 counts with marked touches.

    Returns
    -------
    list of Touch
        One an event, in their order.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("torso")
    >>> recording = skinmap.simulate(skin, gestures=["poke"], per_gesture=5, rng=0)
    >>> touches = recorded_touches(PreparedSkin(skin), recording)
    >>> [touch.label for touch in touches[:2]]
    ['poke', 'poke']
    """
    rest, beside, rate = recording.rest(), skin.geometry.beside, recording.rate
    return [
        Touch(skin, felt(samples, rest, beside), label, recording.people[event], rate=rate)
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

    def stays(self, touch: Touch) -> bool:
        """Whether it is felt at one place: its shape is then that of all samples."""
        return bool(self._motion(touch)[0, self.REACH] <= MOVES)

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

        from skinmap.recognition.rbf_machine import RbfMachine

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
    words : int
        Codewords a structure.
    radius : float, optional
        Of the neighbourhoods [m]; the skin's own by default.
    rotations : {1, 4, 6}, optional
        Turns that leave a structure the same; 6, or 1 where `literal`.
    distance : {"euclidean", "geodesic"}
        How the radius is measured.
    """

    def __init__(
        self,
        *,
        literal: bool = False,
        words: int = WORDS,
        radius: float | None = None,
        rotations: int | None = None,
        distance: Distance = "euclidean",
    ) -> None:
        self.literal, self.words = literal, words
        self.radius, self.rotations, self.distance = radius, rotations, distance
        self.codebook: Codebook | None = None
        self._counters: dict[PreparedSkin, VoteCounter] = {}

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> None:
        """Find the structures of all skins together and learn the codebook from their samples."""
        skins = list(dict.fromkeys(touch.skin for touch in touches))
        rotations = self.rotations or (1 if self.literal else LATTICE)
        hoods = {skin: self._hoods(skin, rotations) for skin in skins}
        found = find_structures(concatenate(list(hoods.values())), rotations=rotations)
        self._counters = {}
        matched = {
            skin: adopt_nearest(own, assign(own, found.prototypes)) for skin, own in hoods.items()
        }
        pools = []
        for skin in skins:
            own = [touch.samples for touch in touches if touch.skin is skin]
            samples = np.concatenate([pressed(block) for block in own])
            samples = samples if len(samples) else own[0][:1]  # of a skin that nothing touched
            some = rng.choice(len(samples), min(BOOK_SAMPLES, len(samples)), replace=False)
            pools.append((matched[skin], samples[some] / COUNTS))
        self.codebook = learn_codebook(pools, rng=rng, words=self.words, literal=self.literal)

    def _hoods(self, skin: PreparedSkin, rotations: int) -> Neighbourhoods:
        symmetry = rotations if rotations > 1 else LATTICE
        return skin.neighbourhoods(radius=self.radius, distance=self.distance, symmetry=symmetry)

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
        if known is None or (compiled and not known.compiled):
            hoods = self._hoods(skin, self.codebook.prototypes.rotations)
            # A taxel whose structure was never learnt votes as the one that it resembles most.
            matched = adopt_nearest(hoods, assign(hoods, self.codebook.prototypes))
            known = VoteCounter(self.codebook, matched, compiled=compiled)
            self._counters[skin] = known
            voting = np.count_nonzero(matched.labels >= 0)
            logger.info("%s: %d of %d taxels vote", skin.skin.part, voting, len(skin))
        return known

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file keeps: the codebook and its structures."""
        if self.codebook is None:
            raise NotFittedError("no codebook to save: train the classifier first")
        kept = {"hoods": np.array([self.radius or np.nan, float(self.distance == "geodesic")])}
        return {**codebook_arrays(self.codebook), **kept}

    def from_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take what `to_arrays` gave."""
        self.codebook = codebook_from_arrays(arrays)
        radius, geodesic = map(float, arrays["hoods"])
        self.radius = radius if np.isfinite(radius) and radius > 0 else None
        self.distance = "geodesic" if geodesic else "euclidean"


LARGEST = 1024  # pixels along a side
FRAMES = 2  # images a touch: its first and last quarter while pressed


class PaperImages:
    """Grey images, flattened, of two moments of a touch.

    Parameters
    ----------
    size : (rows, columns)
        As published by default.
    """

    def __init__(self, size: tuple[int, int] = SIZE) -> None:
        self.size = size

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> None:
        """Nothing to learn."""

    def describe(self, touch: Touch) -> FloatArray:
        """(2, rows * columns) grey levels of 0 to 255; no row where nothing is touched."""
        samples = pressed(touch.samples)
        if len(samples) == 0:
            return np.zeros((0, self.size[0] * self.size[1]))
        images = paper_images(
            touch.skin.image_geometry, samples[moments(len(samples))], size=self.size
        )
        return images.reshape(len(images), -1).astype(np.float64)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file keeps."""
        return {"size": np.array(self.size)}

    def from_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take what `to_arrays` gave.

        Raises
        ------
        InvalidArrayError
            A size that no image has.
        """
        rows, columns = map(int, arrays["size"])
        if not (0 < rows <= LARGEST and 0 < columns <= LARGEST):
            raise InvalidArrayError(f"images of {rows} x {columns}: sides are 1 to {LARGEST}")
        self.size = (rows, columns)


def moments(samples: int, frames: int = FRAMES) -> list[int]:
    """Which of the samples of a touch are looked at: `frames` of them, evenly in time."""
    return [int((k + 0.5) / frames * samples) for k in range(frames)]


class RawSamples:
    """Pressures of 0 to 1, one column a taxel: only for the one skin that was trained on."""

    one_skin = True

    def __init__(self) -> None:
        self.part: str | None = None
        self.positions: FloatArray = np.zeros((0, 3))

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> None:
        """Remember which skin it is.

        Raises
        ------
        SkinMismatchError
            Touches of several skins: their taxels have nothing to do with each other.
        """
        skins = list(dict.fromkeys(touch.skin for touch in touches))
        if len(skins) != 1:
            parts = ", ".join(skin.skin.part for skin in skins) or "none"
            raise SkinMismatchError(f"raw values need touches of one part, got: {parts}")
        self.part, self.positions = skins[0].skin.part, skins[0].skin.positions

    def describe(self, touch: Touch) -> FloatArray:
        """(rows, n) up to eight samples of a touch; no row where nothing is touched."""
        if self.part is None:
            raise NotFittedError("no skin yet: train the classifier first")
        if touch.samples.shape[1] != len(self.positions):
            raise SkinMismatchError(
                f"raw values of {len(self.positions)} taxels of {self.part!r} were learnt, "
                f"{touch.skin.skin.part!r} has {touch.samples.shape[1]}"
            )
        samples = pressed(touch.samples)
        some = np.linspace(0, len(samples) - 1, min(ROWS, len(samples))).astype(np.int64)
        return samples[some] / COUNTS

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file keeps."""
        return {"part": np.array(self.part or ""), "positions": self.positions}

    def from_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take what `to_arrays` gave."""
        self.part, self.positions = str(arrays["part"]), arrays["positions"]


INPUT_KINDS: Mapping[str, Callable[[], Descriptor]] = {
    "raw": RawSamples,
    "histogram": Histograms,
    "image": PaperImages,
    "contact-geometry": partial(ContactGeometry, motion=False),
    "contact-motion": partial(ContactGeometry, motion=True),
}


def descriptor_of(kind: str) -> Descriptor:
    """The descriptor of an input kind.

    Raises
    ------
    UnknownNameError
        A kind that there is not.
    """
    check_known("input kind", [str(kind)], INPUT_KINDS)
    return INPUT_KINDS[kind]()

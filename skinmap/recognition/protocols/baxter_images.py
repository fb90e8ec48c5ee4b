"""Simulated contact images for the second paper's protocol: human hands against all else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import IntArray
from skinmap.errors import InvalidArrayError
from skinmap.recognition.images.image_descriptor import FRAMES, moments
from skinmap.recognition.protocols.folds import FoldKind, Names
from skinmap.touch.contacts.skin_geometry import pressed
from skinmap.touch.images.paper_image import SIZE, paper_images, resize
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import GESTURES as ALL_GESTURES
from skinmap.touch.simulation.gestures import TIME
from skinmap.touch.simulation.simulator import simulate

HAND, OTHER = "hand", "other"
# Grips of a human hand, and what else touches a robot's arm; as many images of each group.
GESTURES = {
    HAND: ("whole_hand", "three_finger"),
    OTHER: ("elbow", "forearm", "ball", "cylinder", "edge"),
}
WHOLE_HANDS = tuple(name for name in (*ALL_GESTURES, *TIME) if name not in GESTURES[OTHER])
FEWEST = 10  # touches of hands, and of others
TEST = 0.3  # share of the images that test


@dataclass(frozen=True, eq=False, slots=True)
class ImageSet:
    """Labelled images.

    Attributes
    ----------
    images : (n, 66, 100) uint8
    raw : (n, n_taxels) uint8
        The samples that they are of.
    labels : (n,) str
        "hand" or "other".
    gestures : (n,) str
    events : (n,) int
        Touch that each sample is of.
    """

    images: NDArray[np.uint8]
    raw: NDArray[np.uint8]
    labels: Names
    gestures: Names
    events: IntArray

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def table(self) -> NDArray[np.uint8]:
        """(n, 6600) images as rows."""
        return self.images.reshape(len(self), -1)


NO_HAND = ("other", "non-hand", "non_hand", "nonhand", "no_hand", "not_hand", *GESTURES[OTHER])


def given_images(images: NDArray[np.uint8], named: Names, touches: IntArray) -> ImageSet:
    """Images (n, rows, columns) of files, with labels (n,) and touches (n,).

    Labels are "hand" and "other", or gestures that are one of these.

    Raises
    ------
    InvalidArrayError
        Another label, or fewer than 10 touches of either kind.
    """
    names = np.array([name.strip().lower() for name in named])
    known = {HAND, "hands", "human", *NO_HAND, *WHOLE_HANDS}
    for name in dict.fromkeys(names.tolist()):
        if name not in known:
            raise InvalidArrayError(
                f"label {name!r}: labels are hand, other, or a gesture of the simulator"
            )
    labels = np.where(np.isin(names, NO_HAND), OTHER, HAND)
    for label in (HAND, OTHER):
        count = len(np.unique(touches[labels == label]))
        if count < FEWEST:
            raise InvalidArrayError(f"{count} touches of {label}: {FEWEST} at least")
    grey = resize(images, SIZE)
    gestures = np.where(np.isin(names, ["hands", "human"]), HAND, names)
    return ImageSet(grey, grey.reshape(len(grey), -1), labels, gestures, touches)


def simulate_images(
    skin: PreparedSkin,
    *,
    images: int,
    rng: np.random.Generator,
    variety: float = 0.0,
) -> ImageSet:
    """About as many images as asked for, `FRAMES` of each touch, half of them of hands.

    Raises
    ------
    InvalidArrayError
        Fewer than 5 touches of each gesture were asked for, or a group that does not fit the
        skin at all.
    """
    raw, gestures, labels, events = [], [], [], []
    touches = 0
    for label, names in GESTURES.items():
        per_gesture = round(images / (2 * FRAMES * len(names)))
        if per_gesture < 5:
            raise InvalidArrayError(f"{images} images are too few: 5 touches of each gesture")
        recording = simulate(
            skin.skin, rng=rng, per_gesture=per_gesture, gestures=names, variety=variety
        )
        for _, gesture, samples in recording.touches():
            held = pressed(samples)
            if len(held) == 0:
                continue
            raw.append(held[moments(len(held))])
            gestures += [gesture] * FRAMES
            labels += [label] * FRAMES
            events += [touches] * FRAMES
            touches += 1
        if label not in labels:
            raise InvalidArrayError(
                f"{skin.skin.part!r} has no room for any of: {', '.join(names)}"
            )
    samples = np.concatenate(raw)
    grey = paper_images(skin.image_geometry, samples)
    return ImageSet(grey, samples, np.array(labels), np.array(gestures), np.array(events))


def split_images(kind: FoldKind, data: ImageSet, *, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(n,) which images test: 30 % of the touches of each gesture, or of its images.

    "event" keeps all images of a touch on one side; "plain", as published, does not.
    """
    units = data.events if kind == "event" else np.arange(len(data))
    held = np.zeros(len(data), bool)
    for gesture in np.unique(data.gestures):
        own = np.unique(units[data.gestures == gesture])
        out = rng.choice(own, round(TEST * len(own)), replace=False)
        held |= np.isin(units, out) & (data.gestures == gesture)
    return held

"""What classifiers may ask to see of a touch, by name: the input kinds of plug-ins.

What the image classifiers see of a touch: the second paper's contact image.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, NotFittedError, SkinMismatchError, check_known
from skinmap.recognition.descriptors import ROWS, ContactGeometry, Descriptor, Histograms, Touch
from skinmap.touch.contacts.skin_geometry import pressed
from skinmap.touch.histograms.codebook import COUNTS
from skinmap.touch.images.contact_image import SIZE, paper_images

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

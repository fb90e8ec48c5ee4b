"""What the image classifiers see of a touch: the second paper's contact image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.recognition.descriptors import Touch
from skinmap.touch.contacts.skin_geometry import pressed
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

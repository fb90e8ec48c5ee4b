"""What the image classifiers see of a touch: the second paper's contact image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.classify.descriptors import Touch
from skinmap.touch.contacts import pressed
from skinmap.touch.paper_image import SIZE, paper_images

FRAMES = 2  # images a touch: its first and last quarter while pressed


class PaperImages:
    """Grey images of 66 x 100, flattened, of two moments of a touch."""

    def fit(self, touches: Sequence[Touch], *, rng: np.random.Generator) -> None:
        """Nothing to learn."""

    def describe(self, touch: Touch) -> FloatArray:
        """(2, 6600) grey levels of 0 to 255; no row where nothing is touched."""
        samples = pressed(touch.samples)
        if len(samples) == 0:
            return np.zeros((0, SIZE[0] * SIZE[1]))
        images = paper_images(touch.skin.image_geometry, samples[moments(len(samples))])
        return images.reshape(len(images), -1).astype(np.float64)


def moments(samples: int, frames: int = FRAMES) -> list[int]:
    """Which of the samples of a touch are looked at: `frames` of them, evenly in time."""
    return [int((k + 0.5) / frames * samples) for k in range(frames)]

"""The course of a touch over its event: how it grows, wanders and where it lands first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.touch.contacts import ACTIVE, SkinGeometry

COURSE = ("growth", "wander_mm")
MM = 1e3


def course(geometry: SkinGeometry, samples: NDArray[np.uint8]) -> FloatArray:
    """The numbers named in `COURSE` for the samples (k, n) of one event; zeros if untouched.

    `growth` is the active area while landing as a share of that while pressed, `wander_mm` the
    way of the centre of pressure while pressed (straight, in space).
    """
    felt = np.where(samples > ACTIVE, samples, 0).astype(np.float32)
    load = felt.sum(axis=1)
    if len(load) == 0 or load.max() <= 0:
        return np.zeros(len(COURSE))
    held = load >= 0.5 * load.max()
    area = (felt > 0) @ geometry.areas
    landing = np.flatnonzero(load > 0.1 * load.max())[:2]
    hold = felt[held]
    centre = (hold @ geometry.mesh.vertices) / load[held][:, None]
    quarter = max(1, len(centre) // 4)  # means: one sample's noise is no way
    wander = np.linalg.norm(centre[-quarter:].mean(axis=0) - centre[:quarter].mean(axis=0))
    return np.array([area[landing].mean() / area[held].mean(), wander * MM])

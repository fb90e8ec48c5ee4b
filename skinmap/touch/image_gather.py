"""The inner loops of contact images: three weighted taxels a pixel, compiled by numba.

Without numba the sparse matrix does the same work, see `contact_image`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np


def gather_one(pixels: Any, columns: Any, weights: Any, pressures: Any, image: Any) -> bool:
    """Fill one image (pixels,); False where a pressure is not finite or too large for float32."""
    values = np.empty(len(pressures), np.float32)
    for i in range(len(pressures)):
        if not abs(pressures[i]) <= 3.4e38:
            return False
        values[i] = pressures[i]
    for j in range(len(pixels)):
        image[pixels[j]] = (
            weights[j, 0] * values[columns[j, 0]]
            + weights[j, 1] * values[columns[j, 1]]
            + weights[j, 2] * values[columns[j, 2]]
        )
    return True


def gather_many(pixels: Any, columns: Any, weights: Any, values: Any, images: Any) -> None:
    """Fill images (pixels, samples) from values (taxels, samples): samples run innermost."""
    samples, reached = values.shape[1], 0
    for j in range(len(pixels)):
        pixel = pixels[j]
        images[reached:pixel] = 0.0
        reached = pixel + 1
        one, two, three = columns[j, 0], columns[j, 1], columns[j, 2]
        u, v, w = weights[j, 0], weights[j, 1], weights[j, 2]
        for s in range(samples):
            images[pixel, s] = u * values[one, s] + v * values[two, s] + w * values[three, s]
    images[reached:] = 0.0


@functools.cache
def compiled_gathers() -> tuple[Callable[..., bool], Callable[..., None]] | None:
    """`gather_one` and `gather_many` compiled; None without numba."""
    try:
        from numba import njit
    except ImportError:
        return None
    try:
        compiled = njit(nogil=True, cache=True)
        return compiled(gather_one), compiled(gather_many)
    except RuntimeError:  # nowhere to keep the compiled code: compile in each process
        compiled = njit(nogil=True)
        return compiled(gather_one), compiled(gather_many)

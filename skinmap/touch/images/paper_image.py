"""Contact images as the second paper has them: 256 grey levels, resized to 66 x 100.

A. Albini, S. Denei and G. Cannata, "Human hand recognition from robotic skin measurements in
human-robot physical interactions", IROS 2017. The grid there is about the pitch of the taxels,
k = floor(255 p / max P) for the pressures P of all taxels at one moment, and images are resized
to 66 x 100.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import FloatArray
from skinmap.touch.images.contact_image import ContactImageGeometry, Image

SIZE = (66, 100)
# Of a level: far above the rounding of float32 (1e-4), so that a plateau keeps one level.
HAIR = 1e-3


def paper_images(
    geometry: ContactImageGeometry, samples: ArrayLike, *, size: tuple[int, int] = SIZE
) -> NDArray[np.uint8]:
    """Grey images (t, *size) of samples (t, n_taxels).

    A sample without pressure gives a zero image. Pressures below zero count as none. A map that
    stands where the image lies (or the reverse) is turned by a quarter, its top to the right.

    Raises
    ------
    SkinMismatchError, InvalidArrayError
        As `ContactImageGeometry.images`, but for values too large for float32, which are scaled.
    """
    values = unit_exponent(samples)
    images = geometry.images(values)
    return resize(grey_levels(images, values.max(axis=1, initial=0)), size)


def unit_exponent(samples: ArrayLike) -> NDArray[np.generic]:
    """Samples (t, n), each scaled by a power of two to a largest value of 0.5 to 1.

    Exact, so levels stay what they are; 1e308 and denormals then fit single precision.
    """
    values = np.asarray(samples)
    if values.dtype.kind != "f" or values.ndim != 2 or values.size == 0:
        return values
    _, exponent = np.frexp(np.abs(values).max(axis=1, keepdims=True))
    return np.asarray(np.ldexp(values, -exponent))


def grey_levels(images: Image, largest: ArrayLike) -> NDArray[np.uint8]:
    """floor(255 p / max P) for images (t, rows, columns) of pressures; zero where max P = 0.

    `largest` (t,) is max P, the largest pressure of any taxel: no pixel lies above it, and one
    between the taxels of a small touch well below.
    """
    flat = np.maximum(images, 0.0, dtype=np.float64)
    peak = np.asarray(largest, np.float64)[:, None, None]
    level = np.floor(255.0 * flat / np.where(peak > 0, peak, 1.0) + HAIR)
    return np.minimum(level, 255.0).astype(np.uint8)


def resize(images: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Images (t, rows, columns) resized to (t, *size), linear, rounded to the nearest level."""
    if (images.shape[1] > images.shape[2]) != (size[0] > size[1]):
        images = np.rot90(images, -1, axes=(1, 2))
    down = _resampling(images.shape[1], size[0])
    across = _resampling(images.shape[2], size[1])
    smooth = down @ (images.astype(np.float64) @ across.T)
    # Sums in another order differ by 1e-13: rounded first, a tie is one on every machine.
    return np.asarray(np.rint(smooth.round(9)).astype(np.uint8))


@functools.lru_cache(maxsize=16)
def _resampling(n: int, wanted: int) -> FloatArray:
    """(wanted, n) weights of linear resampling; a tent as wide as a new pixel where it shrinks."""
    scale = n / wanted
    centre = (np.arange(wanted) + 0.5) * scale - 0.5
    reach = max(scale, 1.0)
    tent = np.maximum(1.0 - np.abs(np.arange(n) - np.clip(centre, 0, n - 1)[:, None]) / reach, 0.0)
    weights = tent / tent.sum(axis=1, keepdims=True)
    weights.flags.writeable = False
    return np.asarray(weights)

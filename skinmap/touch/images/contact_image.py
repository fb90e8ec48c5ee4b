"""Contact images: pressures on the flat map, sampled on a grid of square pixels.

A pixel's value is interpolated in the flat map's own triangle under its centre, so gaps between
patches and holes of the skin stay empty. The three weights a pixel are one sparse matrix, made
once; an image is that matrix times the pressures.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from skinmap.arrays import BoolArray, FloatArray, IntArray, freeze
from skinmap.errors import InvalidArrayError, MissingLibraryError, SkinMismatchError
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.raster import locate_pixels, pixel_coverage
from skinmap.numba_loops import compiled

PITCH = 8e-3  # [m]: about that of the taxels, as published (Albini, Denei and Cannata, IROS 2017)
NARROWING = 1.0 - 0.02 * np.arange(41)  # shares of the taxels' pitch that a grid may have
PIXELS = 2**26  # a grid of more is a mistake in its pitch
LARGEST = 3.4e38  # pressure that an image in float32 holds

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ContactImageGeometry:
    """A grid over a flat map, and the matrix from pressures to pixels.

    Attributes
    ----------
    pitch : float
        Side of a pixel on the flat map [m].
    corner : (2,) float
        Flat-map coordinates of the image's upper left corner [m].
    matrix : (rows * columns, n_taxels) sparse
        Three barycentric weights a pixel; empty rows outside the map. Taxels merged into one
        vertex share its weight.
    mask : (rows, columns) bool
        Pixels whose centre lies in the map.
    coverage : (rows, columns) float
        Share of each pixel that lies in the map, 0 to 1.
    pixels : (k,) int
        Row-major numbers of the pixels in the map.
    columns : (k, 3) int
        The vertices (taxels) of the triangle under each of them.
    weights : (k, 3) float32
    representative : (n_taxels,) int
        The taxel that stands for each one.
    """

    pitch: float
    corner: FloatArray
    matrix: csr_array
    mask: BoolArray
    coverage: FloatArray
    pixels: IntArray
    columns: IntArray
    weights: Image
    representative: IntArray

    def __post_init__(self) -> None:
        small = np.uint16 if self.matrix.shape[1] <= 2**16 else np.int32
        freeze(
            self,
            corner=self.corner,
            mask=self.mask,
            coverage=self.coverage,
            pixels=self.pixels.astype(np.int32),
            columns=self.columns.astype(small),  # half the bytes, and bytes are what it costs
            weights=self.weights.astype(np.float32),
            representative=self.representative,
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.mask.shape[0], self.mask.shape[1]

    def __len__(self) -> int:
        """Number of taxels."""
        return len(self.representative)

    @cached_property
    def single(self) -> csr_array:
        """The matrix in single precision."""
        return self.matrix.astype(np.float32)

    @cached_property
    def merging(self) -> csr_array | None:
        """(n, n) mean over the taxels of each vertex; None where every taxel is one."""
        n = len(self)
        if (self.representative == np.arange(n)).all():
            return None
        return _merging(self.representative)

    def image(self, pressures: ArrayLike) -> Image:
        """Image (rows, columns) of one sample.

        Parameters
        ----------
        pressures : (n_taxels,) array-like

        Raises
        ------
        SkinMismatchError
            Another number of pressures than taxels.
        InvalidArrayError
            NaN, infinity, or a value too large for float32.
        """
        values = self._checked(pressures, 1)
        compiled = compiled_gathers()
        if compiled is None or self.merging is not None:
            _refuse_unusable(values)
            return np.asarray((self.single @ values.astype(np.float32)).reshape(self.shape))
        image = np.zeros(self.mask.size, np.float32)
        if not compiled[0](self.pixels, self.columns, self.weights, values, image):
            _refuse_unusable(values)
        return image.reshape(self.shape)

    def images(self, samples: ArrayLike) -> Image:
        """Images (t, rows, columns) of samples (t, n_taxels).

        The pixels of all samples lie side by side in memory (it is a transposed view): four
        times as fast as one image after the other. Errors are those of `image`.
        """
        values = self._checked(samples, 2)
        _refuse_unusable(values)
        columns = np.ascontiguousarray(values.T, dtype=np.float32)
        compiled = compiled_gathers()
        if compiled is None:
            flat = self.single @ columns
        else:
            if self.merging is not None:
                columns = np.ascontiguousarray(self.merging @ columns, dtype=np.float32)
            flat = np.empty((self.mask.size, len(values)), np.float32)
            compiled[1](self.pixels, self.columns, self.weights, columns, flat)
        return np.asarray(flat.T).reshape(len(values), *self.shape)

    def _checked(self, pressures: ArrayLike, dimensions: int) -> NDArray[np.generic]:
        values = np.ascontiguousarray(pressures)
        if values.dtype.kind not in "biuf":
            raise InvalidArrayError(f"pressures must be numbers, got {values.dtype}")
        if values.ndim != dimensions or values.shape[-1] != len(self):
            wanted = f"({len(self)},)" if dimensions == 1 else f"(t, {len(self)})"
            raise SkinMismatchError(
                f"pressures must have shape {wanted}, one a taxel, got {values.shape}"
            )
        return values.astype(np.uint8) if values.dtype.kind == "b" else values


def image_geometry(
    flat: FlatMap,
    *,
    pitch: float | None = None,
    shape: tuple[int | None, int | None] | None = None,
) -> ContactImageGeometry:
    """Grid of square pixels over a flat map, centred on it, and its matrix.

    Parameters
    ----------
    flat : FlatMap
    pitch : float, optional
        Side of a pixel [m]; 8 mm where no shape is given either.
    shape : (rows, columns), optional
        Instead of a pitch: the smallest pitch with which the map fits. One of the two may be
        None; it then follows from the map's aspect.

    Returns
    -------
    ContactImageGeometry

    Raises
    ------
    InvalidArrayError
        Pitch and shape both given, not positive, or a grid of more than 2^26 pixels.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.touch import image_geometry
    >>> hand = skinmap.load_robot("kaspar").skin("right_hand")
    >>> flat = skinmap.flatten(skinmap.build_surface(hand))
    >>> image_geometry(flat, shape=(20, 30)).shape
    (20, 30)
    """
    under = _under(flat, pitch, shape)
    rows, columns = under.shape
    mask = np.zeros(rows * columns, bool)
    mask[under.pixels] = True
    entries = (under.weights.ravel(), (np.repeat(under.pixels, 3), under.taxels.ravel()))
    matrix = csr_array(entries, shape=(rows * columns, len(flat.mesh.skin)))
    return ContactImageGeometry(
        under.pitch,
        under.corner,
        csr_array(matrix @ _merging(flat.mesh.representative)),
        mask.reshape(rows, columns),
        pixel_coverage(under.points, under.faces, under.shape)
        if len(under.faces)
        else mask.reshape(rows, columns).astype(np.float64),
        under.pixels,
        under.taxels,
        under.weights.astype(np.float32),
        flat.mesh.representative,
    )


def taxel_grid(flat: FlatMap) -> ContactImageGeometry:
    """The grid of the second paper: as wide as the taxels lie apart, and none without a pixel.

    Starts at the median distance between taxels (8 mm on the paper's skin) and narrows by steps of
    2 % until each taxel of the map has a pixel; on the built-in robots it ends at half or more.
    """
    spacing = flat.mesh.skin.spacing
    placed = flat.mesh.representative[np.isfinite(flat.uv[:, 0])]
    for share in NARROWING:
        under = _under(flat, share * spacing, None)
        if np.isin(placed, under.taxels[under.weights > 0.0]).all():
            break
    return image_geometry(flat, pitch=under.pitch)


def contact_image(
    flat: FlatMap,
    pressures: ArrayLike,
    *,
    pitch: float | None = None,
    shape: tuple[int | None, int | None] | None = None,
) -> np.ma.MaskedArray[Any, np.dtype[np.float32]]:
    """Pressures on the flat map as a picture of square pixels, masked where there is no skin.

    Parameters
    ----------
    flat : FlatMap
        Of n taxels.
    pressures : (n,) or (t, n) array-like
        One sample or several, in any unit.
    pitch : float, optional
        Side of a pixel [m]; 8 mm where no shape is given either.
    shape : (rows, columns), optional
        Instead of a pitch: the smallest pitch with which the map fits.

    Returns
    -------
    (rows, columns) or (t, rows, columns) masked array of float32
        In the unit of the pressures; `.filled(0.0)` gives a plain array. Where images are made
        again and again, `skinmap.touch.images.contact_image.image_geometry(flat)` is kept instead.

    Raises
    ------
    SkinMismatchError
        Another number of pressures than taxels.
    InvalidArrayError
        NaN or infinity; a pitch that is not positive, or a grid of more than 2^26 pixels.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("left_hand")
    >>> flat = skinmap.flatten(skinmap.build_surface(skin))
    >>> image = skinmap.contact_image(flat, [100.0] * len(skin), pitch=4e-3)
    >>> round(float(image.max()), 3)
    100.0
    """
    if shape is not None and (not isinstance(shape, tuple | list) or len(shape) != 2):
        raise InvalidArrayError(f"shape must be (rows, columns), got {shape!r}")
    geometry = image_geometry(flat, pitch=pitch, shape=shape)
    several = np.ndim(pressures) == 2
    pixels = geometry.images(pressures) if several else geometry.image(pressures)
    return np.ma.MaskedArray(pixels, np.broadcast_to(~geometry.mask, pixels.shape))


class _Under(NamedTuple):
    """A grid, and the triangle under each of its pixels, as in `ContactImageGeometry`.

    `points` (v, 2) are the vertices of all charts in pixels, `faces` (m, 3) the triangles.
    """

    pitch: float
    shape: tuple[int, int]
    corner: FloatArray
    points: FloatArray
    faces: IntArray
    pixels: IntArray
    taxels: IntArray
    weights: FloatArray


def _under(
    flat: FlatMap, pitch: float | None, shape: tuple[int | None, int | None] | None
) -> _Under:
    uv = np.concatenate([chart.uv for chart in flat.charts])
    faces, taxels = _all_faces(flat)
    low, high = uv.min(axis=0), uv.max(axis=0)
    pitch, (rows, columns) = _grid(high - low, pitch, shape)
    middle, half = 0.5 * (low + high), 0.5 * pitch * np.array([columns, rows])
    corner = np.array([middle[0] - half[0], middle[1] + half[1]])
    points = (uv - corner) / (pitch, -pitch)
    if len(faces):
        pixels, face, weights = locate_pixels(points, faces, (rows, columns))
        vertices = taxels[faces[face]]
    else:  # taxels without a surface: the pixel of each
        at = np.clip(points.astype(np.int64), 0, [columns - 1, rows - 1])
        pixels, first = np.unique(at[:, 1] * columns + at[:, 0], return_index=True)
        vertices = np.repeat(taxels[first, None], 3, axis=1)
        weights = np.tile([1.0, 0.0, 0.0], (len(first), 1))
    return _Under(pitch, (rows, columns), corner, points, faces, pixels, vertices, weights)


def _grid(
    size: FloatArray, pitch: float | None, shape: tuple[int | None, int | None] | None
) -> tuple[float, tuple[int, int]]:
    """Pitch [m] and (rows, columns) of the grid over a map of a size (width, height) [m]."""
    if shape is None or shape == (None, None):
        pitch = PITCH if pitch is None else float(pitch)
    elif pitch is not None or any(n is not None and n < 1 for n in shape):
        raise InvalidArrayError(f"a pitch or a shape of at least 1 x 1, got {pitch} and {shape}")
    else:
        wanted = zip(size[::-1], shape, strict=True)
        pitch = max(float(length) / n for length, n in wanted if n is not None)
    if not (np.isfinite(pitch) and pitch > 0):
        raise InvalidArrayError(f"the pitch must be above 0 m, got {pitch}")
    if pitch > 0.1 and pitch > max(size):
        raise InvalidArrayError(f"a pitch of {pitch} m exceeds the map; is it in millimetres?")
    # A map exactly as wide as its pixels must not need one more for a rounding error.
    fit = np.maximum(np.ceil(size[::-1] / pitch - 1e-9), 1.0)
    given = shape or (None, None)
    rows, columns = (float(n) if n is not None else f for n, f in zip(given, fit, strict=True))
    if rows * columns > PIXELS:
        raise InvalidArrayError(
            f"a grid of {rows:.0f} x {columns:.0f} pixels: choose a wider pitch"
        )
    return pitch, (int(rows), int(columns))


def _all_faces(flat: FlatMap) -> tuple[IntArray, IntArray]:
    """Faces (m, 3) over the vertices of all charts, and the taxel of each of these."""
    counts = [len(chart.taxels) for chart in flat.charts]
    start = np.cumsum([0, *counts[:-1]])
    faces = [chart.faces + first for chart, first in zip(flat.charts, start, strict=True)]
    return np.concatenate(faces), np.concatenate([chart.taxels for chart in flat.charts])


def _merging(representative: IntArray) -> csr_array:
    """(n, n) sparse: each vertex is the mean of the taxels that it stands for."""
    n = len(representative)
    share = 1.0 / np.bincount(representative, minlength=n)[representative]
    return csr_array((share, (representative, np.arange(n))), shape=(n, n))


def _refuse_unusable(values: NDArray[np.generic]) -> None:
    if values.dtype.kind == "f" and values.size and not np.abs(values).max() <= LARGEST:
        where = np.argwhere(~(np.abs(values) <= LARGEST))[0]
        raise InvalidArrayError(
            f"pressures must be finite and below {LARGEST:g}, got {values[tuple(where)]} "
            f"for taxel {where[-1]}"
        )


def _gather_one(pixels: Any, columns: Any, weights: Any, pressures: Any, image: Any) -> bool:
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


def _gather_many(pixels: Any, columns: Any, weights: Any, values: Any, images: Any) -> None:
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


def compiled_gathers() -> tuple[Callable[..., bool], Callable[..., None]] | None:
    """Loops that fill one image, and many at once; None without numba: the matrix does the same."""
    try:
        return compiled(_gather_one), compiled(_gather_many)
    except MissingLibraryError:
        return None


# Contact images as the second paper has them: 256 grey levels, resized to 66 x 100.
#
# A. Albini, S. Denei and G. Cannata, "Human hand recognition from robotic skin measurements in
# human-robot physical interactions", IROS 2017. The grid there is about the pitch of the taxels,
# k = floor(255 p / max P) for the pressures P of all taxels at one moment, and images are resized
# to 66 x 100.

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

"""Checks at the border: they validate, convert and return; the maths inside trusts them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.errors import InvalidArrayError, InvalidMeshError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def _ragged(values: ArrayLike) -> str:
    """Words on the first row that has another length than the rows before; none where all agree."""
    rows = values if isinstance(values, list | tuple) else ()
    counts = [len(row) if isinstance(row, list | tuple | np.ndarray) else -1 for row in rows]
    for row, count in enumerate(counts):
        if count != counts[0]:
            return f"; row {row} has {count} values, row 0 has {counts[0]}"
    return ""


def check_finite(values: ArrayLike, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Convert to float64 of a given shape and refuse NaN and infinity.

    Parameters
    ----------
    values : array-like
        The values to be checked.
    name : str
        How messages call it.
    shape : tuple of int or None
        Wanted shape; None stands for any length.

    Returns
    -------
    array of float
        A C-contiguous float64 array, never a view that the caller could spoil through
        a conversion; the same object where nothing had to change.

    Raises
    ------
    InvalidArrayError
        Wrong shape or type, or a value that is not finite (names the row).
    """
    try:
        if np.iscomplexobj(values):  # numpy would drop half of each number with a mere warning
            raise TypeError
        array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArrayError(
            f"{name} must be numbers of shape {_words(shape)}{_ragged(values)}"
        ) from error
    _check_shape(array, name, shape)
    if not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0, 0])
        raise InvalidArrayError(f"{name} holds NaN or infinity, first in row {row}")
    return array


def check_points(points: ArrayLike, name: str = "points") -> FloatArray:
    """Positions of shape (n, 3) [m], finite.

    Raises
    ------
    InvalidArrayError
        Wrong shape or a value that is not finite.
    """
    return check_finite(points, name, (None, 3))


def check_faces(faces: ArrayLike, n_vertices: int) -> IntArray:
    """Triangles of shape (m, 3) whose indices lie in 0..n_vertices-1.

    Raises
    ------
    InvalidMeshError
        Wrong shape or type, or an index outside (names face and index).
    """
    array = np.asarray(faces)
    if array.size == 0:
        array = array.reshape(0, 3).astype(np.int64)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise InvalidMeshError(
            f"faces must be integers of shape (m, 3), got {array.dtype} {array.shape}"
        )
    outside = (array < 0) | (array >= n_vertices)
    if outside.any():
        face, corner = np.argwhere(outside)[0]
        raise InvalidMeshError(
            f"faces point outside the vertices: face {face} has index {array[face, corner]}, "
            f"vertices are 0..{n_vertices - 1}"
        )
    return np.ascontiguousarray(array, dtype=np.int64)


def check_whole(values: ArrayLike, name: str, shape: tuple[int | None, ...] = (None,)) -> IntArray:
    """Convert to int64 of a given shape; floats count where they are whole.

    Raises
    ------
    InvalidArrayError
        Wrong shape or type, or a value with a fraction, NaN or beyond 2^53.
    """
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "iuf":
        raise InvalidArrayError(f"{name} must be whole numbers, got {array.dtype}")
    if array.dtype.kind == "f":
        finite = check_finite(array, name, shape)
        if ((finite != np.floor(finite)) | (np.abs(finite) > 2**53)).any():
            raise InvalidArrayError(f"{name} must be whole numbers, got {array.dtype}")
    _check_shape(array, name, shape)
    return array.astype(np.int64)


def _check_shape(array: NDArray[Any], name: str, shape: tuple[int | None, ...]) -> None:
    if array.ndim != len(shape) or any(
        want is not None and have != want for have, want in zip(array.shape, shape, strict=True)
    ):
        raise InvalidArrayError(f"{name} must have shape {_words(shape)}, got {array.shape}")


def freeze(obj: object, **arrays: NDArray[Any]) -> None:
    """Set read-only copies of arrays as attributes of a frozen dataclass (in `__post_init__`).

    Of all arrays that it has where none is given.
    """
    if not arrays:
        held = {field.name: getattr(obj, field.name) for field in fields(cast("Any", obj))}
        arrays = {name: value for name, value in held.items() if isinstance(value, np.ndarray)}
    for name, array in arrays.items():
        own = np.array(array)
        own.flags.writeable = False
        object.__setattr__(obj, name, own)


class Frozen:
    """A frozen dataclass none of whose arrays may be written to: they are copies."""

    __slots__ = ()

    def __post_init__(self) -> None:
        freeze(self)


def _words(shape: tuple[int | None, ...]) -> str:
    letters = iter("nmk")
    inner = ", ".join(str(size) if size is not None else next(letters) for size in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"

"""Files of mounts and responses: touches with wrenches and samples in, taxels and mounts out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.files.tables import read_numbers
from skinmap.archive import open_arrays, quiet_headers
from skinmap.arrays import FloatArray, IntArray, check_whole
from skinmap.errors import DAMAGED_ARCHIVE, DataFormatError, InvalidArrayError
from skinmap.io.text import check_file

WRENCH = ("points", "frames", "forces", "moments")


@dataclass(frozen=True, eq=False, slots=True)
class WrenchTouches:
    """Touches with wrenches; taxels (n, 3) of the patch where there are any."""

    points: FloatArray
    frames: FloatArray
    forces: FloatArray
    moments: FloatArray
    taxels: FloatArray | None


def read_arrays(path: Path, expected: str) -> dict[str, NDArray[Any]]:
    """The arrays of an `.npz` file; of an `.npy` or `.csv` file, one called "samples".

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not a file of plain arrays; a row of a `.csv` that has another number of
        channels (names the line).
    """
    check_file(path, expected, most_bytes=2**32)
    if path.suffix.lower() == ".csv":
        return {"samples": read_numbers(path, None)}
    if path.suffix.lower() != ".npy":
        with open_arrays(path, expected) as arrays:
            return {name: arrays[name] for name in arrays.files}
    try:
        with path.open("rb") as file, quiet_headers():
            return {"samples": np.asarray(np.lib.format.read_array(file, allow_pickle=False))}
    except DAMAGED_ARCHIVE as error:
        raise DataFormatError(f"not {expected}: {error}", path) from error


def active_by_event(arrays: Mapping[str, NDArray[Any]], name: str, m: int) -> list[IntArray]:
    """What was active in each of m events: `ids_NAME`, cut at `ptr_NAME (m + 1,)`.

    Raises
    ------
    InvalidArrayError
        No `ptr_NAME`, or one that does not rise from 0 to the number of ids in m steps.
    """
    if f"ptr_{name}" not in arrays:
        raise InvalidArrayError(f"lacks ptr_{name}, the start of each event in ids")
    ids = check_whole(arrays[f"ids_{name}"], f"ids_{name}")
    bounds = check_whole(arrays[f"ptr_{name}"], f"ptr_{name}")
    if bounds.shape != (m + 1,) or bounds[0] != 0 or bounds[-1] != len(ids):
        raise InvalidArrayError(
            f"ptr_{name} must rise from 0 to {len(ids)} in {m} steps, got shape {bounds.shape}"
        )
    if (np.diff(bounds) < 0).any():
        raise InvalidArrayError(f"ptr_{name} falls at {int(np.argmax(np.diff(bounds) < 0))}")
    return np.split(ids, bounds[1:-1])


def read_wrenches(path: Path, unit: float = 1.0) -> WrenchTouches:
    """Touches with wrenches from an `.npz` file.

    Arrays `points (m, 3)`, `frames (m, 4, 4)`, `forces`, `moments`, and perhaps `taxels (n, 3)`.
    Lengths are in `unit` metres, moments in newton times it.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or an array is missing or not of numbers.
    """
    check_file(path, "touches with wrenches (.npz)", most_bytes=2**32)
    with open_arrays(path, "touches with wrenches (.npz)") as archive:
        arrays = {name: archive[name] for name in archive.files}
    _need(arrays, WRENCH, path)
    try:
        with np.errstate(over="raise", invalid="raise"):  # of longer floats than ours, of no number
            found = {name: _real(arrays[name]) for name in arrays}
        found["frames"][..., :3, 3] *= unit
    except (ValueError, TypeError, IndexError, FloatingPointError) as error:
        raise DataFormatError(f"arrays must be numbers: {error}", path) from error
    own = found.get("taxels")
    if own is not None and (own.ndim != 2 or own.shape[1] != 3):
        raise DataFormatError(f"taxels must have shape (n, 3), got {own.shape}", path)
    return WrenchTouches(
        found["points"] * unit,
        found["frames"],
        found["forces"],
        found["moments"] * unit,
        None if own is None else own * unit,
    )


def _real(values: NDArray[Any]) -> FloatArray:
    if values.dtype.kind == "c":
        raise ValueError("complex ones came")
    found = np.array(values, np.float64)
    found[np.isnan(found)] = np.nan  # those that stop a machine at the first sum become quiet
    return found


def read_samples(path: Path, names: tuple[str, ...] = ("samples",)) -> dict[str, NDArray[Any]]:
    """Samples (t, n), and loads of the same shape where they are asked for.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or it lacks one of the arrays.
    """
    arrays = read_arrays(path, f"samples (.npy, or .npz with {', '.join(names)})")
    _need(arrays, names, path)
    return arrays


def rate_of(arrays: Mapping[str, NDArray[Any]], path: Path) -> float | None:
    """Samples a second by the arrays `rate` or `times (t,)` [s]; None where there is neither.

    Raises
    ------
    DataFormatError
        Not one positive number, or times that do not rise.
    """
    if "rate" in arrays:
        rate = np.asarray(arrays["rate"], np.float64).ravel()
    elif "times" in arrays:
        steps = np.diff(np.asarray(arrays["times"], np.float64).ravel())
        rate = 1.0 / np.median(steps, keepdims=True) if (steps > 0).all() else np.zeros(1)
    else:
        return None
    if len(rate) != 1 or not (np.isfinite(rate[0]) and rate[0] > 0):
        raise DataFormatError("`rate` must be one number above 0, and `times` must rise [s]", path)
    return float(rate[0])


def sign_of(arrays: Mapping[str, NDArray[Any]], path: Path) -> int:
    """1, or -1 where the array `sign` says that harder presses read lower.

    Raises
    ------
    DataFormatError
        Another sign.
    """
    sign = np.asarray(arrays.get("sign", 1)).ravel().tolist()
    if sign not in ([1], [-1]):
        raise DataFormatError(f"`sign` must be 1 or -1, got {str(sign)[:60]}", path)
    return int(sign[0])


def _need(arrays: Mapping[str, NDArray[Any]], names: tuple[str, ...], path: Path) -> None:
    """Refuse arrays that lack some."""
    lacks = [name for name in names if name not in arrays]
    if lacks:
        raise DataFormatError(
            f"lacks {', '.join(lacks)}; the arrays are: {', '.join(arrays) or 'none'}", path
        )


def write_mounts(mounts: dict[str, Any], path: Path) -> str:
    """Write mounts T_link_patch [m] and what belongs to them, with full digits; the file's name."""
    kept = {"format": "skinmap-mounts-1", **mounts}
    text = json.dumps(kept, indent=2, allow_nan=False, default=np.ndarray.tolist)
    path.write_text(text + "\n", encoding="utf-8")
    return path.name

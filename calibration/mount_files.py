"""Files of mounts and responses: touches with wrenches and samples in, taxels and mounts out."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.tables import ENTRIES
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DAMAGED_ARCHIVE, DataFormatError, InvalidArrayError
from skinmap.io.table import COLUMNS, COVARIANCE
from skinmap.io.text import check_file

WRENCH = ("points", "frames", "forces", "moments")


@dataclass(frozen=True, eq=False, slots=True)
class WrenchTouches:
    """Touches with wrenches, and the taxels (n, 3) of the patch where the file has them."""

    points: FloatArray
    frames: FloatArray
    forces: FloatArray
    moments: FloatArray
    taxels: FloatArray | None


def read_arrays(path: Path, expected: str) -> dict[str, NDArray[Any]]:
    """The arrays of an `.npz` file; of an `.npy` file, one called "samples".

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not a file of plain arrays.
    """
    check_file(path, expected, most_bytes=2**32)
    try:
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                return {"samples": loaded}
            with loaded:
                return {name: loaded[name] for name in loaded.files}
    except DAMAGED_ARCHIVE as error:
        raise DataFormatError(f"not {expected}: {error}", path) from error


def read_wrenches(path: Path, unit: float = 1.0) -> WrenchTouches:
    """Arrays `points (m, 3)`, `frames (m, 4, 4)`, `forces`, `moments`, and perhaps `taxels (n, 3)`.

    Lengths are in `unit` metres, moments in newton times it.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or an array is missing or not of numbers.
    """
    arrays = read_arrays(path, "touches with wrenches (.npz)")
    _need(arrays, WRENCH, path)
    try:
        found = {name: np.array(arrays[name], np.float64) for name in arrays}
        found["frames"][..., :3, 3] *= unit
    except (ValueError, TypeError, IndexError) as error:
        raise DataFormatError(f"arrays must be numbers: {error}", path) from error
    taxels = found["taxels"] * unit if "taxels" in found else None
    if taxels is not None and (taxels.ndim != 2 or taxels.shape[1] != 3):
        raise DataFormatError(f"taxels must have shape (n, 3), got {taxels.shape}", path)
    return WrenchTouches(
        found["points"] * unit, found["frames"], found["forces"], found["moments"] * unit, taxels
    )


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


def _need(arrays: dict[str, NDArray[Any]], names: tuple[str, ...], path: Path) -> None:
    lacks = [name for name in names if name not in arrays]
    if lacks:
        raise DataFormatError(
            f"lacks {', '.join(lacks)}; there is: {', '.join(arrays) or 'nothing'}", path
        )


def write_taxels(
    channels: IntArray, positions: FloatArray, covariance: FloatArray, path: Path
) -> None:
    """Write our taxel table with covariances [m2]; normals are zero, they are not calibrated."""
    if not len(channels) == len(positions) == len(covariance):
        raise InvalidArrayError("as many channels as positions and covariances are needed")
    lines = [",".join((*COLUMNS, *COVARIANCE))]
    for channel, place, own in zip(channels.tolist(), positions, covariance, strict=True):
        numbers = (*place, 0.0, 0.0, 0.0, *(own[entry] for entry in ENTRIES))
        lines.append(f"{channel},0,{','.join(repr(float(value)) for value in numbers)}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_mounts(mounts: dict[str, Any], path: Path) -> None:
    """Write mounts T_link_patch [m] and what belongs to them as JSON with full digits."""
    text = {"format": "skinmap-mounts-1", **_lists(mounts)}
    path.write_text(json.dumps(text, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _lists(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _lists(item) for key, item in value.items()}
    return value.tolist() if hasattr(value, "tolist") else value

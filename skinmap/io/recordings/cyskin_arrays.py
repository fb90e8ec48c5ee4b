"""CySkin recordings as arrays (`.npz`) beside the skin that they were made on (`.json`).

    values (t, c)       raw counts, larger where pressed
    taxel_ids (c,)      id of each column
    times or time (t,)  [s], beginning anew in each file where several were joined
    file_index (t,)     file that each sample is of; one file where it is missing
    file_class (f,)     number of fingers that touched in each file, where that was noted
    hand (t,)           1 for samples of a hand, 0 for those of something else, where that was noted

Nothing of the rest is in it: what each taxel reads at the 25th percentile over a file is its rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.archive import read_arrays
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, MissingFileError
from skinmap.io.taxels.cyskin import columns_of, read_cyskin_taxels
from skinmap.io.text import check_file, in_file
from skinmap.skin.skin import Skin, skin_from_points

SATURATION = 20_002.0  # raw value at which a taxel of these skins says no more
COUNTS = 255.0
REST_SHARE = 25.0  # percentile over time that is rest: touches are short
MAX_BYTES = 2**30


@dataclass(frozen=True, eq=False, slots=True)
class PressedSkin:
    """A skin of n taxels and what was recorded on it.

    Attributes
    ----------
    skin : Skin
    files : tuple of (t, n) uint8
        Pressures above each file's own rest [counts]; 0 for taxels without a column.
    times : tuple of (t,) float
        [s].
    classes : (f,) int or None
        Number of fingers of each file.
    unplaced, unrecorded : int
        Columns without a taxel, and taxels without a column.
    """

    skin: Skin
    files: tuple[NDArray[np.uint8], ...]
    times: tuple[FloatArray, ...]
    classes: IntArray | None
    unplaced: int
    unrecorded: int


def read_pressed(arrays: Path, patch: Path) -> PressedSkin:
    """Read one archive of samples and the CySkin file of its skin.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no archive, an array that is missing, of another length, or not of finite
        numbers, or a recording of another skin (no column has a place).
    """
    check_file(arrays, "an archive of samples (.npz)", MAX_BYTES)
    table = read_cyskin_taxels(patch)
    held = {name: _numbers(array, name, arrays) for name, array in read_arrays(arrays).items()}
    for name in ("values", "taxel_ids"):
        if name not in held:
            there = ", ".join(sorted(held)) or "none"
            raise DataFormatError(f"no array {name!r}; its arrays: {there}", arrays)
    values, ids = held["values"], held["taxel_ids"]
    if values.ndim != 2 or len(values) == 0 or ids.shape != values.shape[1:]:
        raise DataFormatError(
            f"values of shape {values.shape}, taxel_ids {ids.shape}; one column each", arrays
        )
    columns, unplaced, _ = columns_of(ids.astype(np.int64), table)
    if not (columns >= 0).any():
        raise DataFormatError(f"none of its taxel_ids is in {patch.name}: another skin", arrays)
    with in_file(patch):
        skin = skin_from_points(table.positions, table.normals, part=patch.stem)
    raw = np.where(columns >= 0, values[:, columns], 0.0)
    count = len(raw)
    times = _each(held, "times" if "times" in held else "time", count, arrays, np.arange(count))
    rows = _files(_each(held, "file_index", count, arrays, np.zeros(count)), arrays)
    classes = held.get("file_class")
    if classes is not None and (classes.shape != (len(rows),) or (classes < 0).any()):
        raise DataFormatError(
            f"file_class of shape {classes.shape} for {len(rows)} files; 0 or more each", arrays
        )
    return PressedSkin(
        skin,
        tuple(above_rest(raw[own]) for own in rows),
        tuple(times[own] for own in rows),
        None if classes is None else classes.astype(np.int64),
        len(unplaced),
        int((columns < 0).sum()),
    )


def above_rest(raw: FloatArray) -> NDArray[np.uint8]:
    """Pressures (t, n) of 0 to 255 counts: raw values (t, n) less each taxel's own rest."""
    pressed = np.clip(raw - np.percentile(raw, REST_SHARE, axis=0), 0.0, SATURATION)
    return np.rint(pressed * (COUNTS / SATURATION)).astype(np.uint8)


def _numbers(array: NDArray[Any], name: str, path: Path) -> NDArray[Any]:
    if array.dtype.kind not in "buif" or not np.isfinite(array).all():
        raise DataFormatError(f"{name} must hold finite numbers", path)
    return np.asarray(array, np.float64)


def _each(
    held: dict[str, NDArray[Any]], name: str, count: int, path: Path, default: NDArray[Any]
) -> FloatArray:
    """(count,) a number of each sample."""
    array = np.asarray(held.get(name, default), np.float64)
    if array.shape != (count,):
        raise DataFormatError(f"{name} of shape {array.shape} for {count} samples", path)
    return array


def _files(number: FloatArray, path: Path) -> list[NDArray[np.bool_]]:
    """Samples of each file, in the order of their numbers."""
    names = np.unique(number)
    if not np.array_equal(names, np.arange(len(names))):
        raise DataFormatError("file_index must count 0, 1, 2, ... without a gap", path)
    return [number == one for one in names]


def find_pressed(folder: Path, kind: str, place: str) -> tuple[Path, Path]:
    """The archive and the skin of one kind of recordings in a folder.

    They stand in the folder or in a sub-folder of it; `fingers.npz` beside or above the JSON of
    its patch, say. A skin of the sub-folder comes before those of the folder.

    Parameters
    ----------
    folder : Path
    kind : str
        Name of the archives, such as `fingers*.npz`.
    place : str
        Sub-folder that may hold them, or the skin.

    Raises
    ------
    MissingFileError, DataFormatError
        None of a kind, or several skins.
    """
    if not folder.is_dir():
        raise MissingFileError(folder, f"a folder with {kind} and a CySkin file (.json)")
    where = [one for one in (folder, folder / place) if one.is_dir()]
    archives = [path for one in where for path in sorted(one.glob(kind))]
    if not archives:
        raise MissingFileError(folder / kind, f"samples there or in {place}/")
    found = [sorted(one.glob("*.json")) for one in reversed(where)]
    skins = next((own for own in found if own), [])  # the sub-folder's before those above it
    if not skins:
        raise MissingFileError(
            folder / "*.json", f"the CySkin file of the skin there or in {place}/"
        )
    if len(skins) > 1:
        names = ", ".join(str(path.relative_to(folder)) for path in skins[:3])
        raise DataFormatError(f"{len(skins)} skins ({names}): leave the one recorded on", folder)
    return archives[0], skins[0]

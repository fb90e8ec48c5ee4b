"""Module layouts: where the slots of one rigid board are, and which of them feel touch.

The built-in ones are the iCub's 10-pad (version 2) and the 12-pad of RoboSkin, as their position
files have them, and a nominal 11-pad of the Baxter forearm. The origin is the module's centre,
seen from outside, so that the order of the slots tells which way is out.
"""

from __future__ import annotations

import csv
import io
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, check_finite, freeze
from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError, UnknownNameError
from skinmap.geometry.proximity import median_spacing

MAX_BYTES = 2**20  # the largest board has some tens of slots
# What strange content comes to: deep nests, numbers that no float holds and cells without end too.
NO_LAYOUT = (
    ValueError, TypeError, KeyError, IndexError, OverflowError, RecursionError, csv.Error, OSError,
)  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class ModuleLayout:
    """One board.

    Attributes
    ----------
    name : str
    xy : (k, 2) float
        Place of each slot [m].
    thermal : (k,) bool
        Slots that measure temperature and no touch.
    centre : int
        Slot that stands for the module where a file gives one place for several slots.
    side : float or None
        Edge of the triangular board [m], where it is one.
    """

    name: str
    xy: FloatArray
    thermal: BoolArray
    centre: int
    side: float | None = None

    def __post_init__(self) -> None:
        xy = check_finite(self.xy, "xy", (None, 2))
        thermal = np.asarray(self.thermal, bool)
        if thermal.shape != (len(xy),) or not 0 <= self.centre < len(xy):
            raise InvalidArrayError(
                f"layout {self.name!r}: {len(xy)} slots, {len(thermal)} thermal flags, "
                f"centre {self.centre}"
            )
        if (~thermal).sum() < 3:
            raise InvalidArrayError(f"layout {self.name!r} has fewer than three tactile slots")
        freeze(self, xy=xy, thermal=thermal)

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def tactile(self) -> FloatArray:
        """(t, 2) places of the slots that feel touch [m]."""
        return np.asarray(self.xy[~self.thermal])

    @property
    def pitch(self) -> float:
        """Median distance of tactile slots to their nearest tactile slot [m]."""
        return median_spacing(self.tactile)


def _millimetres(
    name: str,
    places: list[tuple[float, float]],
    thermal: tuple[int, ...],
    side: float,
    centre: int = 3,
) -> ModuleLayout:
    flags = np.isin(np.arange(len(places)), thermal)
    return ModuleLayout(name, 1e-3 * np.array(places), flags, centre, 1e-3 * side)


BUILTIN = {
    layout.name: layout
    for layout in (
        _millimetres(
            "triangle_10pad",
            [
                (6.533, 0), (9.800, -5.660), (3.267, -5.660), (0, 0), (-3.267, -5.660),
                (-9.800, -5.660), (-6.533, -3.750), (-6.533, 0), (-3.267, 5.660), (0, 11.317),
                (0, 7.507), (3.267, 5.660),
            ],
            (6, 10),
            33.46,
        ),
        _millimetres(
            "triangle_12pad",
            [
                (7.5, -1.443), (10, -5.774), (5, -5.774), (0, -2.887), (-5, -5.774),
                (-10, -5.774), (-7.5, -1.443), (-2.5, 1.443), (-2.5, 7.217), (0, 11.547),
                (2.5, 7.217), (2.5, 1.443),
            ],
            (),
            30.0,
        ),
        # Nominal: published are the count, the side of 30 mm and the pitch of 8 mm, no places.
        # These are the eleven points of a triangle that lie furthest apart, at that pitch.
        _millimetres(
            "triangle_11pad",
            [
                (-14.53, -8.39), (0, -8.39), (14.53, -8.39), (-7.26, -5.04),
                (7.26, -5.04), (0, 2.88), (-8, 2.93), (8, 2.93),
                (-3.99, 9.85), (3.99, 9.85), (0, 16.78),
            ],
            (),
            30.0,
            5,
        ),
    )
}  # fmt: skip


def module_layout(name: str, folder: Path = Path()) -> ModuleLayout:
    """A layout by built-in name, or from a user's `.toml` or `.csv` file.

    Raises
    ------
    UnknownNameError
        A name that is neither built in nor a file of those kinds.
    MissingFileError, DataFormatError
        A file that does not exist or is no layout.
    """
    if name in BUILTIN:
        return BUILTIN[name]
    path = folder / name
    if path.suffix not in (".toml", ".csv"):
        raise UnknownNameError("module layout (or a .toml or .csv file)", name, BUILTIN)
    if not path.is_file():
        raise MissingFileError(path, "a module layout")
    if path.stat().st_size > MAX_BYTES:
        raise DataFormatError(f"more than {MAX_BYTES >> 20} MB: no module layout", path)
    try:
        text = path.read_text(encoding="utf-8")
        rows, centre, side = _read_toml(text) if path.suffix == ".toml" else _read_csv(text)
        places = np.array([[row[0], row[1]] for row in rows], float) * 1e-3
        thermal = np.array([bool(row[2]) for row in rows])
        return ModuleLayout(path.stem, places, thermal, centre, side)
    except NO_LAYOUT as error:
        raise DataFormatError(f"not a module layout: {error}", path) from error


Rows = list[tuple[float, float, bool]]


def _read_toml(text: str) -> tuple[Rows, int, float | None]:
    """`slots_mm = [[x, y], ...]`, and optional `thermal = [slot, ...]`, `centre`, `side_mm`."""
    document = tomllib.loads(text)
    thermal = set(document.get("thermal", []))
    rows = [(float(x), float(y), i in thermal) for i, (x, y) in enumerate(document["slots_mm"])]
    side = document.get("side_mm")
    return rows, int(document.get("centre", 0)), None if side is None else 1e-3 * float(side)


def _read_csv(text: str) -> tuple[Rows, int, float | None]:
    """Columns `slot,x_mm,y_mm,thermal` with thermal 0 or 1, slots in order from 0."""
    rows = list(csv.DictReader(io.StringIO(text)))
    if [int(row["slot"]) for row in rows] != list(range(len(rows))):
        raise ValueError("slots must run 0, 1, 2, ... in order")
    return [(float(r["x_mm"]), float(r["y_mm"]), r["thermal"] == "1") for r in rows], 0, None

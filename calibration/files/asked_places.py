"""Places of requested touches: a CSV with a row for each point."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from calibration.files.tables import read_cells
from skinmap.arrays import FloatArray
from skinmap.errors import DataFormatError, MissingFileError
from skinmap.geometry.proximity import median_spacing
from skinmap.io.text import is_file, parse_floats

COLUMNS = ("touch", "x", "y", "z")
TIMES = ("start_s", "end_s")
FAR = 30e-3  # from the nearest taxel: no place on this skin [m]


@dataclass(frozen=True, eq=False, slots=True)
class AskedPlace:
    """Where one touch was asked for.

    Attributes
    ----------
    number : int
        As the file counts it.
    path : (p, 3) float
        [m].
    span : (float, float) or None
        When it was made, in the recording's clock [s].
    """

    number: int
    path: FloatArray
    span: tuple[float, float] | None


def read_places(path: Path, part: str) -> list[AskedPlace]:
    """The places of one part, in the order of their numbers.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not `touch,x,y,z` with perhaps `part`, `start_s` and `end_s`.
    """
    if not is_file(path):
        raise MissingFileError(path, f"places: CSV {','.join(COLUMNS)}[,part][,start_s,end_s]")
    names, table = read_cells(path, COLUMNS, (*TIMES, "part"))
    timed = [name in names for name in TIMES]
    if any(timed) != all(timed):
        raise DataFormatError(f"expected both of {','.join(TIMES)}, or neither", path, 1)
    wanted = [names.index(name) for name in (*COLUMNS, *(TIMES if all(timed) else ()))]
    on = names.index("part") if "part" in names else None
    found: dict[int, array[float]] = {}
    for line, row in table:
        if on is not None and row[on].strip() != part:
            continue
        numbers = parse_floats([row[place] for place in wanted], path, line)
        if numbers[0] != int(numbers[0]):
            raise DataFormatError(f"touch {row[wanted[0]]!r} is not a whole number", path, line)
        found.setdefault(int(numbers[0]), array("d")).extend(numbers[1:])
    if not found:
        raise DataFormatError(f"no place on {part!r}", path)
    places = []
    for number, values in sorted(found.items()):
        rows = np.array(values).reshape(-1, len(wanted) - 1)
        span = (float(rows[0, 3]), float(rows[0, 4])) if all(timed) else None
        places.append(AskedPlace(number, rows[:, :3], span))
    return places


def check_places(places: list[AskedPlace], positions: FloatArray, part: str, path: Path) -> None:
    """Refuse places that are not on a skin.

    Raises
    ------
    DataFormatError
        Says which touch, and how far off it is.
    """
    limit = max(FAR, 3.0 * median_spacing(positions))
    skin = cKDTree(positions)
    for place in places:
        away, _ = skin.query(place.path)
        if float(away.max()) > limit:
            raise DataFormatError(
                f"touch {place.number} is {1e3 * float(away.max()):.0f} mm from the nearest taxel "
                f"of {part!r}: another part's place, or not in metres", path,
            )  # fmt: skip

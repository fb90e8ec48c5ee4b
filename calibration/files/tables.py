"""Tables that come in (boards, anchors, touches) and go out (calibrated taxels).

Places of requested touches: a CSV with a row for each point.
"""

from __future__ import annotations

import io
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from calibration.patch.placing import Touch
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, MissingFileError
from skinmap.geometry.proximity import median_spacing
from skinmap.io.robots.mesh_file import MESH_SUFFIXES, read_mesh
from skinmap.io.taxels.taxel_table import COLUMNS, COVARIANCE
from skinmap.io.text import MAX_CHANNEL, csv_rows, is_file, parse_floats, read_text

CHANNEL = ("channel", "taxel")  # how a first column may be called
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
MAX_ANCHORS = 100_000  # measured one by one: a table of more is another table
IGNORED = ("z", "nx", "ny", "nz")  # of a board in our own taxel format: it is flat


@dataclass(frozen=True, eq=False, slots=True)
class BoardTable:
    """A board: channels (n,), modules (n,) and its flat layout (n, 2) [m], seen from outside."""

    channels: IntArray
    modules: IntArray
    layout: FloatArray

    @property
    def rigid_modules(self) -> IntArray | None:
        """The modules (n,), where the board is made of more than one; else it is one sheet."""
        return self.modules if len(np.unique(self.modules)) > 1 else None

    def rows(self, given: FloatArray, path: Path, lines: Sequence[int]) -> IntArray:
        """Rows of the board with some channels; an error names the line of a missing one."""
        where = {int(channel): row for row, channel in enumerate(self.channels)}
        channels = _whole(given, lines, path)
        for channel, line in zip(channels.tolist(), lines, strict=True):
            if channel not in where:
                raise DataFormatError(
                    f"the board has no taxel {channel}, it has {len(self.channels)} of "
                    f"{self.channels.min()}..{self.channels.max()}",
                    path,
                    line,
                )
        return np.array([where[channel] for channel in channels.tolist()], np.int64)


@dataclass(frozen=True, slots=True)
class Anchor:
    """One taxel whose place is known, in the unit of its file.

    Attributes
    ----------
    taxel : int
        Row of the board.
    point : (x, y, z)
        In the frame of the mesh.
    sigma : float or None
        Standard deviation of each coordinate; None where the file does not say.
    """

    taxel: int
    point: tuple[float, float, float]
    sigma: float | None = None


def read_board(path: Path, unit: float = 1.0) -> BoardTable:
    """A flat board: `channel,x,y`, with `module` where it is known.

    Our own taxel tables do as well; their heights and normals are left aside.

    Raises
    ------
    DataFormatError
        A missing or unknown column, a word that is not a number, a channel that comes twice.
    """
    column, lines = read_table(path, ("x", "y"), ("module", *IGNORED))
    modules = _whole(column.get("module", np.zeros(len(lines))), lines, path)
    layout = np.column_stack([column["x"], column["y"]]) * unit
    return BoardTable(check_channels(column["channel"], lines, path), modules, layout)


def read_anchor_table(path: Path, board: BoardTable) -> list[Anchor]:
    """Anchors of a file `channel,x,y,z[,sigma]`, in its own unit.

    Raises
    ------
    DataFormatError
        A missing or unknown column, a word that is not a number, a taxel that the board lacks
        (names the line), more than `MAX_ANCHORS`.
    """
    column, lines = read_table(path, ("x", "y", "z"), ("sigma",))
    taxels = board.rows(column["channel"], path, lines).tolist()
    if len(taxels) > MAX_ANCHORS:
        raise DataFormatError(f"{len(taxels)} anchors, expected at most {MAX_ANCHORS}", path)
    points = zip(*(column[name].tolist() for name in "xyz"), strict=True)
    spread = column["sigma"].tolist() if "sigma" in column else [None] * len(taxels)
    return [Anchor(*one) for one in zip(taxels, points, spread, strict=True)]


def write_anchor_table(anchors: Sequence[Anchor], board: BoardTable, path: Path) -> None:
    """Write what `read_anchor_table` reads, with all digits."""
    stated = all(anchor.sigma is not None for anchor in anchors)
    lines = ["channel,x,y,z,sigma" if stated else "channel,x,y,z"]
    for anchor in anchors:
        numbers = (*anchor.point, anchor.sigma) if stated else anchor.point
        lines.append(f"{board.channels[anchor.taxel]},{','.join(map(repr, numbers))}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_placed(path: Path, unit: float = 1.0) -> tuple[IntArray, FloatArray, FloatArray]:
    """Taxels `channel,x,y,z[,sigma]`: channels (n,), places (n, 3), sigmas (n,) or 0 [m].

    Raises
    ------
    DataFormatError
        A missing or unknown column, a word that is not a number, a channel that comes twice.
    """
    column, lines = read_table(path, ("x", "y", "z"), ("module", "nx", "ny", "nz", "sigma"))
    _whole(column.get("module", np.zeros(len(lines))), lines, path)
    channels = check_channels(column["channel"], lines, path)
    sigma = column.get("sigma", np.zeros(len(lines)))
    return channels, np.column_stack([column[name] for name in "xyz"]) * unit, sigma * unit


def read_touches(
    path: Path, board: BoardTable, unit: float = 1.0, *, sigma: float = 1e-3
) -> list[Touch]:
    """Touches `touch,x,y,z,channel,value[,sigma]`: a row for each channel that felt one.

    Rows of one number `touch` belong together and repeat the probe's place; the touches come in
    the order of their numbers.

    Raises
    ------
    DataFormatError
        A missing column, a channel that the board lacks, a touch with two places (says which
        line).
    """
    needed = ("x", "y", "z", "channel", "value")
    column, lines = read_table(path, needed, ("sigma",), first=("touch",))
    _whole(column["touch"], lines, path)
    rows = board.rows(column["channel"], path, lines)
    points = np.column_stack([column[name] for name in "xyz"]) * unit
    spread = column["sigma"] * unit if "sigma" in column else np.full(len(lines), sigma)
    touches = []
    order = np.argsort(column["touch"], kind="stable")
    numbers, begins = np.unique(column["touch"][order], return_index=True)
    for number, own in zip(numbers, np.split(order, begins[1:]), strict=True):
        apart = (points[own] != points[own[0]]).any(axis=1)
        if apart.any():
            line = lines[int(own[np.argmax(apart)])]
            raise DataFormatError(f"touch {number:.0f} has two places", path, line)
        touches.append(
            Touch(points[own[0]], float(spread[own[0]]), rows[own], column["value"][own])
        )
    return touches


def read_table(
    path: Path, needed: Sequence[str], known: Sequence[str], first: Sequence[str] = CHANNEL
) -> tuple[dict[str, FloatArray], list[int]]:
    """Columns (n,) by their names, the first by its first name, and the line of each row.

    Raises
    ------
    DataFormatError
        A missing or unknown column, a row of another length, a word that is not a number.
    """
    names, rows = read_cells(path, needed, known, first)
    values, lines = array("d"), []  # a word takes ten times the memory of its number
    for line, row in rows:
        values.extend(parse_floats(row, path, line))
        lines.append(line)
    table = np.array(values).reshape(len(lines), len(names))
    return dict(zip((first[0], *names[1:]), table.T, strict=True)), lines


def read_cells(
    path: Path, needed: Sequence[str], known: Sequence[str], first: Sequence[str] = ()
) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
    """Names of the columns of a CSV table, and line and words of each row, one after the other.

    Parameters
    ----------
    path : Path
    needed, known : sequence of str
        Columns that there must and may be.
    first : sequence of str
        How the first column may be called, where it must come first.

    Raises
    ------
    DataFormatError
        A missing or unknown column; and where it is come to, a row of another length, no row.
    """
    table = csv_rows(read_text(path), path)
    names = [cell.strip().lower() for cell in next(table, (1, list[str]()))[1]]
    others = names[1:] if first and names and names[0] in first else names
    if (
        set(needed) - set(others)
        or set(others) - {*needed, *known}
        or len(set(names)) < len(names)
        or (first and others is names)
    ):
        raise DataFormatError(
            f"expected the columns {','.join((*first[:1], *needed))} and perhaps "
            f"{','.join(known)}, got {','.join(names)[:200]!r}",
            path,
            1,
        )

    def rows() -> Iterator[tuple[int, list[str]]]:
        some = False
        for line, row in table:
            if row and len(row) != len(names):
                raise DataFormatError(f"expected {len(names)} columns, got {len(row)}", path, line)
            if row:
                some = True
                yield line, row
        if not some:
            raise DataFormatError("the table has no row", path, 1)

    return names, rows()


def check_channels(given: FloatArray, lines: Sequence[int], path: Path) -> IntArray:
    """Channels (n,), each once; an error names the line of a repeated one."""
    channels = _whole(given, lines, path)
    _, first, count = np.unique(channels, return_index=True, return_counts=True)
    if (count > 1).any():
        channel = channels[first[count > 1][0]]
        second = int(np.flatnonzero(channels == channel)[1])
        raise DataFormatError(f"channel {channel} comes more than once", path, lines[second])
    return channels


def _whole(values: FloatArray, lines: Sequence[int], path: Path) -> IntArray:
    """Channels or modules (n,) as whole numbers."""
    wrong = (values != np.floor(values)) | (values < 0) | (values > MAX_CHANNEL)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise DataFormatError(
            f"channels and modules are whole numbers from 0, got {values[row]:g}", path, lines[row]
        )
    return values.astype(np.int64)


def write_taxels(
    channels: IntArray,
    positions: FloatArray,
    covariance: FloatArray,
    path: Path,
    *,
    modules: IntArray | None = None,
    normals: FloatArray | None = None,
) -> str:
    """Write our taxel table with the covariance (n, 3, 3) of each position in six more columns.

    Modules and normals are 0 where they are not known. Returns the file's name.
    """
    modules = np.zeros(len(channels), np.int64) if modules is None else modules
    normals = np.zeros_like(positions) if normals is None else normals
    spread = [covariance[:, row, column] for row, column in ENTRIES]
    numbers = np.column_stack([positions, normals, *spread])
    lines = [",".join((*COLUMNS, *COVARIANCE))]
    for channel, module, own in zip(channels, modules, numbers.tolist(), strict=True):
        lines.append(f"{channel},{module},{','.join(map(repr, own))}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path.name


def read_points(path: Path) -> FloatArray:
    """Points (m, 3) of a scan: CSV `x,y,z`, or the vertices of a mesh file, in its own units."""
    if path.suffix.lower() in MESH_SUFFIXES:
        return read_mesh(path)[0]
    return read_numbers(path, ("x", "y", "z"))


def read_numbers(path: Path, columns: Sequence[str] | None) -> FloatArray:
    """A table of numbers with these columns; a matrix of any size without a header if None.

    Raises
    ------
    DataFormatError
        Another header, rows of different lengths, a word that is not a number (names the line).
    """
    texts = enumerate(io.StringIO(read_text(path), newline=None), start=1)
    lines = ((line, text) for line, text in texts if text.strip())
    width = None
    if columns is not None:
        _, text = next(lines, (0, ""))
        if tuple(cell.strip() for cell in text.split(",")) != tuple(columns):
            raise DataFormatError(f"expected the header {','.join(columns)}", path, 1)
        width = len(columns)
    values = array("d")
    for line, text in lines:
        row = parse_floats(text.split(","), path, line)
        width = len(row) if width is None else width
        if len(row) != width:
            raise DataFormatError(f"expected {width} columns, got {len(row)}", path, line)
        values.extend(row)
    if not values or width is None:
        raise DataFormatError("the table has no row", path, 1)
    return np.array(values).reshape(-1, width)


PLACED = ("touch", "x", "y", "z")
SPAN = ("start_s", "end_s")
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
        raise MissingFileError(path, f"places: CSV {','.join(PLACED)}[,part][,start_s,end_s]")
    names, table = read_cells(path, PLACED, (*SPAN, "part"))
    timed = [name in names for name in SPAN]
    if any(timed) != all(timed):
        raise DataFormatError(f"expected both of {','.join(SPAN)}, or neither", path, 1)
    wanted = [names.index(name) for name in (*PLACED, *(SPAN if all(timed) else ()))]
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

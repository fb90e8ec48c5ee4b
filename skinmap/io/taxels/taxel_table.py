"""Our own taxel table: CSV with the columns `channel,module,x,y,z,nx,ny,nz`, metres.

Columns go by their names; others are left aside. Only x, y and z are needed: without a channel
taxels are numbered by row, without a module they are of module 0, and normals are estimated anyhow.

Calibrated tables have six more, the covariance of each position, which reading leaves aside.

Taxel-table readers by name and file suffix, with plug-ins.

Taxels as the Skinware middleware keeps them: a text database (`skin.calib`) in nanometres.

The first number says how many taxels follow, then one row each:
`type uid px py pz nx ny nz radius link`, all whole numbers; normals are scaled to 10^9. Positions
are in the frame of the row's link. The file knows no modules, so all taxels are of module 0.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from pathlib import Path

import numpy as np

from skinmap.arrays import IntArray
from skinmap.errors import DataFormatError, UnknownNameError, warn
from skinmap.io.text import (
    MAX_CHANNEL,
    check_file,
    csv_rows,
    in_file,
    parse_floats,
    parse_whole,
    read_text,
)
from skinmap.registry import Registry
from skinmap.skin.taxels import TaxelTable
from skinmap.summary import first_few

POSITION = ("x", "y", "z")
COLUMNS = ("channel", "module", "x", "y", "z", "nx", "ny", "nz")
# What a calibration adds: the covariance of each position [m2].
COVARIANCE = ("cxx", "cyy", "czz", "cxy", "cxz", "cyz")


def read_csv(path: Path) -> TaxelTable:
    """Read a taxel table.

    Raises
    ------
    DataFormatError
        Wrong header, column count, number, channel or module (names the line).
    """
    return parse_csv(read_text(path), path)


def parse_csv(text: str, path: Path) -> TaxelTable:
    """Taxel table from its text; errors name the path.

    Raises
    ------
    DataFormatError
        As for `read_csv`.
    """
    lines = csv_rows(text, path)
    values = array("d")  # a list of lists would take ten times the file's size
    _, header = next(lines, (1, None))
    names = tuple(cell.strip().lower() for cell in header or ())
    twice = [one for one in COLUMNS if names.count(one) > 1]
    if twice or not {*POSITION} <= {*names}:
        came = ",".join(header)[:200] if header is not None else "an empty file"
        raise DataFormatError(
            f"expected the header {','.join(COLUMNS)} (only x,y,z are needed), got {came!r}",
            path,
            1,
        )
    places = [(COLUMNS.index(one), at) for at, one in enumerate(names) if one in COLUMNS]
    others = [one for one in names if one and one not in (*COLUMNS, *COVARIANCE)]
    if others:
        rows = "" if COLUMNS[0] in names else "; without `channel`, rows are numbered from 0"
        warn(f"{path.name}: columns that are not read: {first_few(others)[:200]}{rows}")
    for line, row in lines:
        if row:  # without a channel: its row; without a module or a normal: zeros
            whole = [float(len(values) // len(COLUMNS)), *[0.0] * (len(COLUMNS) - 1)]
            if len(row) != len(names):
                raise DataFormatError(f"expected {len(names)} columns, got {len(row)}", path, line)
            numbers = parse_floats([row[at] for _, at in places], path, line)
            for (place, _), number in zip(places, numbers, strict=True):
                whole[place] = number
            _check_numbers(whole, path, line)
            values.extend(whole)
    if not values:
        raise DataFormatError("the table has no taxel", path, 1)
    table = np.frombuffer(values).reshape(-1, len(COLUMNS))
    with in_file(path):
        return TaxelTable(
            table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:5], table[:, 5:]
        )


def _check_numbers(whole: list[float], path: Path, line: int) -> None:
    channel, module = whole[:2]
    if channel != int(channel) or module != int(module) or channel < 0:
        raise DataFormatError(
            f"channel and module must be whole numbers, got {channel:g} and {module:g}", path, line
        )
    if max(channel, abs(module)) > MAX_CHANNEL:
        raise DataFormatError(f"channel or module beyond {MAX_CHANNEL}", path, line)


def write_csv(table: TaxelTable, path: Path) -> None:
    """Write a table so that reading it gives the same numbers back, bit by bit.

    Parameters
    ----------
    table : TaxelTable
    path : Path

    Examples
    --------
    >>> from pathlib import Path
    >>> import skinmap
    >>> from skinmap.io import read_taxels, write_csv
    >>> table = skinmap.load_robot("kaspar").repair("left_hand").table
    >>> write_csv(table, Path("hand.csv"))
    >>> bool((read_taxels(Path("hand.csv")).positions == table.positions).all())
    True
    """
    path.write_text(csv_text(table), encoding="utf-8")


def csv_text(table: TaxelTable) -> str:
    """A table as `write_csv` writes it."""
    places = np.column_stack([table.positions, table.normals]).tolist()
    rows = zip(table.channels.tolist(), table.modules.tolist(), places, strict=True)
    lines = [",".join(map(repr, (channel, module, *place))) for channel, module, place in rows]
    return "\n".join([",".join(COLUMNS), *lines]) + "\n"


Reader = Callable[[Path], TaxelTable]
readers: Registry[Reader] = Registry(
    "taxel format",
    "skinmap.readers",
    built_in={
        "csv": "skinmap.io.taxels.taxel_table:read_csv",
        "cyskin": "skinmap.io.taxels.cyskin:read_cyskin_taxels",
        "icub": "skinmap.io.taxels.icub:read_icub",
        "skinware": "skinmap.io.taxels.taxel_table:read_skinware",
        "urdf": "skinmap.io.taxels.tactile_urdf:read_tactile_urdf",
    },
)
# `skin.calib` is the name that Skinware gives its database.
SUFFIXES = {
    ".csv": "csv", ".txt": "icub", ".json": "cyskin", ".calib": "skinware", ".urdf": "urdf",
}  # fmt: skip


def read_taxels(path: Path, format: str | None = None) -> TaxelTable:
    r"""Read a taxel table in the format named, or the one its suffix stands for.

    Parameters
    ----------
    path : Path
    format : str, optional
        One of `readers`, built in or of a plug-in.

    Returns
    -------
    TaxelTable
        Positions in the units of the file.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, one that does not follow its format, or one that is too large.
    UnknownNameError
        A format that no reader has.

    Examples
    --------
    >>> from pathlib import Path
    >>> from skinmap.io import read_taxels
    >>> header = "channel,module,x,y,z,nx,ny,nz"
    >>> _ = Path("two.csv").write_text(f"{header}\n0,0,1,0,0,0,0,0\n1,0,2,0,0,0,0,0\n")
    >>> read_taxels(Path("two.csv")).positions[:, 0].tolist()
    [1.0, 2.0]
    """
    check_file(path, "a taxel table")
    if format is None:
        if path.suffix.lower() not in SUFFIXES:
            raise UnknownNameError("reader for files ending in", path.suffix, SUFFIXES)
        format = SUFFIXES[path.suffix.lower()]
    return readers.get(format)(path)


SKINWARE = ("type", "uid", "px", "py", "pz", "nx", "ny", "nz", "radius", "link")
TYPE, UID, LINK = 0, 1, 9
NANOMETRES = 1e9


def read_skinware(path: Path) -> TaxelTable:
    """Read the taxels of one link and type; the channel of a taxel is its uid.

    Raises
    ------
    DataFormatError
        Wrong count, column count or number (names the line), or several links or types: their
        taxels share no frame, or no numbering.
    """
    rows = _skinware_rows(path)
    for column, word in ((TYPE, "type"), (LINK, "link")):
        known = np.unique(rows[:, column])
        if len(known) > 1:
            raise DataFormatError(
                f"holds several {word}s, make a file of each: "
                f"{', '.join(str(value) for value in known[:20])}",
                path,
            )
    with in_file(path):
        return TaxelTable(
            rows[:, UID],
            np.zeros(len(rows), np.int64),
            rows[:, 2:5] / NANOMETRES,
            rows[:, 5:8] / NANOMETRES,
            link=str(rows[0, LINK]),
        )


def _skinware_rows(path: Path) -> IntArray:
    """(n, 10) numbers of the file, checked against the count in front."""
    count, count_line = -1, 1
    values = array("q")  # a list of lists would take ten times the file's size
    for line, text in enumerate(read_text(path).splitlines(), start=1):
        words = text.split()
        if words and count < 0:
            (count,) = parse_whole(words[:1], path, line)
            count_line, words = line, words[1:]
        if not words:
            continue
        if len(words) != len(SKINWARE):
            raise DataFormatError(
                f"expected {len(SKINWARE)} columns ({' '.join(SKINWARE)}), got {len(words)}",
                path,
                line,
            )
        numbers = parse_whole(words, path, line)
        if not 0 <= numbers[UID] <= MAX_CHANNEL:
            raise DataFormatError(
                f"uid {numbers[UID]} is not a channel (0..{MAX_CHANNEL})", path, line
            )
        values.extend(numbers)
    rows = np.frombuffer(values, np.int64).reshape(-1, len(SKINWARE))
    if count < 1:
        raise DataFormatError("expected the number of taxels, at least 1", path, count_line)
    if len(rows) != count:
        raise DataFormatError(f"says {count} taxels, holds {len(rows)}", path, count_line)
    return rows

"""Taxel positions as the iCub software keeps them (`positions/*.txt`).

A header of `key value` lines, `[calibration]`, then one row per channel: `x y z nx ny nz` [m].
Row i is channel i; twelve channels make a module. A row of zeros is a channel without a taxel.
`taxel2Repr ( ... )` in the header has a number per channel: its representative, -1 for none and -2
for a thermal pad; it may be shorter or longer than the rows.
"""

from __future__ import annotations

import re
from array import array
from pathlib import Path

import numpy as np

from skinmap.arrays import IntArray
from skinmap.errors import DataFormatError, OutputError
from skinmap.io.text import digits, parse_floats, parse_whole, read_text
from skinmap.skin.taxels import ABSENT, THERMAL, UNKNOWN, TaxelTable

CHANNELS_PER_MODULE = 12
CENTRE_SLOT = 3  # stands for its module in the files of the iCub
CHANNELS_PER_STRIP = 192  # live vectors of the iCub come in multiples of it
MOST_WRITTEN = 100_000  # rows, also those without a taxel; the largest file has 1344
SECTION = "[calibration]"
MAX_CHANNELS = 200_000  # far above any skin; a file that claims more is damaged


def read_icub(path: Path) -> TaxelTable:
    """Read the placed taxels: every row that is not all zero, the last row included.

    Raises
    ------
    DataFormatError
        Wrong column count, a word that is not a number, or no placed taxel.
    """
    lines = read_text(path).splitlines()
    start = next((i + 1 for i, text in enumerate(lines) if text.strip() == SECTION), 0)
    if start == 0 and any(text.strip().startswith(("name", "taxel2Repr")) for text in lines):
        raise DataFormatError(f"a header but no line {SECTION}", path)
    rows = array("d")  # lists of numbers would take ten times the file's size
    for line, text in enumerate(lines[start:], start=start + 1):
        words = text.split()
        if not words:
            continue
        if len(rows) == 6 * MAX_CHANNELS:
            raise DataFormatError(f"more than {MAX_CHANNELS} channels", path, line)
        if len(words) != 6:
            raise DataFormatError(f"expected 6 columns, got {len(words)}", path, line)
        rows.extend(parse_floats(words, path, line))
    values = np.frombuffer(rows).reshape(-1, 6)
    channels = np.flatnonzero(values[:, :3].any(axis=1))
    if len(channels) == 0:
        raise DataFormatError("no placed taxel: every row is zero", path)
    name = re.search(r"(?:^|\s)name\s+(\S+)", " ".join(lines[:start]))
    return TaxelTable(
        channels,
        channels // CHANNELS_PER_MODULE,
        values[channels, :3],
        values[channels, 3:],
        _representatives(lines[:start], len(values), path)[channels],
        name.group(1) if name else "",
    )


def _representatives(head: list[str], rows: int, path: Path) -> IntArray:
    """(rows,) `taxel2Repr` of the header, UNKNOWN past its end."""
    stated = np.full(rows, UNKNOWN)
    listed = re.search(r"taxel2Repr\s*\(([^)]*)\)", "\n".join(head))
    if listed:
        line = "\n".join(head)[: listed.start()].count("\n") + 1
        words = listed.group(1).split()
        if len(words) > MAX_CHANNELS:
            raise DataFormatError(f"taxel2Repr lists {len(words)} channels", path, line)
        values = parse_whole(words, path, line)[:rows]
        stated[: len(values)] = values
    return stated


def write_icub(table: TaxelTable, path: Path, *, name: str | None = None) -> None:
    """Write a position file of the iCub: one row a channel, zeros where there is no taxel.

    Parameters
    ----------
    table : TaxelTable
        Its modules must be channel div 12 and no taxel may lie exactly in the origin: the format
        has no room for either.
    path : Path
        The file.
    name : str, optional
        What the header calls it, one word: the link that the positions are in. The table's own
        link if not given.

    Raises
    ------
    OutputError
        A table that the format cannot hold (names the taxel), or a name of several words.
    """
    word = name or table.link or "skin"
    if len(word.split()) != 1 or not word.isprintable():
        raise OutputError(f"an iCub file needs a name of one word, got {word!r}")
    _check_icub(table)
    rows = (int(table.channels[-1]) // CHANNELS_PER_STRIP + 1) * CHANNELS_PER_STRIP
    values = np.zeros((rows, 6))
    values[table.channels] = np.column_stack([table.positions, table.normals])
    representatives = " ".join(str(value) for value in _stated(table, rows))
    lines = [
        f"name {word}",
        "spatial_sampling taxel",
        f"taxel2Repr ( {representatives} )",
        "[calibration]",
        *(digits(row) for row in values),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _check_icub(table: TaxelTable) -> None:
    if len(table) == 0:
        raise OutputError("no taxel to write")
    if table.channels[-1] >= MOST_WRITTEN:
        raise OutputError(
            f"channel {table.channels[-1]}: an iCub file has a row for each channel below it, "
            f"at most {MOST_WRITTEN}; write csv"
        )
    other = table.modules != table.channels // CHANNELS_PER_MODULE
    if other.any():
        raise OutputError(
            f"channel {table.channels[other][0]} is of module {table.modules[other][0]}; in an "
            f"iCub file modules are channel div {CHANNELS_PER_MODULE}; write csv"
        )
    zero = ~table.positions.any(axis=1)
    if zero.any():
        raise OutputError(
            f"channel {table.channels[zero][0]} lies in the origin, which means 'no taxel' in an "
            f"iCub file; write csv"
        )


def _stated(table: TaxelTable, rows: int) -> IntArray:
    """(rows,) the centre of each taxel's module, else its first taxel; -1 and -2 as they came."""
    stated = np.full(rows, ABSENT)
    tactile = table.channels[~np.isin(table.representative, (ABSENT, THERMAL))]
    modules, first = np.unique(tactile // CHANNELS_PER_MODULE, return_index=True)
    centres = modules * CHANNELS_PER_MODULE + CENTRE_SLOT
    stands_for = np.where(np.isin(centres, tactile), centres, tactile[first])
    stated[tactile] = stands_for[np.searchsorted(modules, tactile // CHANNELS_PER_MODULE)]
    stated[table.channels[table.representative == THERMAL]] = THERMAL
    return stated

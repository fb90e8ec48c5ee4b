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
from skinmap.errors import DataFormatError
from skinmap.io.text import parse_floats, parse_whole, read_text
from skinmap.skin.taxels import UNKNOWN, TaxelTable

CHANNELS_PER_MODULE = 12
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

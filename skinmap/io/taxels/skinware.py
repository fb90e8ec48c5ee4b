"""Taxels as the Skinware middleware keeps them: a text database (`skin.calib`) in nanometres.

The first number says how many taxels follow, then one row each:
`type uid px py pz nx ny nz radius link`, all whole numbers; normals are scaled to 10^9. Positions
are in the frame of the row's link. The file knows no modules, so all taxels are of module 0.
"""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np

from skinmap.arrays import IntArray
from skinmap.errors import DataFormatError, InvalidArrayError
from skinmap.io.text import MAX_CHANNEL, parse_whole, read_text
from skinmap.skin.taxels import TaxelTable

COLUMNS = ("type", "uid", "px", "py", "pz", "nx", "ny", "nz", "radius", "link")
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
    rows = _rows(path)
    for column, word in ((TYPE, "type"), (LINK, "link")):
        known = np.unique(rows[:, column])
        if len(known) > 1:
            raise DataFormatError(
                f"holds several {word}s, make a file of each: "
                f"{', '.join(str(value) for value in known[:20])}",
                path,
            )
    try:
        return TaxelTable(
            rows[:, UID],
            np.zeros(len(rows), np.int64),
            rows[:, 2:5] / NANOMETRES,
            rows[:, 5:8] / NANOMETRES,
            link=str(rows[0, LINK]),
        )
    except InvalidArrayError as error:
        raise DataFormatError(str(error), path) from None


def _rows(path: Path) -> IntArray:
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
        if len(words) != len(COLUMNS):
            raise DataFormatError(
                f"expected {len(COLUMNS)} columns ({' '.join(COLUMNS)}), got {len(words)}",
                path,
                line,
            )
        numbers = parse_whole(words, path, line)
        if not 0 <= numbers[UID] <= MAX_CHANNEL:
            raise DataFormatError(
                f"uid {numbers[UID]} is not a channel (0..{MAX_CHANNEL})", path, line
            )
        values.extend(numbers)
    rows = np.frombuffer(values, np.int64).reshape(-1, len(COLUMNS))
    if count < 1:
        raise DataFormatError("expected the number of taxels, at least 1", path, count_line)
    if len(rows) != count:
        raise DataFormatError(f"says {count} taxels, holds {len(rows)}", path, count_line)
    return rows

"""Our own taxel table: CSV with the columns `channel,module,x,y,z,nx,ny,nz`, metres."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from skinmap.errors import DataFormatError, InvalidArrayError
from skinmap.io.text import parse_floats, read_text
from skinmap.skin.taxels import TaxelTable

COLUMNS = ("channel", "module", "x", "y", "z", "nx", "ny", "nz")


def read_csv(path: Path) -> TaxelTable:
    """Read a table of ours.

    Raises
    ------
    DataFormatError
        Wrong header, column count, number, channel or module (says which line).
    """
    rows = list(csv.reader(io.StringIO(read_text(path))))
    if not rows or tuple(cell.strip() for cell in rows[0]) != COLUMNS:
        came = ",".join(rows[0]) if rows else "an empty file"
        raise DataFormatError(f"expected the header {','.join(COLUMNS)}, got {came!r}", path, 1)
    values = []
    for line, row in enumerate(rows[1:], start=2):
        if not row:
            continue
        if len(row) != len(COLUMNS):
            raise DataFormatError(f"expected {len(COLUMNS)} columns, got {len(row)}", path, line)
        numbers = parse_floats(row, path, line)
        if numbers[0] != int(numbers[0]) or numbers[1] != int(numbers[1]) or numbers[0] < 0:
            raise DataFormatError(
                f"channel and module must be whole numbers, got {row[0]} and {row[1]}", path, line
            )
        values.append(numbers)
    if not values:
        raise DataFormatError("the table has no taxel", path, 1)
    table = np.array(values)
    try:
        return TaxelTable(
            table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:5], table[:, 5:]
        )
    except InvalidArrayError as error:
        raise DataFormatError(str(error), path) from None


def write_csv(table: TaxelTable, path: Path) -> None:
    """Write a table so that reading it gives the same numbers back, bit by bit."""
    lines = [",".join(COLUMNS)]
    for channel, module, position, normal in zip(
        table.channels, table.modules, table.positions, table.normals, strict=True
    ):
        numbers = ",".join(repr(float(value)) for value in (*position, *normal))
        lines.append(f"{channel},{module},{numbers}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")

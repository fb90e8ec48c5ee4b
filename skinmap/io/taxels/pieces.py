"""Tables that stand for one part together: the same shape at several places, with other ids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import DataFormatError
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.io.taxels.cyskin import has_channel, modules_of
from skinmap.io.text import MAX_CHANNEL, parse_whole, read_text
from skinmap.skin.taxels import NO_ID, TaxelTable


def placed(table: TaxelTable, scale: float, T_link_piece: FloatArray) -> TaxelTable:
    """A table in metres, carried to where its piece stands."""
    return replace(
        table,
        positions=transform_points(T_link_piece, table.positions * scale),
        normals=transform_directions(T_link_piece, table.normals),
    )


def with_ids(table: TaxelTable, path: Path) -> TaxelTable:
    """A table with the ids of a file, one whole number a taxel in the order of the channels.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, another number of ids, or something that is no whole number.
    """
    ids: list[int] = []
    for line, text in enumerate(read_text(path).splitlines(), start=1):
        ids += parse_whole(text.split(), path, line, most=MAX_CHANNEL)
    if len(ids) != len(table):
        raise DataFormatError(f"{len(ids)} ids for {len(table)} taxels", path)
    numbers = np.array(ids, np.int64)
    wired = has_channel(numbers)
    # Copies of one shape are wired in different ways: the boards go by the ids, not by the shape.
    modules = modules_of(numbers, wired, table.positions)
    return replace(table, modules=modules, ids=np.where(wired, numbers, NO_ID))


def joined(tables: Sequence[TaxelTable]) -> TaxelTable:
    """One table of several pieces: channels and modules of each follow on those before it."""
    channel = module = 0
    channels, modules = [], []
    for table in tables:
        channels.append(table.channels + channel)
        modules.append(np.unique(table.modules, return_inverse=True)[1].ravel() + module)
        channel, module = int(channels[-1].max()) + 1, int(modules[-1].max()) + 1
    known = all(len(table.ids) for table in tables)
    return TaxelTable(
        np.concatenate(channels),
        np.concatenate(modules),
        np.concatenate([table.positions for table in tables]),
        np.concatenate([table.normals for table in tables]),
        np.concatenate([table.representative for table in tables]),
        tables[0].link,
        np.concatenate([table.ids for table in tables]) if known else np.zeros(0, np.int64),
        np.repeat(np.arange(len(tables)), [len(table) for table in tables]),
    )

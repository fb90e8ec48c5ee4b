"""The corrected channel map: a taxel table in which every channel is where it really is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from calibration.wiring.boards import Boards, Wiring
from calibration.wiring.faults import Fault
from skinmap.arrays import IntArray
from skinmap.errors import InvalidArrayError
from skinmap.skin.taxels import TaxelTable


def corrected(boards: Boards, wiring: Wiring, faults: list[Fault]) -> tuple[TaxelTable, IntArray]:
    """The table as the wiring really is.

    Parameters
    ----------
    boards : Boards
        As mapped.
    wiring : Wiring
        As found.
    faults : list of Fault
        Those that were named.

    Returns
    -------
    TaxelTable
        Mute channels keep their place; those that read nothing are left out.
    (c,) int
        Channels whose place changed.
    """
    places = wiring.places(boards)
    there = np.isfinite(places[:, 0])
    table = boards.table
    moved = there & (np.abs(places - table.positions).max(axis=1) > 1e-9)
    _, nearest = cKDTree(table.positions).query(places[there])
    channels, modules, rows = _found_again(boards, wiring, faults).T
    joined = TaxelTable(
        np.concatenate([table.channels[there], channels]),
        np.concatenate([table.modules[there], modules]),
        np.concatenate([places[there], table.positions[rows]]),
        np.concatenate([boards.normals[nearest], boards.normals[rows]]),
        link=table.link,
    )
    return joined, table.channels[moved | ~there]


def _found_again(boards: Boards, wiring: Wiring, faults: list[Fault]) -> IntArray:
    """(c, 3) channel, module and row of places that no row reads after chains changed."""
    swapped = [fault.chains for fault in faults if fault.kind == "swapped_chains"]
    found: list[tuple[int, int, int]] = []
    table, slots = boards.table, boards.slots
    if swapped and slots and np.array_equal(table.modules, table.channels // slots):
        for site in np.flatnonzero(wiring.owner < 0).tolist():
            chain = int(boards.chains[site])
            for one, other in swapped:
                if chain in (one, other):
                    chain = other if chain == one else one
            module = chain * _room(boards) + int(boards.spots[site])
            for row in boards.columns[site][boards.columns[site] >= 0].tolist():
                found.append((module * slots + int(table.channels[row] % slots), module, row))
    return np.array(found, np.int64).reshape(-1, 3)


def _room(boards: Boards) -> int:
    """Modules that a chain has room for."""
    beyond = boards.chains > 0
    if not beyond.any():
        return len(boards)
    first = int(np.argmax(beyond))
    return int((boards.numbers[first] - boards.spots[first]) // boards.chains[first])


def map_files(parts: Sequence[str], out: Path) -> dict[str, Path]:
    """The file of each part's map: `out` itself for one part, else a file in that folder.

    Raises
    ------
    InvalidArrayError
        Several parts for one file.
    """
    if out.suffix.lower() != ".csv":
        return {part: out / f"{part}.csv" for part in parts}
    if len(parts) > 1:
        raise InvalidArrayError(f"{len(parts)} parts do not go into one table: give a folder")
    return {parts[0]: out}

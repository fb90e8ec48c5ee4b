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
from skinmap.io.output import staged_file
from skinmap.io.taxels.taxel_table import write_csv
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
    channels = [table.channels[there]]
    modules = [table.modules[there]]
    positions = [places[there]]
    normals = [boards.normals[nearest]]
    for channel, module, row in _found_again(boards, wiring, faults):
        channels.append(np.array([channel]))
        modules.append(np.array([module]))
        positions.append(table.positions[[row]])
        normals.append(boards.normals[[row]])
    joined = TaxelTable(
        np.concatenate(channels), np.concatenate(modules), np.concatenate(positions),
        np.concatenate(normals), link=table.link,
    )  # fmt: skip
    return joined, table.channels[moved | ~there]


def _found_again(boards: Boards, wiring: Wiring, faults: list[Fault]) -> list[tuple[int, int, int]]:
    """Channel, module and row of places that no row of the table reads after chains changed."""
    lost = np.flatnonzero(wiring.owner < 0)
    swapped = [fault.chains for fault in faults if fault.kind == "swapped_chains"]
    found: list[tuple[int, int, int]] = []
    if not swapped or not boards.slots:
        return found
    if not np.array_equal(boards.table.modules, boards.table.channels // boards.slots):
        return found
    length = _room(boards)
    for site in lost.tolist():
        chain = int(boards.chains[site])
        for one, other in swapped:
            if chain in (one, other):
                chain = other if chain == one else one
        module = chain * length + int(boards.spots[site])
        for row in boards.columns[site][boards.columns[site] >= 0].tolist():
            slot = int(boards.table.channels[row] % boards.slots)
            found.append((module * boards.slots + slot, module, row))
    return found


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


def write_map(table: TaxelTable, path: Path) -> None:
    """Write a corrected map.

    Raises
    ------
    OutputError
        Its folder does not exist, or cannot be written to.
    """
    with staged_file(path) as stage:
        write_csv(table, stage)

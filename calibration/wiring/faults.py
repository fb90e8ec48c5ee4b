"""Faults of wiring: what may be wrong with modules, chains and channels; the corrected map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from scipy.spatial import cKDTree

from calibration.wiring.boards import Boards, Wiring
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.skin.taxels import TaxelTable

Kind = Literal[
    "swapped_modules", "turned_module", "mirrored_module", "mute_module",
    "swapped_chains", "reversed_chain", "mute_chain", "swapped_channels",
]  # fmt: skip
KINDS: tuple[str, ...] = get_args(Kind)
# How a faulty skin's probability is shared out: modules and chains alike, as nobody has counted;
# channels inside a module less, as they are soldered and not plugged.
SHARE = dict.fromkeys(KINDS, 1.0) | {"swapped_channels": 0.1}
TWICE = 0.1  # of a module's share: mirrored and turned as well, which is two faults at once
HEALTHY = 0.5  # probability that nothing is wrong, before anything was seen: somebody asks


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes
    ----------
    kind : str
        One of `KINDS`; "healthy" for none.
    modules : tuple of int
        Places of the modules in `Boards.numbers`.
    element : int
        How a turned or mirrored module is laid (of `ELEMENTS`).
    chains : tuple of int
        Of a fault of chains.
    slots : tuple of int
        Of two channels exchanged.
    """

    kind: str
    modules: tuple[int, ...] = ()
    element: int = 0
    chains: tuple[int, ...] = ()
    slots: tuple[int, ...] = ()

    def moves(self, boards: Boards) -> dict[int, int]:
        """Modules (keys) that read another module's site (values; -1: none)."""
        if self.kind == "swapped_modules":
            one, other = self.modules
            return {one: other, other: one}
        if self.kind in ("mute_module", "mute_chain"):
            return dict.fromkeys(self.modules, -1)
        if self.kind == "reversed_chain":
            return dict(zip(self.modules, reversed(self.modules), strict=True))
        if self.kind == "swapped_chains":
            return _exchanged(boards, *self.chains)
        return {}

    def apply(self, wiring: Wiring, boards: Boards) -> Wiring:
        """A wiring with this fault as well."""
        if self.kind in ("mute_module", "mute_chain"):
            return wiring.silenced(list(self.modules))
        if self.element:
            return wiring.laid(self.modules[0], self.element)
        if self.slots:
            return wiring.exchanged(self.modules[0], *self.slots)
        return wiring.moved(self.moves(boards))

    def numbers(self, boards: Boards) -> list[int]:
        """What the table calls the modules."""
        return [int(boards.numbers[module]) for module in self.modules]

    def channels(self, boards: Boards) -> list[int]:
        """Channels that are not where the map has them, or mute."""
        rows = boards.columns[list(self.modules)]
        rows = rows[:, list(self.slots)] if self.slots else rows
        return sorted(int(c) for c in boards.table.channels[rows[rows >= 0]])

    def words(self, boards: Boards) -> str:
        """For people."""
        numbers, part = self.numbers(boards), boards.part
        one, other = (*(self.chains or numbers), 0, 0)[:2]
        turn = 120 * (self.element % 3)
        too = f" and with a turn of {turn} degrees" if turn else ""
        every = f"modules {', '.join(map(str, numbers))}"
        channels = " and ".join(map(str, self.channels(boards)))
        return {
            "healthy": "nothing is wrong",
            "swapped_modules": f"modules {one} and {other} of {part} exchanged: swap their plugs",
            "turned_module": f"module {one} of {part}: mounted with a turn of {turn} degrees",
            "mirrored_module": f"module {one} of {part}: mounted mirrored{too}",
            "mute_module": f"module {one} of {part}: cable or board",
            "swapped_channels": f"channels {channels} of {part} exchanged, in module {one}",
            "swapped_chains": f"chains {one} and {other} of {part} exchanged: swap their cables",
            "mute_chain": f"chain {one} of {part}, {every}: cable or board of the chain",
            "reversed_chain": f"chain {one} of {part}, {every}: wired in reverse order",
        }[self.kind]


NOTHING = Fault("healthy")


def _exchanged(boards: Boards, one: int, other: int) -> dict[int, int]:
    """Module by module along two chains; what has no counterpart reads nothing."""
    members = {chain: np.flatnonzero(boards.chains == chain).tolist() for chain in (one, other)}
    at = {chain: {int(boards.spots[a]): a for a in rows} for chain, rows in members.items()}
    return {
        a: at[there].get(int(boards.spots[a]), -1)
        for here, there in ((one, other), (other, one))
        for a in members[here]
    }


@dataclass(frozen=True, eq=False, slots=True)
class Hypotheses:
    """Every single fault of a part, healthy first, in blocks of one shape.

    Attributes
    ----------
    faults : tuple of Fault
    log_prior : (h,) float
    swaps : (s, 2) int
        Modules of the swaps, which come second.
    chain_first : int
        Row of the first fault of chains, which come last.
    """

    faults: tuple[Fault, ...]
    log_prior: FloatArray
    swaps: IntArray
    chain_first: int

    def __len__(self) -> int:
        return len(self.faults)


def all_faults(boards: Boards) -> Hypotheses:
    """Every single fault, with its probability before anything was seen."""
    m = len(boards)
    one, other = np.triu_indices(m, 1)
    faults = [NOTHING]
    faults += [
        Fault("swapped_modules", (a, b)) for a, b in zip(one.tolist(), other.tolist(), strict=True)
    ]
    faults += [Fault("mute_module", (a,)) for a in range(m)]
    for element in range(1, 6):
        kind = "turned_module" if element < 3 else "mirrored_module"
        faults += [Fault(kind, (a,), element=element) for a in range(m)]
    faults += [
        Fault("swapped_channels", (a,), slots=pair) for a in range(m) for pair in boards.pairs
    ]
    first = len(faults)
    faults += chain_faults(boards)
    counts = {kind: sum(fault.kind == kind for fault in faults) for kind in KINDS}
    laid = {"turned_module", "mirrored_module"}
    shares = {
        kind: SHARE[kind] * (counts[kind] > 0) * (boards.turnable or kind not in laid)
        for kind in KINDS
    }
    total = sum(shares.values())
    with np.errstate(divide="ignore"):
        each = {kind: np.log(shares[kind] / total / max(counts[kind], 1)) for kind in KINDS} | {
            "healthy": np.log(HEALTHY)
        }
    less = {4: np.log(TWICE), 5: np.log(TWICE)}
    prior = np.array([each[fault.kind] + less.get(fault.element, 0.0) for fault in faults])
    prior[1:] += np.log1p(-HEALTHY) - np.log(np.exp(prior[1:]).sum())
    return Hypotheses(tuple(faults), prior, np.column_stack([one, other]), first)


def chain_faults(boards: Boards) -> list[Fault]:
    """Faults of whole chains; a chain of one module is that module."""
    names, counts = np.unique(boards.chains, return_counts=True)
    members = {int(c): tuple(np.flatnonzero(boards.chains == c).tolist()) for c in names}
    many = [int(c) for c, count in zip(names, counts, strict=True) if count > 1]
    faults = [Fault("mute_chain", members[c], chains=(c,)) for c in many]
    faults += [
        Fault("reversed_chain", members[c], chains=(c,)) for c in many if len(members[c]) > 2
    ]
    for place, one in enumerate(names.tolist()):
        for other in names[place + 1 :].tolist():
            if len(members[one]) + len(members[other]) > 2:
                both = tuple(sorted(members[one] + members[other]))
                faults.append(Fault("swapped_chains", both, chains=(one, other)))
    return faults


def corrected(boards: Boards, wiring: Wiring) -> tuple[TaxelTable, IntArray]:
    """The table as the wiring really is.

    Parameters
    ----------
    boards : Boards
        As mapped.
    wiring : Wiring
        As found.

    Returns
    -------
    TaxelTable
        Mute channels keep their place; those that read nothing are left out.
    (c,) int
        Channels whose place changed.
    """
    places, table = wiring.places(boards), boards.table
    there = np.isfinite(places[:, 0])
    moved = there & (np.abs(places - table.positions).max(axis=1) > 1e-9)
    _, nearest = cKDTree(table.positions).query(places[there])
    found = TaxelTable(
        table.channels[there],
        table.modules[there],
        places[there],
        boards.normals[nearest],
        link=table.link,
    )
    return found, table.channels[moved | ~there]


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

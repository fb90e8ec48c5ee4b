"""The boards of a part: modules, the chains they hang on, and where their slots may lie.

Faults of modules, chains and channels, and the map that corrects them, are here too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, Frozen, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import plane_turns, transform_points
from skinmap.geometry.triangles import unit
from skinmap.skin.modules import ModuleLayout, fit_modules
from skinmap.skin.robot import Robot
from skinmap.skin.taxels import TaxelTable

CHAIN = 16  # modules that one board of the iCub's reads: 192 channels of the live vector
SAME_PLACE = 0.35  # of a pitch: a turned slot that comes so near another one stands in its place

# (6, 2, 2) what a triangle may suffer, in this order: as it is, turned by 120 and 240 degrees, and
# mirrored after a turn by 0, 120 and 240 degrees.
_TURNS = plane_turns(np.radians([0.0, 120.0, 240.0]))
GROUP = np.concatenate([_TURNS, _TURNS @ np.diag([-1.0, 1.0])])


def compose(after: int, before: int) -> int:
    """The element that acts like `before` and then `after`."""
    product = GROUP[after] @ GROUP[before]
    return int(np.argmin(np.abs(GROUP - product).sum(axis=(1, 2))))


def conjugate(element: int, now: int) -> int:
    """The element that does to a board as mapped what `element` does to one laid as `now`."""
    product = GROUP[now].T @ GROUP[element] @ GROUP[now]
    return int(np.argmin(np.abs(GROUP - product).sum(axis=(1, 2))))


@dataclass(frozen=True, eq=False, slots=True)
class Boards(Frozen):
    """m modules of at most k slots, each on a site of the body.

    Attributes
    ----------
    part : str
    table : TaxelTable
        As the map has it now, in the frame of the link.
    normals : (n, 3) float
        Outward, unit.
    numbers : (m,) int
        What the table calls each module.
    columns : (m, k) int
        Row of the table for each slot; -1 where a module has none.
    chains, spots : (m,) int
        Chain (connector) of each module, and its place on it.
    places : (m, 6, k, 3) float
        Places of the slots for each element of `GROUP` [m]; NaN where there is none.
    outward : (m, 3) float
        Normal of each module.
    turns : (6, k) int or None
        Slot whose place each slot takes for each element; None where a layout has no such symmetry.
    pitch : float
        Median spacing of the taxels [m].
    """

    part: str
    table: TaxelTable
    normals: FloatArray
    numbers: IntArray
    columns: IntArray
    chains: IntArray
    spots: IntArray
    places: FloatArray
    outward: FloatArray
    turns: IntArray | None
    pitch: float

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def turnable(self) -> bool:
        """Whether turned and mirrored modules can be told at all."""
        return bool(np.isfinite(self.places[:, 1]).any())

    @property
    def centres(self) -> FloatArray:
        """(m, 3) middles of the modules [m]."""
        return np.asarray(np.nanmean(self.places[:, 0], axis=1))

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Pairs of slots that two channels of one module may have exchanged."""
        used = np.flatnonzero((self.columns >= 0).any(axis=0)).tolist()
        return tuple(combinations(used, 2))


def boards_of(robot: Robot, part: str) -> Boards:
    """The boards of a robot's part.

    Parameters
    ----------
    robot : Robot
    part : str

    Returns
    -------
    Boards
        Where the channels of each module lie, as mapped, turned and mirrored.

    Raises
    ------
    UnknownNameError
        A part that the robot lacks.

    Examples
    --------
    >>> import skinmap
    >>> from calibration.wiring import boards_of
    >>> len(boards_of(skinmap.load_robot("icub"), "left_forearm"))
    24
    """
    table, layout = robot.repair(part).table, robot.part(part).layout
    normals = np.asarray(robot.skin(part).normals, np.float64)
    numbers = np.unique(table.modules)
    columns = _columns(table, numbers, layout)
    places = np.full((len(numbers), 6, columns.shape[1], 3), np.nan)
    there = columns >= 0
    places[:, 0][there] = table.positions[columns[there]]
    outward = unit(np.array([normals[row[row >= 0]].mean(axis=0) for row in columns]))
    turns = None if layout is None else _symmetry(layout)
    if turns is not None:
        places[:, 1:] = places[:, 0][:, turns[1:]]
    elif layout is not None:
        _turn(places, table, layout)
    address = _addresses(table, numbers, layout)
    return Boards(
        part, table, normals, numbers, columns, address // CHAIN, address % CHAIN, places, outward,
        turns, median_spacing(table.positions),
    )  # fmt: skip


def _columns(table: TaxelTable, numbers: IntArray, layout: ModuleLayout | None) -> IntArray:
    """(m, k) row of each slot; without a layout slots are counted by channel."""
    if layout is not None:
        columns = np.full((len(numbers), len(layout)), -1)
        slots = table.channels % len(layout)
        module = np.searchsorted(numbers, table.modules)
        columns[module, slots] = np.arange(len(table))
        if (columns >= 0).sum() == len(table):
            return columns
    rows = [np.flatnonzero(table.modules == number) for number in numbers]
    columns = np.full((len(numbers), max(map(len, rows))), -1)
    for place, row in enumerate(rows):
        columns[place, : len(row)] = row
    return columns


def _addresses(table: TaxelTable, numbers: IntArray, layout: ModuleLayout | None) -> IntArray:
    """(m,) place of each module in the live vector, by its number where that says so."""
    if layout is not None and np.array_equal(table.modules, table.channels // len(layout)):
        return numbers
    first = np.array([table.channels[table.modules == number].min() for number in numbers])
    return np.asarray(np.argsort(np.argsort(first)))


def _symmetry(layout: ModuleLayout) -> IntArray | None:
    """(6, k) which slot's place each slot takes when the board is turned or mirrored."""
    felt = np.flatnonzero(~layout.thermal)
    xy = layout.xy[felt] - layout.xy[felt].mean(axis=0)
    turns = np.tile(np.arange(len(layout)), (6, 1))
    for element, matrix in enumerate(GROUP):
        away = np.linalg.norm((xy @ matrix.T)[:, None] - xy[None], axis=2)
        row, column = linear_sum_assignment(away**2)
        if away[row, column].max() > SAME_PLACE * layout.pitch:
            return None
        turns[element, felt[row]] = felt[column]
    return turns


def _turn(places: FloatArray, table: TaxelTable, layout: ModuleLayout) -> None:
    """Fill in the places of turned and mirrored modules that no turn carries into themselves."""
    poses = fit_modules(table, layout)
    middle = layout.tactile.mean(axis=0)
    for row, number in enumerate(np.unique(table.modules).tolist()):
        if number not in poses:
            continue
        for element in range(1, 6):
            xy = (layout.xy - middle) @ GROUP[element].T + middle
            flat = np.column_stack([xy, np.zeros(len(xy))])
            places[row, element] = transform_points(poses[number].T_link_module, flat)
        places[row, 1:, np.isnan(places[row, 0, :, 0])] = np.nan


@dataclass(frozen=True, eq=False, slots=True)
class Wiring(Frozen):
    """Which site each module's channels read, and how the board on each site is laid.

    Attributes
    ----------
    site : (m,) int
        Site that the channels of a module read; -1: none.
    element : (m,) int
        How the board on each site is laid (of `GROUP`).
    order : (m, k) int
        Slot of the board that stands for each channel of its module.
    mute : (m,) bool
        Modules known to send nothing.
    """

    site: IntArray
    element: IntArray
    order: IntArray
    mute: np.ndarray

    @classmethod
    def as_mapped(cls, boards: Boards) -> Wiring:
        """All as the map has it."""
        m, k = boards.columns.shape
        order = np.tile(np.arange(k), (m, 1))
        return cls(np.arange(m), np.zeros(m, np.int64), order, np.zeros(m, bool))

    @property
    def owner(self) -> IntArray:
        """(m,) module whose channels read each site; -1: none."""
        owner = np.full(len(self.site), -1)
        read = np.flatnonzero(self.site >= 0)
        owner[self.site[read]] = read
        return owner

    def places(self, boards: Boards) -> FloatArray:
        """(n, 3) where the channel of each row of the table really is [m]; NaN: nowhere."""
        out = np.full((len(boards.table), 3), np.nan)
        for module, site in enumerate(self.site.tolist()):
            if site < 0:
                continue
            row = boards.columns[module]
            there = row >= 0
            laid = boards.places[site, self.element[site]][self.order[site]]
            out[row[there]] = laid[there]
        return out

    def sources(self, boards: Boards) -> IntArray:
        """(n,) row of the table that stands where each row's channel really is; -1: none.

        What a skin with this wiring sends is `sample[sources]` of what a right one would send.
        Only for layouts that a turn carries into themselves.
        """
        out = np.full(len(boards.table), -1)
        for module, site in enumerate(self.site.tolist()):
            if site < 0 or self.mute[module]:
                continue
            slot = self.order[site]
            if self.element[site]:
                if boards.turns is None:
                    raise InvalidArrayError("this layout has no such turn")
                slot = boards.turns[self.element[site]][slot]
            row, source = boards.columns[module], boards.columns[site, slot]
            both = (row >= 0) & (source >= 0)
            out[row[both]] = source[both]
        return out


KINDS = (
    "swapped_modules", "turned_module", "mirrored_module", "mute_module",
    "swapped_chains", "reversed_chain", "mute_chain", "swapped_channels",
)  # fmt: skip
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
        How a turned or mirrored module is laid (of `GROUP`).
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
        site, element = wiring.site.copy(), wiring.element.copy()
        order, mute = wiring.order.copy(), wiring.mute.copy()
        places = wiring.site[list(self.modules)]
        if self.kind in ("mute_module", "mute_chain"):
            mute[list(self.modules)] = True
        elif self.element:
            element[places] = compose(self.element, int(element[places[0]]))
        elif self.slots:
            order[places[0], list(self.slots)] = order[places[0], list(self.slots[::-1])]
        else:
            for module, other in self.moves(boards).items():
                site[module] = -1 if other < 0 else wiring.site[other]
        return Wiring(site, element, order, mute)

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
    faults = [Fault("healthy")]
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
    counts = Counter(fault.kind for fault in faults)
    untold = {"healthy"} if boards.turnable else {"healthy", "turned_module", "mirrored_module"}
    each = {kind: SHARE[kind] / counts[kind] for kind in counts.keys() - untold}
    less = {4: TWICE, 5: TWICE}
    shares = [each.get(fault.kind, 0.0) * less.get(fault.element, 1.0) for fault in faults]
    with np.errstate(divide="ignore"):
        prior = np.log(np.array(shares) * (1.0 - HEALTHY) / np.sum(shares))
    prior[0] = np.log(HEALTHY)
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

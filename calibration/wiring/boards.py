"""The boards of a part: modules, the chains they hang on, and where their slots may lie."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.errors import InvalidArrayError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import plane_turns, transform_points
from skinmap.geometry.triangles import unit
from skinmap.skin.modules import ModuleLayout, fit_modules
from skinmap.skin.robot import Robot
from skinmap.skin.taxels import TaxelTable

CHAIN = 16  # modules that one board of the iCub's reads: 192 channels of the live vector
SAME_PLACE = 0.35  # of a pitch: a turned slot that comes so near another one stands in its place
ELEMENTS = ("as it is", "turned 120", "turned 240", "mirrored 0", "mirrored 120", "mirrored 240")


# (6, 2, 2) what a triangle may suffer: turns by 0, 120, 240 degrees, and a mirror after.
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
class Boards:
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
        Places of the slots for each of `ELEMENTS` [m]; NaN where there is none.
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

    def __post_init__(self) -> None:
        freeze(self)

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
        part,
        table,
        normals,
        numbers,
        columns,
        address // CHAIN,
        address % CHAIN,
        places,
        outward,
        turns,
        median_spacing(table.positions),
    )


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
class Wiring:
    """Which site each module's channels read, and how the board on each site is laid.

    Attributes
    ----------
    site : (m,) int
        Site that the channels of a module read; -1: none.
    element : (m,) int
        How the board on each site is laid (of `ELEMENTS`).
    order : (m, k) int
        Slot of the board that stands for each channel of its module.
    mute : (m,) bool
        Modules known to send nothing.
    """

    site: IntArray
    element: IntArray
    order: IntArray
    mute: np.ndarray

    def __post_init__(self) -> None:
        freeze(self)

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

    def moved(self, moves: dict[int, int]) -> Wiring:
        """Modules (keys) that read the sites of others (values; -1: none)."""
        site = self.site.copy()
        for module, other in moves.items():
            site[module] = -1 if other < 0 else self.site[other]
        return replace(self, site=site)

    def laid(self, module: int, element: int) -> Wiring:
        """The board that a module reads laid otherwise."""
        elements = self.element.copy()
        place = self.site[module]
        elements[place] = compose(element, int(elements[place]))
        return replace(self, element=elements)

    def exchanged(self, module: int, one: int, other: int) -> Wiring:
        """Two channels of a module exchanged."""
        order = self.order.copy()
        place = self.site[module]
        order[place, [one, other]] = order[place, [other, one]]
        return replace(self, order=order)

    def silenced(self, modules: list[int]) -> Wiring:
        """Modules that send nothing."""
        mute = self.mute.copy()
        mute[modules] = True
        return replace(self, mute=mute)

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

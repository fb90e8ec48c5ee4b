"""Fitting module layouts to placed taxels: where each rigid board really lies; sheets of boards.

Module layouts: where the slots of one rigid board are, and which of them feel touch.

The built-in ones are the iCub's 10-pad (version 2) and the 12-pad of RoboSkin, as their position
files have them, and a nominal 11-pad of the Baxter forearm. The origin is the module's centre,
seen from outside, so that the order of the slots tells which way is out.
"""

from __future__ import annotations

import csv
import io
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray, check_finite, freeze
from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError, UnknownNameError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import plane_turns, rigid_fit, transform_points
from skinmap.geometry.triangles import unit
from skinmap.skin.taxels import TaxelTable

MAX_BYTES = 2**20  # the largest board has some tens of slots
# What strange content comes to: deep nests, numbers that no float holds and cells without end too.
NO_LAYOUT = (
    ValueError, TypeError, KeyError, IndexError, OverflowError, RecursionError, csv.Error, OSError,
)  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class ModuleLayout:
    """One board.

    Attributes
    ----------
    name : str
    xy : (k, 2) float
        Place of each slot [m].
    thermal : (k,) bool
        Slots that measure temperature and no touch.
    centre : int
        Slot that stands for the module where a file gives one place for several slots.
    side : float or None
        Edge of the triangular board [m], where it is one.
    """

    name: str
    xy: FloatArray
    thermal: BoolArray
    centre: int
    side: float | None = None

    def __post_init__(self) -> None:
        xy = check_finite(self.xy, "xy", (None, 2))
        thermal = np.asarray(self.thermal, bool)
        if thermal.shape != (len(xy),) or not 0 <= self.centre < len(xy):
            raise InvalidArrayError(
                f"layout {self.name!r}: {len(xy)} slots, {len(thermal)} thermal flags, "
                f"centre {self.centre}"
            )
        if (~thermal).sum() < 3:
            raise InvalidArrayError(f"layout {self.name!r} has fewer than three tactile slots")
        freeze(self, xy=xy, thermal=thermal)

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def tactile(self) -> FloatArray:
        """(t, 2) places of the slots that feel touch [m]."""
        return np.asarray(self.xy[~self.thermal])

    @property
    def pitch(self) -> float:
        """Median distance of tactile slots to their nearest tactile slot [m]."""
        return median_spacing(self.tactile)


def _millimetres(
    name: str,
    places: list[tuple[float, float]],
    thermal: tuple[int, ...],
    side: float,
    centre: int = 3,
) -> ModuleLayout:
    flags = np.isin(np.arange(len(places)), thermal)
    return ModuleLayout(name, 1e-3 * np.array(places), flags, centre, 1e-3 * side)


BUILTIN = {
    layout.name: layout
    for layout in (
        _millimetres(
            "triangle_10pad",
            [
                (6.533, 0), (9.800, -5.660), (3.267, -5.660), (0, 0), (-3.267, -5.660),
                (-9.800, -5.660), (-6.533, -3.750), (-6.533, 0), (-3.267, 5.660), (0, 11.317),
                (0, 7.507), (3.267, 5.660),
            ],
            (6, 10),
            33.46,
        ),
        _millimetres(
            "triangle_12pad",
            [
                (7.5, -1.443), (10, -5.774), (5, -5.774), (0, -2.887), (-5, -5.774),
                (-10, -5.774), (-7.5, -1.443), (-2.5, 1.443), (-2.5, 7.217), (0, 11.547),
                (2.5, 7.217), (2.5, 1.443),
            ],
            (),
            30.0,
        ),
        # Nominal: published are the count, the side of 30 mm and the pitch of 8 mm, no places.
        # These are the eleven points of a triangle that lie furthest apart, at that pitch.
        _millimetres(
            "triangle_11pad",
            [
                (-14.53, -8.39), (0, -8.39), (14.53, -8.39), (-7.26, -5.04),
                (7.26, -5.04), (0, 2.88), (-8, 2.93), (8, 2.93),
                (-3.99, 9.85), (3.99, 9.85), (0, 16.78),
            ],
            (),
            30.0,
            5,
        ),
    )
}  # fmt: skip


def module_layout(name: str, folder: Path = Path()) -> ModuleLayout:
    """A layout by built-in name, or from a user's `.toml` or `.csv` file.

    Raises
    ------
    UnknownNameError
        A name that is neither built in nor a file of those kinds.
    MissingFileError, DataFormatError
        A file that does not exist or is no layout.
    """
    if name in BUILTIN:
        return BUILTIN[name]
    path = folder / name
    if path.suffix not in (".toml", ".csv"):
        raise UnknownNameError("module layout (or a .toml or .csv file)", name, BUILTIN)
    if not path.is_file():
        raise MissingFileError(path, "a module layout")
    if path.stat().st_size > MAX_BYTES:
        raise DataFormatError(f"more than {MAX_BYTES >> 20} MB: no module layout", path)
    try:
        text = path.read_text(encoding="utf-8")
        rows, centre, side = _read_toml(text) if path.suffix == ".toml" else _read_csv(text)
        places = np.array([[row[0], row[1]] for row in rows], float) * 1e-3
        thermal = np.array([bool(row[2]) for row in rows])
        return ModuleLayout(path.stem, places, thermal, centre, side)
    except NO_LAYOUT as error:
        raise DataFormatError(f"not a module layout: {error}", path) from error


Rows = list[tuple[float, float, bool]]


def _read_toml(text: str) -> tuple[Rows, int, float | None]:
    """`slots_mm = [[x, y], ...]`, and optional `thermal = [slot, ...]`, `centre`, `side_mm`."""
    document = tomllib.loads(text)
    thermal = set(document.get("thermal", []))
    rows = [(float(x), float(y), i in thermal) for i, (x, y) in enumerate(document["slots_mm"])]
    side = document.get("side_mm")
    return rows, int(document.get("centre", 0)), None if side is None else 1e-3 * float(side)


def _read_csv(text: str) -> tuple[Rows, int, float | None]:
    """Columns `slot,x_mm,y_mm,thermal` with thermal 0 or 1, slots in order from 0."""
    rows = list(csv.DictReader(io.StringIO(text)))
    if [int(row["slot"]) for row in rows] != list(range(len(rows))):
        raise ValueError("slots must run 0, 1, 2, ... in order")
    return [(float(r["x_mm"]), float(r["y_mm"]), r["thermal"] == "1") for r in rows], 0, None


SHARED_WEIGHT = 0.5  # of the place that several slots share: the module's centre within 1 mm
SPREAD = 0.1  # second singular value against the first: below, the taxels stand in a row
LEVER = 5e-3  # length at which a borrowed normal holds a module that stands in a row [m]


@dataclass(frozen=True, eq=False, slots=True)
class ModulePose(Frozen):
    """Where one board lies.

    Attributes
    ----------
    T_link_module : (4, 4) float
        +z is the board's normal.
    residual : float
        Root mean square distance of the taxels that were fitted [m].
    taxels : int
        How many taxels of their own place the fit rests on.
    sure : bool
        Whether those taxels alone determine the pose.
    """

    T_link_module: FloatArray
    residual: float
    taxels: int
    sure: bool


def slots_of(table: TaxelTable, layout: ModuleLayout) -> IntArray:
    """(n,) slot of each taxel: its channel's place in its module."""
    return table.channels % len(layout)


def shared_places(table: TaxelTable) -> BoolArray:
    """(n,) whether a taxel has its position in common with another one of its module."""
    key = np.column_stack([table.modules, table.positions])
    _, group, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(count[group.ravel()] > 1)


def fit_modules(
    table: TaxelTable,
    layout: ModuleLayout,
    known: Mapping[int, FloatArray] | None = None,
) -> dict[int, ModulePose]:
    """Rigid fit of the layout to each module's taxels.

    Parameters
    ----------
    table : TaxelTable
    layout : ModuleLayout
    known : mapping of int to (4, 4) array, optional
        T_link_module from elsewhere (frames of the URDF), whose normal is borrowed where a
        module's own taxels stand in a row; without them the nearest modules lend theirs.

    Returns
    -------
    dict of int to ModulePose
        Modules of which nothing determines the pose are left out.
    """
    slots, shared = slots_of(table, layout), shared_places(table)
    tactile = ~layout.thermal[slots]
    poses: dict[int, ModulePose] = {}
    weak = []
    for module in np.unique(table.modules).tolist():
        rows = np.flatnonzero((table.modules == module) & tactile)
        own = rows[~shared[rows]]
        centre = rows[shared[rows] & (slots[rows] == layout.centre)]
        used = np.concatenate([own, centre])
        places = np.column_stack([layout.xy[slots[used]], np.zeros(len(used))])
        weights = np.where(shared[used], SHARED_WEIGHT, 1.0)
        if len(used) >= 3 and _spread(places, weights) > SPREAD:
            pose = rigid_fit(places, table.positions[used], weights)
            poses[module] = _pose(pose, places[: len(own)], table.positions[own], sure=True)
        elif len(used):
            weak.append((module, used, places, weights, len(own)))
    normals = {module: pose.T_link_module[:3, 2] for module, pose in poses.items()}
    centres = {module: pose.T_link_module[:3, 3] for module, pose in poses.items()}
    for module, used, places, weights, n_own in weak:
        points = table.positions[used]
        if len(used) >= 2 and (normals or (known and module in known)):
            middle, lent = points.mean(axis=0), None if known is None else known.get(module)
            if lent is None:  # the mean normal of the three nearest modules whose pose is sure
                away = sorted((float(np.linalg.norm(centres[m] - middle)), m) for m in centres)
                normal = unit(np.mean([normals[m] for _, m in away[:3]], axis=0))
            else:
                normal = lent[:3, 2]
            # On a short lever it settles what the row leaves.
            pose = rigid_fit(
                np.vstack([places, places.mean(axis=0) + LEVER * np.array([0.0, 0.0, 1.0])]),
                np.vstack([points, middle + LEVER * normal]),
                np.append(weights, 1.0),
            )
            poses[module] = _pose(pose, places[:n_own], points[:n_own], sure=False)
    return poses


def module_normals(table: TaxelTable, layout: ModuleLayout) -> FloatArray:
    """(n, 3) normal of each taxel's fitted board, zero where it has none: rough, but outward."""
    normals = np.zeros((len(table), 3))
    for module, pose in fit_modules(table, layout).items():
        normals[table.modules == module] = pose.T_link_module[:3, 2]
    return normals


def _spread(places: FloatArray, weights: FloatArray) -> float:
    """Second singular value of the places over the first: 0 for a row."""
    centred = (places - np.average(places, axis=0, weights=weights)) * np.sqrt(weights)[:, None]
    values = np.linalg.svd(centred, compute_uv=False)
    return float(values[1] / values[0]) if values[0] > 0 else 0.0


def _pose(
    transform: FloatArray, places: FloatArray, points: FloatArray, *, sure: bool
) -> ModulePose:
    gap = transform_points(transform, places) - points
    residual = float(np.sqrt((gap**2).sum(axis=1).mean())) if len(points) else 0.0
    return ModulePose(transform, residual, len(points), sure)


def triangle_sheet(
    rows: Sequence[tuple[int, int]], side: float, *, turn: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 2) [m] about their mean and angles (m,) [rad] of boards of a triangular tiling.

    Parameters
    ----------
    rows : sequence of (int, int)
        First place and number of boards of each row; boards of a row share edges, and a board
        that points up stands on the one below it. Places count in half sides.
    side : float
        Of the tiling; larger than the boards' leaves gaps [m].
    turn : float
        Of the whole sheet [rad].
    """
    rise = side * np.sqrt(3.0) / 2.0
    centres, angles = [], []
    for row, (first, count) in enumerate(rows):
        for place in range(first, first + count):
            up = (row + place) % 2 == 0
            centres.append([0.5 * side * place, rise * (row + (0.0 if up else 1.0 / 3.0))])
            angles.append(0.0 if up else np.pi)
    places = np.array(centres) - np.mean(centres, axis=0)
    return places @ plane_turns(turn).T, np.array(angles) + turn


def taxel_table(
    poses: FloatArray, layout: ModuleLayout, *, unmounted: Sequence[tuple[int, int]] = ()
) -> TaxelTable:
    """Taxels of boards at T_link_module (m, 4, 4); channel = module * slots + slot.

    `unmounted` lists (module, slot) of pads that are not there.
    """
    places = np.column_stack([layout.xy, np.zeros(len(layout))])
    positions = np.concatenate([transform_points(pose, places) for pose in poses])
    normals = np.repeat(poses[:, :3, 2], len(layout), axis=0)
    channels: IntArray = np.arange(len(positions))
    absent = [module * len(layout) + slot for module, slot in unmounted]
    keep = np.tile(~layout.thermal, len(poses)) & ~np.isin(channels, absent)
    return TaxelTable(channels[keep], channels[keep] // len(layout), positions[keep], normals[keep])

"""Fitting module layouts to placed taxels: where each rigid board really lies; sheets of boards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray, freeze
from skinmap.geometry.rigid import plane_turns, rigid_fit, transform_points
from skinmap.geometry.triangles import unit
from skinmap.skin.layouts import ModuleLayout
from skinmap.skin.taxels import TaxelTable

SHARED_WEIGHT = 0.5  # of the place that several slots share: the module's centre within 1 mm
SPREAD = 0.1  # second singular value against the first: below, the taxels stand in a row
LEVER = 5e-3  # length at which a borrowed normal holds a module that stands in a row [m]


@dataclass(frozen=True, eq=False, slots=True)
class ModulePose:
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

    def __post_init__(self) -> None:
        freeze(self, T_link_module=self.T_link_module)


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
            lent = None if known is None else known.get(module)
            normal = (
                lent[:3, 2]
                if lent is not None
                else _borrowed(points.mean(axis=0), normals, centres)
            )
            pose = _fit_with_normal(places, points, weights, normal)
            poses[module] = _pose(pose, places[:n_own], points[:n_own], sure=False)
    return poses


def module_normals(table: TaxelTable, layout: ModuleLayout) -> FloatArray:
    """(n, 3) normal of each taxel's fitted board, zero where it has none: rough, but outward."""
    normals = np.zeros((len(table), 3))
    for module, pose in fit_modules(table, layout).items():
        normals[table.modules == module] = pose.T_link_module[:3, 2]
    return normals


def _fit_with_normal(
    places: FloatArray, points: FloatArray, weights: FloatArray, normal: FloatArray
) -> FloatArray:
    """A rigid fit in which a borrowed normal, on a short lever, settles what the row leaves."""
    lever = LEVER * np.array([0.0, 0.0, 1.0])
    return rigid_fit(
        np.concatenate([places, places.mean(axis=0, keepdims=True) + lever]),
        np.concatenate([points, points.mean(axis=0, keepdims=True) + LEVER * normal]),
        np.append(weights, 1.0),
    )


def _borrowed(
    point: FloatArray, normals: Mapping[int, FloatArray], centres: Mapping[int, FloatArray]
) -> FloatArray:
    """Mean normal of the three nearest modules whose pose is sure."""
    names = sorted(centres, key=lambda name: float(np.linalg.norm(centres[name] - point)))[:3]
    return unit(np.mean([normals[name] for name in names], axis=0))


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

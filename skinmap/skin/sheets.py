"""Sheets of triangular modules, pieces of the triangular tiling, and the taxels of their boards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import plane_turns, transform_points
from skinmap.skin.layouts import ModuleLayout
from skinmap.skin.taxels import TaxelTable


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

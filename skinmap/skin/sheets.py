"""Sheets of triangular modules, and how rigid boards of them lie on a body.

A sheet is a piece of the triangular tiling. On an elliptic cone the tiling is rolled up without
strain and each board then lies flat in the tangent plane at its centre. Elsewhere boards are
hinged at their shared edges. Boards on a convex body laid either way never cut each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import brentq

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.cones import EllipticCone
from skinmap.geometry.rigid import plane_turns, transform_points
from skinmap.skin.layouts import ModuleLayout
from skinmap.skin.taxels import TaxelTable

HALF_TURN = np.diag([-1.0, -1.0, 1.0])


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


def lay_on_cone(
    cone: EllipticCone,
    centres: FloatArray,
    angles: FloatArray,
    *,
    angle: float,
    height: float,
) -> FloatArray:
    """T_link_module (m, 4, 4) of flat boards tangent to an elliptic cone.

    Parameters
    ----------
    cone : EllipticCone
    centres, angles : (m, 2) array of float, (m,) array of float
        Of the boards in the plane development [m, rad].
    angle, height : float
        Where the origin of the plane lies on the cone [rad, m].
    """
    positions, frames = cone.unrolled(centres, angle=angle, height=height)
    poses = np.tile(np.eye(4), (len(centres), 1, 1))
    poses[:, :3, :3] = frames @ _turns(angles)
    poses[:, :3, 3] = positions
    return poses


def hinge(
    T_link_module: FloatArray, edge: int, side: float, height: Callable[[FloatArray], float]
) -> FloatArray:
    """T_link_module (4, 4) of a board that shares an edge with another and dips to the body.

    Parameters
    ----------
    T_link_module : (4, 4) array of float
        Of the other board.
    edge : int
        Which of its edges: 0 below, 1 to the right, 2 to the left.
    side : float
        [m].
    height : callable
        Positive outside the body, negative inside, for a point (3,).
    """
    apothem = side / (2.0 * np.sqrt(3.0))
    T_module_edge = np.eye(4)
    T_module_edge[:3, :3] = _turns(np.array([edge * 2.0 * np.pi / 3.0]))[0]
    T_module_edge[:3, 3] = T_module_edge[:3, :3] @ [0.0, -apothem, 0.0]
    T_edge_next = np.eye(4)
    T_edge_next[:3, :3] = HALF_TURN
    T_edge_next[:3, 3] = [0.0, -apothem, 0.0]

    def folded(angle: float) -> FloatArray:
        bend = np.eye(4)
        bend[1:3, 1:3] = plane_turns(angle)
        return np.asarray(T_link_module @ T_module_edge @ bend @ T_edge_next)

    best = brentq(lambda angle: height(folded(angle)[:3, 3]), 0.0, np.pi / 2.0, xtol=1e-14)
    return folded(float(best))


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


def _turns(angles: FloatArray) -> FloatArray:
    """(m, 3, 3) rotations about z by angles (m,) [rad]."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0] = np.sin(angles)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1.0
    return turns

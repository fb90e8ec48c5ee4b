"""Starts of the wrap: a board laid on a surface through the surface's own flat coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from calibration.patch.link_surface import THIN, Target
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.log_maps import log_map

REACH = 1.25  # of a log map, in sizes of the board: paths along edges are a tenth longer
NEAR = 12  # surface points whose coordinates place one taxel


def log_map_start(
    target: Target, layout: FloatArray, places: FloatArray, points: FloatArray, source: FloatArray
) -> FloatArray:
    """Taxels (n, 3) [m] where a log map around a source point (3,) puts the layout (n, 2).

    The log map gives the surface plane coordinates; the layout is moved there by the rigid
    motion that takes known places (k, 2) of it best to their points (k, 3), and carried back to
    the surface. What lies beyond the map's reach is carried on in the plane of its nearest
    known points.
    """
    best: tuple[float, FloatArray, FloatArray, FloatArray] | None = None
    for vertices, uv, there in _maps(target, layout, points, source):
        turn, shift = rigid_2d(places, there)
        missed = float(np.linalg.norm(places @ turn.T + shift - there, axis=1).mean())
        if best is None or missed < best[0]:
            best = missed, vertices, uv, layout @ turn.T + shift
    assert best is not None
    _, vertices, uv, wanted = best
    # Where the map overlaps itself (round a limb) the place on the near side counts: the
    # nearest few in the plane, of those the ones on the sheet of the nearest one.
    _, index = cKDTree(uv).query(wanted, k=min(NEAR, len(uv)))
    return _moving_affine(vertices, uv, wanted, index)


def log_map_places(target: Target, layout: FloatArray, points: FloatArray) -> list[FloatArray]:
    """Plane coordinates (k, 2) [m] of points (k, 3) in a log map round their middle.

    One array for each side of the surface: two where it is a thin shell.
    """
    middle = points[np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1))]
    return [there for _, _, there in _maps(target, layout, points, middle)]


def _maps(
    target: Target, layout: FloatArray, points: FloatArray, source: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Vertices (m, 3) within reach, plane coordinates (m, 2), those (k, 2) of points (k, 3)."""
    reach = REACH * float(np.linalg.norm(np.ptp(layout, axis=0))) + 0.02
    for seed in _seeds(target, source):
        uv, _ = log_map(target.vertices, target.normals, target.graph, seed, reach)
        known = np.isfinite(uv[:, 0])
        vertices, uv = target.vertices[known], uv[known]
        yield vertices, uv, uv[_on_the_near_side(vertices, uv, points)]


def _seeds(target: Target, source: FloatArray) -> list[int]:
    """The vertex at a point, and the one behind it where the surface is a thin shell there."""
    away = np.linalg.norm(target.vertices - source, axis=1)
    nearest = int(np.argmin(away))
    behind = target.normals @ target.normals[nearest] < -0.5
    other = int(np.argmin(np.where(behind, away, np.inf)))
    thin = behind.any() and away[other] < away[nearest] + THIN
    return [nearest, other] if thin else [nearest]


def _on_the_near_side(vertices: FloatArray, uv: FloatArray, points: FloatArray) -> IntArray:
    """Vertices (k,) at points (k, 3); of a shell's two sides the one that is less far away."""
    away, index = cKDTree(vertices).query(points, k=min(NEAR, len(vertices)))
    way = np.where(away < away[:, :1] + THIN, np.linalg.norm(uv[index], axis=2), np.inf)
    # Neighbours on one side are a few millimetres apart on the way too: the nearest of them.
    same = way < way.min(axis=1, keepdims=True) + 2.0 * THIN
    return np.asarray(index[np.arange(len(points)), np.argmax(same, axis=1)])


def rigid_2d(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation (2, 2), never a mirror image, and shift (2,) that take points a (k, 2) to b."""
    middle_a, middle_b = a.mean(axis=0), b.mean(axis=0)
    left, _, right = np.linalg.svd((b - middle_b).T @ (a - middle_a))
    fix = np.diag([1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    turn = left @ fix @ right
    return turn, middle_b - turn @ middle_a


def _moving_affine(
    vertices: FloatArray, uv: FloatArray, wanted: FloatArray, index: IntArray
) -> FloatArray:
    """Points (n, 3) for plane coordinates (n, 2): the affine map of the nearest known ones."""
    local, places = uv[index], vertices[index]
    # Points of another turn round the limb come close in the plane but not in space.
    same = (
        np.linalg.norm(places - places[:, :1], axis=2)
        < 5.0 * np.linalg.norm(local - local[:, :1], axis=2) + 4e-3
    )
    weight = same.astype(float)
    total = weight.sum(axis=1, keepdims=True)
    middle_uv = np.einsum("nk,nkd->nd", weight, local) / total
    middle = np.einsum("nk,nkd->nd", weight, places) / total
    du, dx = local - middle_uv[:, None], places - middle[:, None]
    gram = np.einsum("nk,nki,nkj->nij", weight, du, du) + 1e-10 * np.eye(2)
    cross = np.einsum("nk,nki,nkj->nij", weight, du, dx)
    linear = np.linalg.solve(gram, cross)
    return middle + np.einsum("ni,nij->nj", wanted - middle_uv, linear)

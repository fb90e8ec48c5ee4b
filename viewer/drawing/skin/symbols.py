"""Signs that say what a colour cannot: a taxel that is dead, stuck, saturated, noisy or silent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray
from skinmap.geometry.triangles import unit
from viewer.drawing.frame.polydata import make_mesh

THIN = 0.17  # half the width of a stroke, in radii


def _stroke(a: tuple[float, float], b: tuple[float, float]) -> list[tuple[float, float]]:
    """Corners of a bar from a to b."""
    start, end = np.array(a), np.array(b)
    along = THIN * (end - start) / np.linalg.norm(end - start)
    side = np.array([-along[1], along[0]])
    corners = (start - along - side, end + along - side, end + along + side, start - along + side)
    return [(float(x), float(y)) for x, y in corners]


_FALLING = _stroke((-0.6, 0.6), (0.6, -0.6))
_RISING = _stroke((-0.6, -0.6), (0.6, 0.6))
# Quadrilaterals of each sign in a circle of radius 1.
SIGNS: dict[str, list[list[tuple[float, float]]]] = {
    "dead": [_FALLING, _RISING],
    "stuck": [[(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]],
    "saturated": [[(-0.75, -0.5), (0.75, -0.5), (0.0, 0.8), (0.0, 0.8)]],
    "noisy": [
        _stroke((-0.75, -0.35), (-0.3, 0.4)),
        _stroke((-0.3, 0.4), (0.25, -0.4)),
        _stroke((0.25, -0.4), (0.75, 0.35)),
    ],
    "stale": [_RISING],
}


def sign_quads(name: str, grown: float = 0.0) -> FloatArray:
    """(q, 4, 2) corners of a sign; `grown` outwards for a halo."""
    quads = np.array(SIGNS[name])
    if grown:
        middle = quads.mean(axis=1, keepdims=True)
        quads = quads + grown * np.sign(np.round(quads - middle, 6))
    return quads


def sign_mesh(
    names: Sequence[str], centres: FloatArray, normals: FloatArray, radius: float, grown: float = 0
) -> pv.PolyData:
    """The signs `names` at centres (n, 3), lying across their normals (n, 3), z up [m]."""
    right = np.cross([0.0, 0.0, 1.0], normals)
    steep = np.linalg.norm(right, axis=1) < 0.1
    right[steep] = [1.0, 0.0, 0.0]
    right = unit(right - np.einsum("ij,ij->i", right, normals)[:, None] * normals)
    up = np.cross(normals, right)
    corners = []
    for name, centre, x, y in zip(names, centres, right, up, strict=True):
        quads = radius * sign_quads(name, grown)
        corners.append(centre + quads[..., :1] * x + quads[..., 1:] * y)
    points = np.concatenate(corners).reshape(-1, 3) if corners else np.zeros((0, 3))
    return make_mesh(points, np.arange(len(points)).reshape(-1, 4))

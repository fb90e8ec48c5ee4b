"""Which taxel lies under the mouse, on the body or on the flat map."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree
from vtkmodules.vtkCommonMath import vtkMatrix4x4
from vtkmodules.vtkRenderingCore import vtkRenderer

from skinmap.arrays import FloatArray, IntArray
from viewer.drawing.frame.camera import FACING

Where = Literal["body", "map"]
SHARE = 0.75  # of the spacing: how far beside a taxel it is still meant
NEAR_PX = 4.0  # however small taxels are in the picture, so near is near enough [px]
SHEET = 0.015  # taxels that lie so much deeper than the first belong to another side [m]


@dataclass(frozen=True, slots=True)
class Pick:
    """One taxel that the mouse points at.

    Attributes
    ----------
    part : str
    taxel : int
        Dense row.
    where : {"body", "map"}
    """

    part: str
    taxel: int
    where: Where


@dataclass(frozen=True, slots=True)
class Ray:
    """From the camera through a pixel.

    Attributes
    ----------
    origin, direction : (3,) float
        In the world [m]; unit direction.
    spread : float
        How wide a pixel is per metre of way [m].
    """

    origin: FloatArray
    direction: FloatArray
    spread: float


@dataclass(frozen=True, eq=False, slots=True)
class Target:
    """The taxels of one part in the world: positions, normals (n, 3) [m] and their spacing [m]."""

    part: str
    positions: FloatArray
    normals: FloatArray
    spacing: float


def within(renderer: vtkRenderer, x: float, y: float) -> bool:
    """Whether a pixel of the window lies in a renderer."""
    left, bottom = renderer.GetOrigin()
    width, height = renderer.GetSize()
    return bool(left <= x < left + width and bottom <= y < bottom + height)


def world_points(renderer: vtkRenderer, x: float, y: float) -> tuple[FloatArray, FloatArray]:
    """World points (3,) [m] that a pixel of the window shows nearest and furthest."""
    left, bottom = renderer.GetOrigin()
    width, height = renderer.GetSize()
    matrix = vtkMatrix4x4()
    camera = renderer.GetActiveCamera()
    matrix.DeepCopy(camera.GetCompositeProjectionTransformMatrix(width / height, -1.0, 1.0))
    T_clip_world = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    u, v = 2.0 * (x - left) / width - 1.0, 2.0 * (y - bottom) / height - 1.0
    ends = np.linalg.solve(T_clip_world, np.array([[u, v, -1.0, 1.0], [u, v, 1.0, 1.0]]).T).T
    near, far = ends[:, :3] / ends[:, 3:]
    return near, far


def ray(renderer: vtkRenderer, x: float, y: float) -> Ray:
    """The ray through a pixel of the window."""
    near, far = world_points(renderer, x, y)
    camera = renderer.GetActiveCamera()
    way = far - near
    half = np.tan(np.radians(camera.GetViewAngle() / 2))
    spread = 2.0 * float(half) / renderer.GetSize()[1]
    return Ray(np.array(camera.GetPosition()), way / np.linalg.norm(way), spread)


def pick_on_body(
    ray: Ray, targets: Iterable[Target], hidden: Callable[[FloatArray, FloatArray], bool]
) -> Pick | None:
    """The taxel that a ray meets first, if it faces the camera and nothing hides it.

    Parameters
    ----------
    ray : Ray
    targets : iterable of Target
    hidden : callable
        Of a position (3,) [m] and its normal: whether the camera does not see it.
    """
    best: tuple[float, float, Pick, FloatArray, FloatArray] | None = None
    for target in targets:
        way = target.positions - ray.origin
        depth = way @ ray.direction
        beside = np.linalg.norm(way - depth[:, None] * ray.direction, axis=1)
        reach = np.maximum(SHARE * target.spacing, NEAR_PX * ray.spread * depth)
        facing = -(target.normals @ ray.direction) > FACING
        near = np.flatnonzero((depth > 0) & (beside < reach) & facing)
        if len(near) == 0:
            continue
        near = near[depth[near] < depth[near].min() + SHEET]
        taxel = int(near[np.argmin(beside[near])])
        found = (float(depth[taxel]), float(beside[taxel]))
        if best is None or _before(found, best[:2]):
            pick = Pick(target.part, taxel, "body")
            best = (*found, pick, target.positions[taxel], target.normals[taxel])
    if best is None or hidden(best[3], best[4]):
        return None
    return best[2]


def _before(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether (depth, distance beside the ray) is meant rather than another one."""
    if abs(one[0] - other[0]) < SHEET:
        return one[1] < other[1]
    return one[0] < other[0]


class MapTargets:
    """The vertices of a part's flat map; a taxel on a seam has two or more.

    Parameters
    ----------
    part : str
    taxels : (k,) int
        Taxel of each vertex.
    uv : (k, 2) float
        [m].
    spacing : float
        Between taxels [m].
    """

    def __init__(self, part: str, taxels: IntArray, uv: FloatArray, spacing: float) -> None:
        self.part, self.taxels, self.uv, self.spacing = part, taxels, uv, spacing
        self._tree = cKDTree(uv)

    def at(self, uv: FloatArray, metres: float) -> Pick | None:
        """The taxel at a place (2,) [m] of the map, where a pixel is `metres` wide."""
        reach = max(SHARE * self.spacing, NEAR_PX * metres)
        distance, row = self._tree.query(uv, distance_upper_bound=reach)
        if not np.isfinite(distance):
            return None
        return Pick(self.part, int(self.taxels[row]), "map")

"""A scene as plain triangles, for files that other programs show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.triangles import unit
from skinmap.skin.skin import Skin
from viewer.drawing.body.bare_body import body_meshes
from viewer.scene import Scene

CORNERS = 6
CELL = 3e-3  # vertices of the body within so much become one: files stay small [m]
DISC_SHARE = 0.46  # a disc's radius in spacings: neighbours do not touch
LIFT = 2.0e-3  # of discs above the taxels [m]


@dataclass(frozen=True, eq=False, slots=True)
class Solid:
    """Triangles of one link or of one part's taxels, in the frame of the link.

    Attributes
    ----------
    name, link : str
    vertices, normals : (v, 3) float
        [m], unit.
    faces : (m, 3) int
    """

    name: str
    link: str
    vertices: FloatArray
    normals: FloatArray
    faces: IntArray


def body_solids(scene: Scene) -> list[Solid]:
    """The links that the scene draws."""
    meshes = body_meshes(scene.robot, scene.canvas.body.links, cell=CELL)
    return [_solid(link, mesh) for link, mesh in meshes.items() if mesh.n_cells]


def _solid(link: str, mesh: pv.PolyData) -> Solid:
    faces = np.asarray(mesh.triangulate().regular_faces, np.int64)
    normals = np.asarray(mesh.point_data["Normals"], np.float64)
    return Solid(link, link, np.asarray(mesh.points, np.float64), normals, faces)


def disc_solid(skin: Skin) -> tuple[Solid, IntArray]:
    """A hexagon for each taxel (n of them), and the taxel (6 n,) of each of its corners."""
    n = len(skin)
    radius = DISC_SHARE * median_spacing(skin.positions)
    least = np.eye(3)[np.argmin(np.abs(skin.normals), axis=1)]
    right = unit(np.cross(skin.normals, least))
    up = np.cross(skin.normals, right)
    angle = np.arange(CORNERS) * 2 * np.pi / CORNERS
    ring = np.cos(angle)[:, None] * right[:, None] + np.sin(angle)[:, None] * up[:, None]
    corners = (skin.positions + LIFT * skin.normals)[:, None] + radius * ring
    fan = np.array([[0, k, k + 1] for k in range(1, CORNERS - 1)])
    faces = (CORNERS * np.arange(n)[:, None, None] + fan).reshape(-1, 3)
    normals = np.repeat(skin.normals, CORNERS, axis=0)
    solid = Solid(skin.part, skin.link, corners.reshape(-1, 3), normals, faces)
    return solid, np.repeat(np.arange(n), CORNERS)


def skin_colours(scene: Scene, part: str) -> NDArray[np.uint8]:
    """(n, 3) what the taxels of a part show now."""
    return scene.layer.colours(scene.layer.values(part, scene.moment))

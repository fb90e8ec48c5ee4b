"""The bare body: link meshes reduced to what a screen needs, placed by joint angles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray
from skinmap.errors import UnknownNameError
from skinmap.geometry.mesh import TriangleMesh
from skinmap.geometry.rigid import transform_points
from skinmap.skin.robot import Robot
from viewer.polydata import make_mesh

REDUCTION = 0.8  # of the triangles of a fine mesh: on a screen the rest looks the same
ENOUGH = 3000  # triangles: no mesh is reduced below, however coarse it came
FEATURE_ANGLE = 45.0  # sharper edges stay sharp [deg]


def drawable(
    mesh: TriangleMesh, *, reduction: float = REDUCTION, enough: int = ENOUGH
) -> pv.PolyData:
    """A link mesh for drawing: few triangles, smooth normals, sharp edges kept.

    Parameters
    ----------
    mesh : TriangleMesh
        m triangles [m].
    reduction : float
        Largest share of the triangles to remove.
    enough : int
        Triangles that are left in any case.

    Returns
    -------
    pyvista.PolyData
        With point normals, in the frame of the mesh.
    """
    surface = make_mesh(mesh.vertices, mesh.faces)
    if mesh.faces.size == 0:
        return surface
    # CAD exports repeat each corner per triangle; unmerged, every facet would shade on its own.
    surface = surface.clean(point_merging=True)
    share = min(reduction, 1.0 - enough / surface.n_cells)
    if share > 0.0:
        surface = surface.decimate(share)
    return surface.compute_normals(
        cell_normals=False,
        split_vertices=True,
        feature_angle=FEATURE_ANGLE,
        consistent_normals=False,  # open double-walled shells have no consistent side
    )


def check_links(robot: Robot, links: Iterable[str] | None) -> tuple[str, ...]:
    """Links to draw: all that can be seen by default.

    Raises
    ------
    UnknownNameError
        A link without a mesh (says which have one).
    """
    visible = robot.body.visible_links
    chosen = visible if links is None else tuple(links)
    for link in chosen:
        if link not in visible:
            raise UnknownNameError("link with a mesh", link, visible)
    return chosen


def body_meshes(robot: Robot, links: Iterable[str] | None = None) -> dict[str, pv.PolyData]:
    """Drawable mesh of each link asked for, in the link's frame; no other link is read."""
    return {link: drawable(robot.mesh(link)) for link in check_links(robot, links)}


def body_points(
    meshes: Mapping[str, pv.PolyData], poses: Mapping[str, FloatArray], every: int = 7
) -> FloatArray:
    """(n, 3) some points of the placed body [m], enough to fit a picture around it."""
    placed = [
        transform_points(poses[link], np.asarray(mesh.points[::every], np.float64))
        for link, mesh in meshes.items()
    ]
    return np.concatenate(placed) if placed else np.zeros((0, 3))

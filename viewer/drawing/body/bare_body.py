"""The bare body: link meshes reduced to what a screen needs, placed by joint angles."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
import pyvista as pv

from skinmap.errors import UnknownNameError
from skinmap.geometry.mesh import TriangleMesh
from skinmap.skin.robot import Robot
from viewer.drawing.body.decimation import cluster
from viewer.drawing.frame.polydata import make_mesh

Links = Iterable[str] | Literal["all", "skin"] | None
CELL = 4e-3  # of meshes for a screen that is not known [m]


def drawable(mesh: TriangleMesh, *, cell: float = CELL) -> pv.PolyData:
    """A link mesh for drawing: few triangles, smooth normals, sharp edges kept.

    Parameters
    ----------
    mesh : TriangleMesh
        m triangles [m].
    cell : float
        Vertices within a cell of this size become one [m].

    Returns
    -------
    pyvista.PolyData
        With point normals, in the frame of the mesh.
    """
    reduced = cluster(mesh, cell)
    surface = make_mesh(reduced.vertices, reduced.faces)
    if not len(reduced.faces):
        return surface
    surface.point_data["Normals"] = reduced.normals.astype(np.float32)
    surface.point_data.active_normals_name = "Normals"
    return surface


def check_links(robot: Robot, links: Links, parts: Iterable[str] = ()) -> tuple[str, ...]:
    """Links to draw: all that can be seen by default, "skin" for those that carry `parts`.

    Raises
    ------
    UnknownNameError
        A link without a mesh (says which have one).
    """
    visible = robot.body.visible_links
    if links is None or links == "all":
        return visible
    if links == "skin":
        carrying = {robot.part(part).link for part in parts}
        return tuple(link for link in visible if link in carrying)
    chosen = (links,) if isinstance(links, str) else tuple(links)
    for link in chosen:
        if link not in visible:
            raise UnknownNameError("link with a mesh", link, visible)
    return chosen


def body_meshes(robot: Robot, links: Links = None, *, cell: float = CELL) -> dict[str, pv.PolyData]:
    """Drawable mesh of each link asked for, in the link's frame; no other link is read."""
    return {link: drawable(robot.mesh(link), cell=cell) for link in check_links(robot, links)}

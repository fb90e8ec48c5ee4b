"""The bare body: link meshes reduced to what a screen needs, placed by joint angles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError, check_known
from skinmap.geometry.triangles import TriangleMesh, cross_products, unit
from skinmap.skin.robot import Robot
from viewer.drawing.frame.polydata import make_mesh

Links = Iterable[str] | Literal["all", "skin"] | None
CELL = 4e-3  # of meshes for a screen that is not known [m]
COHERENT = 0.75  # length of a group's mean normal: below, its triangles face several ways
AWAY = -0.3  # component along a cell's main axis from which a triangle belongs to its other wall
FEW = 2000  # triangles: meshes of no more are sent to a screen that is not known as they are
CREASE = 30.0  # angle between two triangles from which their edge stays sharp there [deg]
FLAT = 1e-4  # a mesh as thin has no two walls [m]
THINNEST = 0.25  # of a cell, in thicknesses of its mesh: both walls of a plate stay apart
SIDES = 7  # one for smooth groups, and the six ways to face along an axis

SLACK = np.radians(1.0)  # encoders may read that far beyond a limit without being wrong
SLIDING_SLACK = 1e-3  # the same where a joint slides [m]


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
        A link without a mesh (lists those with one).
    """
    visible = robot.body.visible_links
    if links is None or links == "all":
        return visible
    if links == "skin":
        carrying = {robot.part(part).link for part in parts}
        return tuple(link for link in visible if link in carrying)
    chosen = (links,) if isinstance(links, str) else tuple(links)
    check_known("link with a mesh", chosen, visible)
    return chosen


def body_meshes(robot: Robot, links: Links = None, *, cell: float = CELL) -> dict[str, pv.PolyData]:
    """Drawable mesh of each link asked for, in the link's frame; no other link is read.

    Those of few triangles are whole; vertices of others become one within a cell of so much [m].
    """
    meshes = {link: robot.mesh(link) for link in check_links(robot, links)}
    return {
        link: whole(mesh)
        if 0 < len(mesh.faces) <= FEW
        else drawable(mesh, cell=min(cell, THINNEST * _thickness(mesh)))
        for link, mesh in meshes.items()
    }


def whole(mesh: TriangleMesh) -> pv.PolyData:
    """A link mesh with all its triangles and point normals, split at sharp edges."""
    surface = make_mesh(mesh.vertices, mesh.faces).clean(
        lines_to_points=False, polys_to_lines=False
    )
    return surface.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=CREASE, consistent_normals=False
    )


def _thickness(mesh: TriangleMesh) -> float:
    """The shortest side of the box around a mesh that has one [m]; infinite of a flat one."""
    sides = np.ptp(mesh.vertices, axis=0) if len(mesh.vertices) else np.zeros(3)
    return float(np.min(sides, initial=np.inf, where=sides > FLAT))


@dataclass(frozen=True, eq=False, slots=True)
class Clustered:
    """A reduced mesh.

    Attributes
    ----------
    vertices, normals : (v, 3) float
        [m] and unit; vertices of a sharp edge are there once for each side of it.
    faces : (m, 3) int
        As the mesh's own, counter-clockwise seen from outside.
    """

    vertices: FloatArray
    normals: FloatArray
    faces: IntArray


def cluster(mesh: TriangleMesh, cell: float) -> Clustered:
    """Merge the vertices within each cell of a grid; triangles that collapse disappear.

    Linear in the number of triangles, so a whole robot is reduced at each start and nothing is kept
    on disk. After Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex
    scenes", 1993; the normals are ours.

    Triangles of a cell that face one way get one normal, so that smooth surfaces shade smoothly;
    where they do not, at an edge or a corner, each side gets its own, so that it stays sharp. So
    do the two walls of a thin cover. Vertices of one cell share their place: nothing tears.

    Parameters
    ----------
    mesh : TriangleMesh
        m triangles [m]; repeated corners, as in CAD exports, do no harm.
    cell : float
        Side of a cell [m]: no vertex moves further than its diagonal.
    """
    if mesh.faces.size == 0:
        none = np.zeros((0, 3))
        return Clustered(none, none, np.zeros((0, 3), np.int64))
    corners = cell_numbers(mesh.vertices, cell)[mesh.faces].ravel()
    # Of each triangle, then of each of its corners: as much work as possible before the latter.
    cross = cross_products(mesh.vertices, mesh.faces)
    length, size = np.linalg.norm(cross, axis=1), np.abs(cross)
    axis, face = size.argmax(axis=1), np.arange(len(cross))
    side = np.repeat(1 + 2 * axis + (cross[face, axis] < 0.0), 3)
    weight, own = np.repeat(length, 3), np.repeat(face, 3)
    main = _sums(corners, [np.repeat(column, 3) for column in size.T]).argmax(axis=1)[corners]
    groups = 2 * corners + (cross[own, main] < AWAY * weight)
    place = _sums(corners, [column[mesh.faces].ravel() * weight for column in mesh.vertices.T])
    place /= np.maximum(np.bincount(corners, weight), 1e-30)[:, None]
    total, normals = np.bincount(groups, weight), [np.repeat(column, 3) for column in cross.T]
    sharp = np.linalg.norm(_sums(groups, normals), axis=1) < COHERENT * total
    # Triangles that collapse still say which way the surface faces, so they count for normals.
    used, keys = _used(SIDES * groups + np.where(sharp[groups], side, 0))
    a, b, c = corners.reshape(-1, 3).T
    faces = _distinct(keys.reshape(-1, 3)[(a != b) & (b != c) & (c != a)])
    drawn, numbers = _used(faces)
    vertices = place[used[drawn] // (2 * SIDES)]
    return Clustered(vertices, unit(_sums(keys, normals)[drawn]), numbers.reshape(-1, 3))


def cell_numbers(points: FloatArray, cell: float) -> IntArray:
    """(n,) number from 0 of the occupied cell in which each point (n, 3) lies."""
    grid = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    columns, rows = grid[:, 1].max() + 1, grid[:, 2].max() + 1
    key = (grid[:, 0] * columns + grid[:, 1]) * rows + grid[:, 2]
    return np.asarray(np.unique(key, return_inverse=True)[1].reshape(-1))


def _used(numbers: IntArray) -> tuple[IntArray, IntArray]:
    """As `np.unique` with its inverse, in linear time for numbers that lie close together."""
    there = np.zeros(int(numbers.max(initial=0)) + 1, bool)
    there[numbers] = True
    return np.flatnonzero(there), (np.cumsum(there) - 1)[numbers]


def _sums(groups: IntArray, columns: Sequence[FloatArray]) -> FloatArray:
    """(g, 3) sum of three columns (k,) in each group 0..g-1."""
    return np.stack([np.bincount(groups, column) for column in columns], axis=1)


def _distinct(faces: IntArray) -> IntArray:
    """Faces without repetition; those with the same corners the other way round stay."""
    first = faces.argmin(axis=1)
    row = np.arange(len(faces))
    turned = np.stack([faces[row, (first + k) % 3] for k in range(3)], axis=1)
    size = int(faces.max(initial=0)) + 1
    key = (turned[:, 0] * size + turned[:, 1]) * size + turned[:, 2]
    return np.asarray(turned[np.unique(key, return_index=True)[1]])


def posed(robot: Robot, angles: Mapping[str, float]) -> dict[str, FloatArray]:
    """T_root_link (4, 4) of every link; joints not named stand as in the robot's natural pose.

    Raises
    ------
    UnknownNameError
        A joint that the body lacks.
    InvalidArrayError
        An angle that is not finite or beyond the joint's limits; names it, and both in degrees.
    """
    limits, slides = robot.body.joints, robot.body.sliding_joints
    for joint, angle in angles.items():
        check_known("joint", [joint], limits)
        low, high = limits[joint]
        slack = SLIDING_SLACK if joint in slides else SLACK
        if not low - slack <= angle <= high + slack:  # false for NaN
            at, least, most = (readable(one, sliding=joint in slides) for one in (angle, low, high))
            raise InvalidArrayError(
                f"joint {joint!r} cannot be at {at}: its limits are {least} to {most}"
            )
    return robot.body.poses({**robot.pose, **angles})


def readable(angle: float, *, sliding: bool = False) -> str:
    """A joint's angle [rad] in degrees; where it slides its way [m] in millimetres."""
    return f"{1e3 * angle:.1f} mm" if sliding else f"{np.degrees(angle):.1f} degrees"

"""Flat maps of bare triangle meshes: any component of any file, not only skins."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, IntArray, check_faces, check_points
from skinmap.errors import InvalidMeshError, SkinWarning
from skinmap.flat.flat_map import FlatMap, flatten
from skinmap.flat.seams import split_along
from skinmap.geometry.topology import edge_keys, half_edges
from skinmap.geometry.triangles import smallest_altitudes, vertex_normals
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh, by_size

NO_AREA = 1e-12  # altitude against the size of the mesh: flatter triangles join nothing
STRAIGHT = 0.75  # cosine: faces that bend less than 41 degrees at a crowded edge stay one sheet
MAX_COMPONENTS = 5000  # of one file: each is a patch with a map of its own


def flatten_mesh(
    vertices: ArrayLike, faces: ArrayLike, *, name: str = "mesh", **options: Any
) -> FlatMap:
    """Lay each connected component of any triangle mesh flat, cut open where it must be.

    Parameters
    ----------
    vertices : (n, 3) array-like of float
        Coincident ones are merged, unused ones ignored.
    faces : (m, 3) array-like of int
    name : str
        How the map and messages call it.
    **options
        As for `flatten`: the method and its budgets.

    Returns
    -------
    FlatMap
    With a chart for each component.

    Raises
    ------
    UnknownNameError, InvalidMeshError, FlatteningError
        No such method, a mesh that is no surface, or one that no method lays flat.

    Examples
    --------
    >>> from skinmap.flat import flatten_mesh
    >>> flat = flatten_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]])
    >>> len(flat.charts), flat.flips
    (1, 0)
    """
    return flatten(mesh_surface(vertices, faces, name=name), **options)


def mesh_surface(vertices: ArrayLike, faces: ArrayLike, *, name: str = "mesh") -> SurfaceMesh:
    """A bare triangle mesh as a surface mesh whose channels are the rows of `vertices`.

    Corners at one place become one vertex, as in files that repeat them for each face. Triangles
    without area are left out, neighbours that turn opposite ways are turned alike, and parts that
    meet in a single vertex come apart there. So do faces that meet three or more at an edge, but
    for two that go on straight into each other.

    Raises
    ------
    InvalidMeshError
        No triangle with an area, a surface with one side only, or more components than
        `MAX_COMPONENTS`.

    Warns
    -----
    SkinWarning
        Edges in three faces or more.
    """
    points = check_points(vertices, "vertices")
    triangles = check_faces(faces, len(points))
    _, first, number = np.unique(points, axis=0, return_index=True, return_inverse=True)
    try:
        triangles = _with_area(points, first[number.ravel()][triangles])
        triangles, origin = _sheets(points, triangles, name)
        triangles = _oriented(triangles)
    except InvalidMeshError as error:
        raise InvalidMeshError(f"{name}: {error}") from error
    opened, apart = split_along(triangles, np.zeros((0, 2), np.int64))
    origin = origin[apart]
    order = np.argsort(origin, kind="stable")  # rows of the file keep their order
    opened, origin = np.argsort(order)[opened], origin[order]
    patches = by_size(opened)
    if patches.max() >= MAX_COMPONENTS:
        raise InvalidMeshError(
            f"{name} falls into {patches.max() + 1} pieces, at most {MAX_COMPONENTS}: a soup of "
            "triangles whose corners nearly meet?"
        )
    corners = points[origin]
    normals = vertex_normals(corners, opened)
    skin = Skin(name, "", origin, np.zeros(len(origin), np.int64), corners, normals)
    return SurfaceMesh(skin, opened, np.arange(len(origin)), patches)


def _with_area(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Faces less those whose corners lie on one line or in one place."""
    if len(faces) == 0:
        raise InvalidMeshError("no face: a surface has at least one")
    used = vertices[np.unique(faces)]
    size = float(np.ptp(used, axis=0).max())
    kept = np.zeros(len(faces), bool)
    if size > 0:
        kept = smallest_altitudes((vertices - used.mean(axis=0)) / size, faces) > NO_AREA
    if not kept.any():
        raise InvalidMeshError(f"none of {len(faces)} faces has an area")
    return np.asarray(faces[kept])


def _sheets(vertices: FloatArray, faces: IntArray, name: str) -> tuple[IntArray, IntArray]:
    """Faces with no edge in more than two of them, and the old vertex (k,) of each new one."""
    directed = half_edges(faces)
    lines, number, count = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    number = number.ravel()
    crowded = np.flatnonzero(count > 2)
    if len(crowded):
        warnings.warn(
            f"{name}: {len(crowded)} edges in three faces or more: taken apart into sheets there",
            SkinWarning,
            stacklevel=2,
        )
    straight = [
        pair
        for line in crowded.tolist()
        for pair in _straight_pairs(vertices, faces, lines[line], np.flatnonzero(number == line))
    ]
    return split_along(faces, lines[crowded], joined=np.array(straight, np.int64).reshape(-1, 2))


def _straight_pairs(
    vertices: FloatArray, faces: IntArray, line: IntArray, beside: IntArray
) -> Iterator[tuple[int, int]]:
    """Half-edges at one edge whose faces go on into each other, the straightest first."""
    corners = faces[beside // 3]
    third = corners.sum(axis=1) - line.sum()
    along = vertices[line[1]] - vertices[line[0]]
    away = vertices[third] - vertices[line[0]]
    away = away - np.outer(away @ along / (along @ along), along)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    bend = away @ away.T  # -1 where two faces lie in one plane, on both sides of the edge
    left = set(range(len(beside)))
    for a, b in sorted(combinations(left, 2), key=lambda pair: float(bend[pair])):
        if bend[a, b] < -STRAIGHT and {a, b} <= left:
            left -= {a, b}
            yield int(beside[a]), int(beside[b])


def _oriented(faces: IntArray) -> IntArray:
    """Faces that turn the way their neighbours do; as they came where they do already."""
    import igl

    if _all_differ(edge_keys(faces)):
        return faces
    turned = np.asarray(igl.bfs_orient(faces)[0], np.int64)
    if not _all_differ(edge_keys(turned)):
        raise InvalidMeshError("the surface has one side only, as a Moebius strip: cut it first")
    return turned


def _all_differ(keys: IntArray) -> bool:
    return len(np.unique(keys)) == len(keys)

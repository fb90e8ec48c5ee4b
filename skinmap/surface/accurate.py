"""Meshing along the surface of a body: who is next to whom is measured on it, not through it."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import block_array, coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidMeshError
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.geometry.topology import (
    boundary_loops,
    by_edge,
    check_surface,
    edges,
    face_components,
    half_edges,
)
from skinmap.geometry.triangles import (
    TriangleMesh,
    cross_2d,
    cross_products,
    edge_lengths,
    face_areas,
    pair_lengths,
    smallest_altitudes,
    unit,
)
from skinmap.imports import import_meshlab
from skinmap.surface.consensus_meshing import Limits, voted_faces
from skinmap.surface.taxel_cloud import Cloud, contains, delaunay_stars

LIFT = 0.3  # in spacings: taxels are dropped onto the body from there, so on their own side of it
CROWD = 40  # nearest others, of which those on the far side of a thin part are none of a star
STRETCH = 1.6  # way along the body against straight way: on a flat lattice at most 1.16
SLACK = 0.5  # in spacings: added to it, for taxels that nearly touch
DUAL_VOTES = 2  # of a triangle of the Voronoi dual, beside up to three of its taxels' stars
ROW_HEIGHT = 0.86  # of a hexagonal lattice, in spacings: so many rings reach the longest edge
MAX_RINGS = 6
ALPHA = 1.5  # in spacings: openings narrower than this are closed over
OFFSET = 0.1  # in spacings: how far the wrap stays off the mesh
FINE = 0.35  # in spacings: longest edge that distances are measured along
LEAST = 1e-10  # of the body's size: flatter faces are none
MAX_TRIANGLES = 4_000_000  # fine triangles: more would need more than about 2 GB


def accurate_faces(cloud: Cloud, limits: Limits, body: TriangleMesh) -> IntArray:
    """Faces (m, 3) over a cloud along a body [m].

    The dual of the taxels' geodesic Voronoi cells votes first. Where cells are too coarsely
    known, stars of those neighbours that are near along the body too fill the gaps.
    """
    surface = fine_surface(TriangleMesh(cloud.to_units(body.vertices), body.faces), cloud.spacing)
    triangles, neighbours = voronoi_dual(cloud, surface)
    reached = near_along(neighbours, _rings(cloud, limits), 2.0 * limits.max_edge.max())
    near = _as_near_as_seen(cloud, reached)
    votes = delaunay_stars(cloud, limits.max_edge, neighbours=CROWD, allowed=near)
    triangles = _within(cloud, triangles, near, limits.max_edge)
    return voted_faces(cloud, limits, np.concatenate([*DUAL_VOTES * [triangles], votes]))


def voronoi_dual(cloud: Cloud, surface: TriangleMesh) -> tuple[IntArray, csr_array]:
    """Which taxels of a cloud are neighbours along a fine surface mesh in its units.

    Returns
    -------
    (t, 3) int
        Taxels whose Voronoi cells meet in a point, counter-clockwise seen from outside.
    (n, n) sparse
        Distance along the surface of taxels whose cells touch.

    References
    ----------
    Peyré and Cohen, "Geodesic Remeshing Using Front Propagation", IJCV 69, 2006 (here by
    shortest paths over the vertices of a mesh finer than the taxels).
    """
    n, k = len(surface.vertices), len(cloud.points)
    lifted = cloud.points + LIFT * cloud.spacing * unit(cloud.normals)
    _, face, site = closest_on_mesh(lifted, surface.vertices, surface.faces)
    graph = walking_graph(surface)
    onto = _landings(graph, surface, face, site)
    whole = block_array([[graph, onto], [onto.T, None]], format="csr")
    way, _, source = dijkstra(
        whole,
        directed=False,
        indices=np.arange(n, n + k),
        min_only=True,
        return_predecessors=True,
    )
    way, owner = way[:n], source[:n].astype(np.int64) - n
    corner = owner[surface.faces]
    apart = (corner != corner[:, [1, 2, 0]]).all(axis=1) & (corner >= 0).all(axis=1)
    return corner[apart], _touching(surface, way, owner, k)


def _landings(
    graph: csr_array, surface: TriangleMesh, face: IntArray, site: FloatArray
) -> csr_array:
    """(n, k) distance from each taxel's place on the surface to the vertices around it."""
    n, k = len(surface.vertices), len(site)
    corners = coo_array(
        (np.ones(3 * k), (np.repeat(np.arange(k), 3), surface.faces[face].ravel())), shape=(k, n)
    ).tocsr()
    # The corners of its triangle and all next to them: paths then start in many directions.
    around = (corners @ (graph > 0) + corners).tocoo()
    taxel, vertex = around.coords
    length = np.linalg.norm(site[taxel] - surface.vertices[vertex], axis=1)
    # A stored zero would be no edge at all.
    smallest = np.finfo(np.float64).tiny
    return coo_array((np.maximum(length, smallest), (vertex, taxel)), shape=(n, k)).tocsr()


def _touching(surface: TriangleMesh, way: FloatArray, owner: IntArray, k: int) -> csr_array:
    """Symmetric (k, k) shortest way between taxels whose cells share an edge of the surface."""
    pairs = edges(surface.faces)
    first, second = owner[pairs].T
    across = (first != second) & (first >= 0) & (second >= 0)
    pairs, first, second = pairs[across], first[across], second[across]
    length = pair_lengths(surface.vertices, pairs)
    length = length + way[pairs].sum(axis=1)
    return _shortest(
        np.concatenate([first, second]), np.concatenate([second, first]), np.tile(length, 2), k
    )


def near_along(neighbours: csr_array, rings: int, limit: float) -> csr_array:
    """(n, n) shortest way over at most so many steps between neighbours, up to a limit."""
    n = neighbours.shape[0]
    step = neighbours.tocsr()
    reached = step
    for _ in range(rings - 1):
        start, middle = reached.tocoo().coords
        degree = np.diff(step.indptr)[middle]
        entry = np.repeat(step.indptr[middle] - np.cumsum(degree) + degree, degree)
        entry = entry + np.arange(len(entry))
        length = np.repeat(reached.data, degree) + step.data[entry]
        rows, columns = np.repeat(start, degree), step.indices[entry]
        keep = (length <= limit) & (rows != columns)
        known = reached.tocoo()
        reached = _shortest(
            np.concatenate([known.coords[0], rows[keep]]).astype(np.int64),
            np.concatenate([known.coords[1], columns[keep]]).astype(np.int64),
            np.concatenate([known.data, length[keep]]),
            n,
        )
    return reached


def _shortest(rows: IntArray, columns: IntArray, length: FloatArray, n: int) -> csr_array:
    """(n, n) smallest of the lengths given for each pair."""
    key = rows * n + columns
    order = np.lexsort((length, key))
    key, first = np.unique(key[order], return_index=True)
    return coo_array((length[order][first], np.divmod(key, n)), shape=(n, n)).tocsr()


def _rings(cloud: Cloud, limits: Limits) -> int:
    return int(np.clip(np.ceil(limits.max_edge.min() / (ROW_HEIGHT * cloud.spacing)), 1, MAX_RINGS))


def _as_near_as_seen(cloud: Cloud, reached: csr_array) -> csr_array:
    """The pairs of `reached` whose way along the body is not much longer than the straight one."""
    pairs = reached.tocoo()
    first, second = pairs.coords
    straight = np.linalg.norm(cloud.points[first] - cloud.points[second], axis=1)
    keep = pairs.data <= STRETCH * straight + SLACK * cloud.spacing
    return coo_array((pairs.data[keep], (first[keep], second[keep])), shape=reached.shape).tocsr()


def _within(cloud: Cloud, triangles: IntArray, near: csr_array, limit: FloatArray) -> IntArray:
    """The triangles (t, 3) whose edges are all between near taxels and within both their limits."""
    first, second = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    length = np.linalg.norm(cloud.points[first] - cloud.points[second], axis=1)
    fits = (length <= np.minimum(limit[first], limit[second])) & contains(near, first, second)
    return triangles[fits.reshape(-1, 3).all(axis=1)]


def fine_surface(body: TriangleMesh, spacing: float) -> TriangleMesh:
    """The outer surface of a body as a closed mesh whose edges are short beside the spacing [m].

    Link meshes are open, double-walled or made of pieces: those are wrapped. A mesh that is
    closed, oriented and of one piece is divided as it is.

    Raises
    ------
    InvalidMeshError
        A body without a face that has an area, or one so large beside the spacing that millions of
        triangles would be needed.
    """
    # The wrap of a face without area ends the process.
    size = np.ptp(body.vertices, axis=0).max() if len(body.vertices) else 0.0
    whole = smallest_altitudes(body.vertices, body.faces) > LEAST * size
    body = TriangleMesh(body.vertices, body.faces[whole])
    if len(body.faces) == 0:
        raise InvalidMeshError("the body has no faces that have an area: nothing to follow")
    area = float(face_areas(body.vertices, body.faces).sum())
    needed = 4.6 * area / (FINE * spacing) ** 2  # twice the triangles that would tile it evenly
    if not needed < MAX_TRIANGLES:
        raise InvalidMeshError(
            f"the body is too large for taxels {spacing:.3g} of its units apart: about "
            f"{needed:.2g} triangles are needed, at most {MAX_TRIANGLES:.0e}; cut it to the "
            "link's part"
        )
    return _divided(body if is_closed(body) else _wrapped(body, spacing), FINE * spacing)


def is_closed(body: TriangleMesh) -> bool:
    """Whether a mesh is one closed, oriented surface with its normals outward."""
    faces = body.faces
    try:
        check_surface(faces)
        whole = len(boundary_loops(faces)) == 0 and face_components(faces).max(initial=0) == 0
    except InvalidMeshError:
        return False
    # The divergence theorem: six times the volume, negative where the mesh is inside out.
    corner = body.vertices[faces[:, 0]] - body.vertices.mean(axis=0)
    return bool(whole and (corner * cross_products(body.vertices, faces)).sum() > 0)


def _wrapped(body: TriangleMesh, spacing: float) -> TriangleMesh:
    """The alpha wrap of a body.

    References
    ----------
    Portaneri et al., "Alpha Wrapping with an Offset", SIGGRAPH 2022.
    """
    pymeshlab, meshes = _meshlab(body)
    # In per cent of the diagonal, which a body of a few taxels may be shorter than.
    share = min(50.0, 100 * spacing / float(np.linalg.norm(np.ptp(body.vertices, axis=0))))
    try:
        meshes.generate_alpha_wrap(
            alpha=pymeshlab.PercentageValue(ALPHA * share),
            offset=pymeshlab.PercentageValue(OFFSET * share),
        )
    except pymeshlab.PyMeshLabException as error:
        raise InvalidMeshError(f"the body cannot be wrapped: {error}") from error
    return _current(meshes)


def _divided(mesh: TriangleMesh, longest: float) -> TriangleMesh:
    """The mesh with edges halved until none is longer than `longest`."""
    pymeshlab, meshes = _meshlab(mesh)
    most = float(edge_lengths(mesh.vertices, mesh.faces).max()) / longest
    rounds = int(np.ceil(np.log2(max(1.0, most))))
    if rounds > 0:
        meshes.meshing_surface_subdivision_midpoint(
            iterations=rounds, threshold=pymeshlab.PureValue(longest)
        )
    return _current(meshes)


def _meshlab(mesh: TriangleMesh) -> tuple[Any, Any]:
    """PyMeshLab, and a mesh in its hands."""
    pymeshlab = import_meshlab()
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    return pymeshlab, meshes


def _current(meshes: Any) -> TriangleMesh:
    made = meshes.current_mesh()
    return TriangleMesh(made.vertex_matrix(), made.face_matrix().astype(np.int64))


def walking_graph(mesh: TriangleMesh) -> csr_array:
    """Symmetric (n, n) lengths of the mesh's edges and of the diagonals across each of them.

    With diagonals, laid flat where they cross their edge, shortest paths over the vertices are
    a few per cent too long instead of 15.
    """
    start, end, length = np.concatenate([_sides(mesh), _diagonals(mesh)], axis=1)
    n = len(mesh.vertices)
    rows, columns = start.astype(np.int64), end.astype(np.int64)
    # Parallel entries would be added up: keep each pair once.
    key, first = np.unique(
        np.minimum(rows, columns) * n + np.maximum(rows, columns), return_index=True
    )
    graph = coo_array((length[first], np.divmod(key, n)), shape=(n, n)).tocsr()
    return graph + graph.T


def _sides(mesh: TriangleMesh) -> FloatArray:
    pairs = edges(mesh.faces)
    return np.vstack([pairs.T, pair_lengths(mesh.vertices, pairs)])


def _diagonals(mesh: TriangleMesh) -> FloatArray:
    """(3, d) both ends and length of the diagonals of pairs of neighbouring triangles."""
    a, b, c, d = _quads(mesh.faces)
    points = mesh.vertices
    along = points[b] - points[a]
    length = np.linalg.norm(along, axis=1)
    keep = length > 0
    a, b, c, d, length = a[keep], b[keep], c[keep], d[keep], length[keep]
    along = along[keep] / length[:, None]
    left, right = points[c] - points[a], points[d] - points[a]
    x_left, x_right = (left * along).sum(axis=1), (right * along).sum(axis=1)
    y_left = np.linalg.norm(left - x_left[:, None] * along, axis=1)
    y_right = -np.linalg.norm(right - x_right[:, None] * along, axis=1)
    one, other = np.stack([x_left, y_left], 1), np.stack([x_right, y_right], 1)
    height = y_left - y_right
    crossing = np.divide(cross_2d(other, one), height, out=-np.ones_like(height), where=height > 0)
    convex = (crossing >= 0) & (crossing <= length)
    return np.stack([c[convex], d[convex], np.linalg.norm(one - other, axis=1)[convex]])


def _quads(faces: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Ends a, b of each inner edge with the corners c, d opposite to it."""
    start, end = half_edges(faces).T
    opposite = faces[:, [2, 0, 1]].ravel()
    order, same = by_edge(faces)
    first, second = order[:-1][same], order[1:][same]
    return start[first], end[first], opposite[first], opposite[second]

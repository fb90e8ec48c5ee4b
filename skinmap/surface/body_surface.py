"""A link mesh made fit to measure along: closed, without inner walls, finely divided."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidMeshError
from skinmap.geometry.mesh import TriangleMesh
from skinmap.geometry.topology import boundary_loops, check_surface, face_components, half_edges
from skinmap.geometry.triangles import (
    cross_2d,
    cross_products,
    edge_lengths,
    face_areas,
    smallest_altitudes,
)

ALPHA = 1.5  # in spacings: openings narrower than this are closed over
OFFSET = 0.1  # in spacings: how far the wrap stays off the mesh
FINE = 0.35  # in spacings: longest edge that distances are measured along
LEAST = 1e-10  # of the body's size: flatter faces are none
MOST = 4_000_000  # fine triangles: more would need more than about 2 GB


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
    body = TriangleMesh(body.vertices, body.faces[_has_area(body)])
    if len(body.faces) == 0:
        raise InvalidMeshError("the body has no faces that have an area: nothing to follow")
    area = float(face_areas(body.vertices, body.faces).sum())
    needed = 4.6 * area / (FINE * spacing) ** 2  # twice the triangles that would tile it evenly
    if not needed < MOST:
        raise InvalidMeshError(
            f"the body is too large for taxels {spacing:.3g} of its units apart: about "
            f"{needed:.2g} triangles are needed, at most {MOST:.0e}; cut it to the link's part"
        )
    return _divided(body if is_closed(body) else _wrapped(body, spacing), FINE * spacing)


def _has_area(body: TriangleMesh) -> BoolArray:
    """(m,) whether a face is more than a rounding error beside the body."""
    size = np.ptp(body.vertices, axis=0).max() if len(body.vertices) else 0.0
    altitude = smallest_altitudes(body.vertices, body.faces)
    return np.asarray(altitude > LEAST * size)


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
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(body.vertices, body.faces))
    # In per cent of the diagonal, which a body of a few taxels may be shorter than.
    share = min(50.0, 100 * spacing / float(np.linalg.norm(np.ptp(body.vertices, axis=0))))
    try:
        meshes.generate_alpha_wrap(
            alpha=pymeshlab.PercentageValue(ALPHA * share),
            offset=pymeshlab.PercentageValue(OFFSET * share),
        )
    except pymeshlab.PyMeshLabException as error:
        raise InvalidMeshError(f"the body cannot be wrapped: {error}") from error
    wrap = meshes.current_mesh()
    return TriangleMesh(wrap.vertex_matrix(), wrap.face_matrix().astype(np.int64))


def _divided(mesh: TriangleMesh, longest: float) -> TriangleMesh:
    """The mesh with edges halved until none is longer than `longest`."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    rounds = int(
        np.ceil(np.log2(max(1.0, edge_lengths(mesh.vertices, mesh.faces).max() / longest)))
    )
    if rounds > 0:
        meshes.meshing_surface_subdivision_midpoint(
            iterations=rounds, threshold=pymeshlab.PureValue(longest)
        )
    fine = meshes.current_mesh()
    return TriangleMesh(fine.vertex_matrix(), fine.face_matrix().astype(np.int64))


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
    start, end = half_edges(mesh.faces).T
    length = np.linalg.norm(mesh.vertices[start] - mesh.vertices[end], axis=1)
    return np.stack([start, end, length])


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
    n = int(faces.max()) + 1
    key = np.minimum(start, end) * n + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    twin = key[order[1:]] == key[order[:-1]]
    first, second = order[:-1][twin], order[1:][twin]
    return start[first], end[first], opposite[first], opposite[second]

"""A finer surface through the taxels, and the sparse matrix that carries pressures onto it.

Each edge is halved by the cubic Hermite curve through its two ends (values and slopes). The
taxels stay where they are and keep their values exactly; values and positions are linear in the
taxels' own, so one sparse product per sample colours the whole skin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, vstack

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.topology import half_edges
from skinmap.geometry.triangles import cross_products, unit
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh

RIM = 12  # corners of the disc of a taxel without a surface


@dataclass(frozen=True, eq=False, slots=True)
class FineSurface:
    """A refined surface mesh with v vertices over n taxels.

    Attributes
    ----------
    positions, normals : (v, 3) float
        [m] and unit, outward. The first vertices are the taxels that faces use.
    faces : (m, 3) int
        Vertices, counter-clockwise seen from outside.
    smooth : (v, n) sparse
        Pressures of the taxels to values of the vertices; rows sum to 1.
    linear : (v, n) sparse
        The same by straight edges: for the flat map, whose triangles are flat.
    taxels : (k,) int
        Taxel of each of the first k vertices.
    coarse : (c, 3) int
        Triangles over those, before any edge was halved.
    """

    positions: FloatArray
    normals: FloatArray
    faces: IntArray
    smooth: csr_array
    linear: csr_array
    taxels: IntArray
    coarse: IntArray


def refine(mesh: SurfaceMesh, levels: int = 1) -> FineSurface:
    """Halve each edge of a surface mesh `levels` times; gaps and holes stay as they are.

    Taxels without a surface become discs, each a fan of triangles that has the taxel's own value.
    """
    if len(mesh.faces):
        taxels, compact = np.unique(mesh.faces, return_inverse=True)
        faces = compact.reshape(-1, 3)
        positions, normals = mesh.vertices[taxels], mesh.skin.normals[taxels]
    else:
        taxels, positions, faces = _discs(mesh.skin)
        normals = mesh.skin.normals[taxels]
    coarse = faces
    n = len(mesh.representative)
    # Taxels that are one vertex of the mesh have its mean.
    smooth = means(mesh.representative, np.arange(n), (n, n))[taxels]
    linear = smooth
    for _ in range(levels):
        ends, halves = split(faces)
        rows = np.repeat(np.arange(len(ends)), 2)
        middle = means(rows, ends.ravel(), (len(ends), len(positions)))
        slopes = _slopes(positions, faces, ends)
        smooth = vstack([smooth, (middle + slopes) @ smooth], format="csr")
        linear = vstack([linear, middle @ linear], format="csr")
        positions = np.vstack([positions, _curved(positions, normals, ends)])
        normals = np.vstack([normals, unit(normals[ends[:, 0]] + normals[ends[:, 1]])])
        faces = halves
    return FineSurface(positions, normals, faces, smooth, linear, taxels, coarse)


def _discs(skin: Skin) -> tuple[IntArray, FloatArray, IntArray]:
    """Taxel (k,), place (k, 3) [m] and triangles (c, 3) of discs around taxels that touch."""
    angle = np.arange(RIM) * 2.0 * np.pi / RIM
    ring = 0.5 * skin.spacing * np.column_stack([np.cos(angle), np.sin(angle)])
    fans = np.concatenate([np.zeros((1, 2)), ring]) @ tangent_frames(skin.normals)
    points = skin.positions[:, None] + fans
    spoke = 1 + np.arange(RIM)
    fan = np.column_stack([np.zeros(RIM, np.int64), spoke, 1 + spoke % RIM])
    faces = fan + (RIM + 1) * np.arange(len(skin))[:, None, None]
    taxels = np.repeat(np.arange(len(skin)), RIM + 1)
    return taxels, points.reshape(-1, 3), faces.reshape(-1, 3)


def flat_vertices(fine: FineSurface, flat: FlatMap) -> FloatArray:
    """(v, 2) places of a fine surface's vertices on the flat map [m]."""
    uv = np.asarray(fine.linear @ np.nan_to_num(flat.uv))
    if len(flat.mesh.faces) == 0:  # discs: as wide as on the body
        skin = flat.mesh.skin
        away = fine.positions - fine.linear @ skin.positions
        uv += np.einsum("vij,vj->vi", tangent_frames(fine.linear @ skin.normals), away)
    return uv


def split(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Edges (e, 2), and the four triangles of each face: new vertices are numbered by edge."""
    directed = np.sort(half_edges(faces), axis=1)
    ends, number = np.unique(directed, axis=0, return_inverse=True)
    middle = number.reshape(-1, 3) + (int(faces.max(initial=-1)) + 1)
    a, b, c = faces.T
    ab, bc, ca = middle.T
    corners = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return ends, np.concatenate([np.stack(corner, axis=1) for corner in corners])


def unsplit(faces: IntArray) -> IntArray:
    """The faces (m / 4, 3) from which `split` made these, over the first of their vertices."""
    m = len(faces) // 4
    return np.stack([faces[k * m : (k + 1) * m, 0] for k in range(3)], axis=1)


def means(row: IntArray, column: IntArray, shape: tuple[int, int]) -> csr_array:
    """Sparse matrix whose rows are the means over their columns, each pair (row, column) one."""
    count = np.bincount(row, minlength=shape[0])
    return coo_array((1.0 / count[row], (row, column)), shape=shape).tocsr()


def _slopes(positions: FloatArray, faces: IntArray, ends: IntArray) -> csr_array:
    """(e, n) an eighth of the difference of the slopes at both ends of each edge.

    The Hermite cubic through (0, p) and (1, q) with slopes s and t is (p + q) / 2 + (s - t) / 8
    in the middle. Slopes come from the mean gradient of the faces around a vertex.
    """
    n = len(positions)
    along = positions[ends[:, 1]] - positions[ends[:, 0]]
    total = csr_array((len(ends), n))
    for axis, gradient in enumerate(_gradients(positions, faces)):
        difference = gradient[ends[:, 0]] - gradient[ends[:, 1]]
        total = total + diags_array(along[:, axis] / 8.0) @ difference
    return total.tocsr()


def _gradients(positions: FloatArray, faces: IntArray) -> list[csr_array]:
    """Three (n, n) matrices: x, y and z of the area-weighted mean gradient at each vertex.

    In a triangle, the gradient of a corner's hat function is normal x opposite edge / (2 area).
    """
    n = len(positions)
    cross = cross_products(positions, faces)
    normal = unit(cross)
    area = np.bincount(
        faces.ravel(), np.repeat(np.linalg.norm(cross, axis=1), 3), minlength=n
    )  # twice the area, as below
    hats = np.stack(
        [
            np.cross(normal, positions[faces[:, (k + 2) % 3]] - positions[faces[:, (k + 1) % 3]])
            for k in range(3)
        ],
        axis=1,
    )
    row = np.repeat(faces, 3, axis=1).ravel()
    column = np.tile(faces, (1, 3)).ravel()
    scale = diags_array(1.0 / area)
    return [
        (
            scale @ coo_array((np.tile(hats[:, :, axis], (1, 3)).ravel(), (row, column)), (n, n))
        ).tocsr()
        for axis in range(3)
    ]


def _curved(positions: FloatArray, normals: FloatArray, ends: IntArray) -> FloatArray:
    """(e, 3) middles of the Hermite curves whose end slopes lie in the tangent planes [m]."""
    a, b = positions[ends[:, 0]], positions[ends[:, 1]]
    along = b - a
    rise_a = np.einsum("ij,ij->i", normals[ends[:, 0]], along)[:, None] * normals[ends[:, 0]]
    rise_b = np.einsum("ij,ij->i", normals[ends[:, 1]], along)[:, None] * normals[ends[:, 1]]
    return np.asarray((a + b) / 2 + (rise_b - rise_a) / 8)

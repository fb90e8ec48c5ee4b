"""Per triangle: areas, normals, altitudes, and the map of each triangle to the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray, check_faces, check_points, freeze


@dataclass(frozen=True, eq=False, slots=True)
class TriangleMesh:
    """Vertices (n, 3) float [m] and faces (m, 3) int, counter-clockwise seen from outside.

    Attributes
    ----------
    vertices : (n, 3) float
    Positions [m].
    faces : (m, 3) int
    Counter-clockwise seen from outside.
    """

    vertices: FloatArray
    faces: IntArray

    def __post_init__(self) -> None:
        vertices = check_points(self.vertices, "vertices")
        freeze(self, vertices=vertices, faces=check_faces(self.faces, len(vertices)))


def cross_products(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m, 3) cross products of two edges [m2]; length is twice the area, direction the normal."""
    a, b, c = vertices.take(faces.T, axis=0)
    return cross(b - a, c - a)


def face_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m,) areas [m2]."""
    return 0.5 * np.linalg.norm(cross_products(vertices, faces), axis=1)


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m, 3) unit normals; zero where a triangle has no area."""
    return unit(cross_products(vertices, faces))


def vertex_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(n,) a third of the area of the triangles around each vertex [m2]."""
    third = np.repeat(face_areas(vertices, faces) / 3.0, 3)
    return np.bincount(faces.ravel(), third, minlength=len(vertices)).astype(np.float64)


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(n, 3) unit mean of the normals of the triangles around each vertex, by area."""
    size = float(np.ptp(vertices, axis=0).max(initial=0.0)) or 1.0  # squares of it may underflow
    normals = np.zeros_like(vertices)
    np.add.at(normals, faces.ravel(), np.repeat(cross_products(vertices / size, faces), 3, axis=0))
    return unit(normals)


def smallest_altitudes(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m,) smallest altitude of each triangle [m]: twice the area over the longest edge."""
    longest = edge_lengths(vertices, faces).max(axis=1)
    double = np.linalg.norm(cross_products(vertices, faces), axis=1)
    return np.divide(double, longest, out=np.zeros_like(longest), where=longest > 0)


def edge_lengths(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m, 3) length of the edge opposite each corner [m], in any dimension."""
    square = np.zeros(faces.T.shape)
    for column in vertices.T:  # axes apart: sums over three columns are slow
        corners = column.take(faces.T)
        square += (np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)) ** 2
    return np.sqrt(square).T


def pair_lengths(points: FloatArray, pairs: IntArray) -> FloatArray:
    """(e,) distances of pairs (e, 2) of points (n, d) [m]."""
    return np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)


def signed_areas(uv: FloatArray, faces: IntArray) -> FloatArray:
    """(m,) signed areas in the plane [m2]; negative is a flip."""
    a, b, c = uv[faces[:, 0]], uv[faces[:, 1]], uv[faces[:, 2]]
    return 0.5 * cross_2d(b - a, c - a)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """(..., 3) cross products of vectors (..., 3); numpy's own takes twice as long."""
    found = np.empty(a.shape)
    for one, other, into in ((1, 2, 0), (2, 0, 1), (0, 1, 2)):
        found[..., into] = a[..., one] * b[..., other] - a[..., other] * b[..., one]
    return found


def cross_2d(a: FloatArray, b: FloatArray) -> FloatArray:
    """(...,) z component of the cross product of plane vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def unit(vectors: FloatArray) -> FloatArray:
    """Vectors (..., k) at length 1; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def jacobians(vertices: FloatArray, faces: IntArray, uv: FloatArray) -> FloatArray:
    """(m, 2, 2) linear map from each triangle's own plane (x along edge 0-1) to the flat map.

    NaN where a triangle has no area.
    """
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    length = np.linalg.norm(b - a, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        x = np.einsum("ij,ij->i", c - a, (b - a) / length[:, None])
        y = np.linalg.norm(np.cross(b - a, c - a), axis=1) / length
        p, q = uv[faces[:, 1]] - uv[faces[:, 0]], uv[faces[:, 2]] - uv[faces[:, 0]]
        first = p / length[:, None]
        second = (q - first * x[:, None]) / y[:, None]
    return np.stack([first, second], axis=2)


def singular_values(maps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """sigma_1 >= |sigma_2| of (m, 2, 2) maps in closed form; sigma_2 < 0 where a map flips."""
    a, b, c, d = maps[:, 0, 0], maps[:, 0, 1], maps[:, 1, 0], maps[:, 1, 1]
    conformal = 0.5 * np.hypot(a + d, c - b)
    anticonformal = 0.5 * np.hypot(a - d, c + b)
    return conformal + anticonformal, conformal - anticonformal

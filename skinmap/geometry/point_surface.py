"""The smooth surface through oriented points, and straight or evenly bent ways along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import edge_graph
from skinmap.geometry.topology import edges, twins
from skinmap.geometry.triangles import face_normals, unit

NEAR = 10  # points that say where the surface is
STEP = 2e-3  # of a walk [m]
OFF = 1.25  # spacings from the nearest point: beyond is no skin


@dataclass(frozen=True, eq=False, slots=True)
class Way:
    """Points along a surface.

    Attributes
    ----------
    points : (p, 3) float
        `STEP` apart [m].
    headings, normals : (p, 3) float
        Unit directions of going and of the surface there.
    """

    points: FloatArray
    headings: FloatArray
    normals: FloatArray

    @property
    def length(self) -> float:
        """[m]."""
        return STEP * (len(self.points) - 1)

    def back(self) -> Way:
        """The same way from its end to its start."""
        return Way(self.points[::-1], -self.headings[::-1], self.normals[::-1])


class PointSurface:
    """The surface that oriented points are samples of.

    Parameters
    ----------
    points, normals : (n, 3) float
        [m], and outward directions of length 1.
    spacing : float
        Between neighbours [m].
    """

    def __init__(self, points: FloatArray, normals: FloatArray, spacing: float) -> None:
        self.points, self.normals, self.spacing = points, normals, spacing
        self._tree = cKDTree(points)

    def nearest(self, point: FloatArray) -> int:
        """Row of the sample nearest to a point."""
        return int(self._tree.query(point)[1])

    def project(self, point: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """The surface's point and normal next to a point, and how far the nearest sample is [m].

        The distances from the samples' tangent planes are too large by as much as those from
        the plane of their mean are too small, where a surface bends; the mean of both is right to
        the second order.
        """
        place = point
        for _ in range(2):
            gap, near = self._tree.query(place, k=min(NEAR, len(self.points)))
            weight = np.exp(-0.5 * (gap / self.spacing) ** 2)
            weight /= weight.sum()
            normal = unit(weight @ self.normals[near])
            step = place - self.points[near]
            away = 0.5 * np.einsum("ij,ij->i", step, self.normals[near] + normal)
            place = place - (weight @ away) * normal
        return place, normal, float(gap[0])

    def walk(
        self,
        start: FloatArray,
        heading: FloatArray,
        length: float,
        *,
        bend: float = 0.0,
        over: float = 0.0,
    ) -> Way:
        """The way of a length [m] from a point, or as much of it as there is skin.

        Parameters
        ----------
        start, heading : (3,) float
            Where it begins [m] and in which direction.
        length : float
            [m].
        bend : float
            Geodesic curvature, left is positive [1/m]; 0 is a geodesic.
        over : float
            How far it may go on beyond the rim of the skin [m].
        """
        place, normal, _ = self.project(start)
        ahead = _along(heading, normal)
        found = [(place, ahead, normal)]
        c, s = np.cos(STEP * bend), np.sin(STEP * bend)
        for _ in range(int(np.ceil(length / STEP))):
            place, normal, gap = self.project(place + STEP * ahead)
            if gap > OFF * self.spacing + over:
                break
            ahead = _along(ahead, normal)
            ahead = c * ahead + s * np.cross(normal, ahead)
            found.append((place, ahead, normal))
        points, headings, normals = (np.array(one) for one in zip(*found, strict=True))
        return Way(points, headings, normals)


def _along(direction: FloatArray, normal: FloatArray) -> FloatArray:
    """What of a direction lies in the tangent plane, unit length."""
    return np.asarray(unit(direction - (direction @ normal) * normal))


# Paths along a mesh: from a point in one triangle to a point in another.

STEPS = 500  # triangles that one straight walk crosses at most


class SurfaceWalker:
    """Walks along a mesh, made once for it.

    Parameters
    ----------
    vertices : (n, 3) float
        [m].
    faces : (m, 3) int
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        self.vertices, self.faces = vertices, faces
        self._twin = twins(faces).tolist()
        self._corners = faces.tolist()
        self._normals = face_normals(vertices, faces)
        lines = edges(faces)
        self._graph = edge_graph(vertices, lines[lines[:, 0] != lines[:, 1]])

    def path(self, start: FloatArray, first: int, end: FloatArray, last: int) -> FloatArray:
        """Points (p, 3) from `start` in triangle `first` to `end` in `last`, both included.

        Where the mesh is cut by the plane through both points and the mean normal; that is the
        shortest way on planes and spheres, and for short steps on what is bent otherwise. Round
        a hole or an inlet it follows the mesh edges by Dijkstra's algorithm; between sheets that
        nothing joins it is the straight line.
        """
        if first == last:
            return np.stack([start, end])
        found = self._cut(start, first, end, last)
        return self._along_edges(start, first, end, last) if found is None else found

    def _cut(self, start: FloatArray, first: int, end: FloatArray, last: int) -> FloatArray | None:
        """Follow the plane from triangle to triangle; None where the mesh ends on the way."""
        ahead = end - start
        across = np.cross(ahead, self._normals[first] + self._normals[last])
        whole = float(ahead @ ahead)
        if whole == 0 or not across.any():
            return np.stack([start, end])
        points = [start]
        face, entered = first, -1
        for _ in range(STEPS):
            step = self._leave(face, entered, start, across, ahead)
            if step is None:
                return None
            edge, point = step
            if float((point - start) @ ahead) >= whole:
                return None  # past the end without meeting its triangle: a fold
            points.append(point)
            entered = self._twin[edge]
            if entered < 0:
                return None
            face = entered // 3
            if face == last:
                points.append(end)
                return np.stack(points)
        return None

    def _leave(
        self, face: int, entered: int, start: FloatArray, across: FloatArray, ahead: FloatArray
    ) -> tuple[int, FloatArray] | None:
        """Directed edge through which the plane leaves a triangle, and where."""
        corners = self.vertices[self._corners[face]]
        side = ((corners - start) @ across).tolist()
        best: tuple[int, FloatArray] | None = None
        furthest = -np.inf
        for k in range(3):
            here, there = side[k], side[(k + 1) % 3]
            if 3 * face + k == entered or (here >= 0) == (there >= 0):
                continue
            t = here / (here - there)
            point = (1.0 - t) * corners[k] + t * corners[(k + 1) % 3]
            along = float((point - start) @ ahead)
            if along > furthest:
                furthest, best = along, (3 * face + k, point)
        return best

    def _along_edges(self, start: FloatArray, first: int, end: FloatArray, last: int) -> FloatArray:
        """Over vertices, from a corner of one triangle to a corner of the other."""
        goals = self.faces[last]
        near = self.faces[first]
        length, before = dijkstra(
            self._graph, directed=False, indices=near, return_predecessors=True
        )
        leave = np.linalg.norm(self.vertices[near] - start, axis=1)
        arrive = np.linalg.norm(self.vertices[goals] - end, axis=1)
        total = leave[:, None] + length[:, goals] + arrive
        row, column = np.unravel_index(np.argmin(total), total.shape)
        if not np.isfinite(total[row, column]):
            return np.stack([start, end])
        way = [int(goals[column])]
        while way[-1] != near[row]:
            way.append(int(before[row, way[-1]]))
        return np.concatenate([start[None], self.vertices[way[::-1]], end[None]])

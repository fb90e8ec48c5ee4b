"""Paths along a mesh: from a point in one triangle to a point in another."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import dijkstra

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import edge_graph
from skinmap.geometry.topology import edges, twins
from skinmap.geometry.triangles import face_normals

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

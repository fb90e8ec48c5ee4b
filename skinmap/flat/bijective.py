"""Flat maps that nowhere overlap themselves: a border that keeps clear of itself.

A map whose triangles all keep their side is one to one exactly where its border does not cross
itself (a degree argument, for discs). The descent on the symmetric Dirichlet energy keeps both
when it starts so, from a convex map, and refuses every step that crosses; a barrier between
border vertices and border edges keeps it from getting stuck where they meet.

References
----------
Smith and Schaefer, "Bijective parameterization with free boundaries", ACM Transactions on
Graphics 34(4), 2015.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.flat.convex import uniform_on_circle
from skinmap.flat.dirichlet import ITERATIONS, at_best_size, symmetric_dirichlet_descent
from skinmap.flat.disc import Disc

CLEAR = 0.3  # of the median border edge: within it the border pushes itself away


def bijective_map(disc: Disc, *, iterations: int = ITERATIONS) -> FloatArray:
    """(n, 2) little symmetric Dirichlet energy [m], one to one on the whole disc."""
    start = at_best_size(disc, uniform_on_circle(disc))
    return symmetric_dirichlet_descent(disc, start, iterations=iterations, barrier=Barrier(disc))


class Barrier:
    """Energy between border vertices and the border edges that they are no end of.

    Parameters
    ----------
    disc : Disc
    """

    def __init__(self, disc: Disc) -> None:
        self._disc = disc
        self._loop, self._next = disc.loop, np.roll(disc.loop, -1)
        sides = disc.vertices[self._next] - disc.vertices[self._loop]
        lengths = np.linalg.norm(sides, axis=1)
        self._clear = CLEAR * float(np.median(lengths))
        self._weight = float(disc.areas.sum()) / len(disc.loop)

    def __call__(self, uv: FloatArray) -> tuple[float, FloatArray]:
        """Energy [m2] and its gradient (n, 2); infinite where the border crosses itself."""
        gradient = np.zeros_like(uv)
        if not self._disc.is_border_simple(uv):
            return float("inf"), gradient
        point, edge = self._near(uv)
        p, a, b = uv[self._loop[point]], uv[self._loop[edge]], uv[self._next[edge]]
        along = b - a
        square = np.maximum(np.einsum("ij,ij->i", along, along), np.finfo(float).tiny)
        t = np.clip(np.einsum("ij,ij->i", p - a, along) / square, 0.0, 1.0)
        away = p - a - t[:, None] * along
        distance = np.linalg.norm(away, axis=1)
        near = distance < self._clear
        if not near.any():
            return 0.0, gradient
        point, edge, t, away, distance = (x[near] for x in (point, edge, t, away, distance))
        excess = self._clear / distance - 1.0
        slope = -2.0 * self._weight * excess * self._clear / distance**2
        push = (slope / distance)[:, None] * away
        np.add.at(gradient, self._loop[point], push)
        np.add.at(gradient, self._loop[edge], -(1.0 - t)[:, None] * push)
        np.add.at(gradient, self._next[edge], -t[:, None] * push)
        return float(self._weight * (excess**2).sum()), gradient

    def _near(self, uv: FloatArray) -> tuple[np.ndarray, np.ndarray]:
        """(k,) border vertices and (k,) border edges that may be closer than the clearance."""
        start, end = uv[self._loop], uv[self._next]
        reach = self._clear + 0.5 * float(np.linalg.norm(end - start, axis=1).max())
        found = cKDTree(0.5 * (start + end)).query_ball_point(start, reach)
        point = np.repeat(np.arange(len(found)), [len(one) for one in found])
        edge = np.concatenate([np.asarray(one, np.int64) for one in found])
        n = len(self._loop)
        apart = (edge != point) & ((edge + 1) % n != point)
        return point[apart], edge[apart]

"""The outline of a touch: where a field on triangles crosses a level, closed along the border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False, slots=True)
class Outline:
    """k segments; each end lies on an edge between two vertices.

    Attributes
    ----------
    first, second : (k, 2) int
        Vertices of the edge on which each end lies.
    share : (k, 2) float
        Where on it, 0 at the first vertex, 1 at the second.
    """

    first: IntArray
    second: IntArray
    share: FloatArray

    def points(self, coordinates: FloatArray) -> FloatArray:
        """(k, 2, d) ends of the segments for coordinates (v, d) of the vertices."""
        share = self.share[:, :, None]
        return np.asarray(coordinates[self.first] * (1 - share) + coordinates[self.second] * share)


def outline(faces: IntArray, border: IntArray, values: FloatArray, level: float) -> Outline:
    """Closed outline of the region where `values` exceed `level`.

    Parameters
    ----------
    faces : (m, 3) int
        Triangles.
    border : (b, 2) int
        Edges of the mesh's border: the outline runs along them where the region reaches them.
    values : (v,) float
        Field at the vertices.
    level : float
        Same unit as `values`.
    """
    above = values > level
    inside = above[faces].sum(axis=1)
    crossed = faces[(inside == 1) | (inside == 2)]
    one = above[crossed].sum(axis=1) == 1
    # The corner that is alone on its side of the level; both crossed edges start there.
    lone = np.argmax(above[crossed] == one[:, None], axis=1)
    row = np.arange(len(crossed))
    apex = np.repeat(crossed[row, lone][:, None], 2, axis=1)
    others = np.stack([crossed[row, (lone + 1) % 3], crossed[row, (lone + 2) % 3]], axis=1)
    edge = border[above[border].any(axis=1)]
    start = np.where(above[edge], edge, edge[:, ::-1])  # an end outside moves to the crossing
    first = np.concatenate([apex, start])
    second = np.concatenate([others, edge])
    return Outline(first, second, _crossing(values[first], values[second], level))


def _crossing(a: FloatArray, b: FloatArray, level: float) -> FloatArray:
    """Where between a and b the level lies; 0 where the two are on one side of it."""
    crosses = (a > level) != (b > level)
    span = np.where(crosses, b - a, 1.0)
    return np.where(crosses, np.clip((level - a) / span, 0.0, 1.0), 0.0)

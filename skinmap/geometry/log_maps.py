"""Plane coordinates of everything around one point of a bent surface.

Schmidt, Grimm and Wyvill, "Interactive Decal Compositing with Discrete Exponential Maps",
ACM Transactions on Graphics 25(3), 2006.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit

KEPT_POINTS = 2000  # of a surface whose maps are all kept: 64 MB at most
BLOCK = 32  # sources whose maps are made at once


def log_map(
    points: FloatArray,
    normals: FloatArray,
    graph: csr_array,
    source: int,
    reach: float,
    *,
    frame: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Coordinates (n, 2) and path lengths (n,) [m] of points around a source point.

    Frames are carried along the shortest paths of the symmetric graph by the least rotation
    between normals; each step is laid into the frame at its full 3D length. On a plane the
    coordinates are exact.

    Parameters
    ----------
    points, normals : (n, 3) float
        [m], and unit vectors.
    graph : (n, n) sparse array
        Lengths of edges [m].
    source : int
        Number of the point.
    reach : float
        Points further away [m] get NaN and inf.
    frame : (2, 3) float, optional
        Axes at the source; any by default.

    Returns
    -------
    (n, 2) float, (n,) float
        Coordinates and lengths [m].

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.sparse import csr_array
    >>> from skinmap.geometry import log_map
    >>> points, up = np.array([[0.0, 0, 0], [0.03, 0.04, 0]]), np.tile([0.0, 0, 1], (2, 1))
    >>> uv, length = log_map(points, up, csr_array([[0, 0.05], [0.05, 0]]), 0, 1.0)
    >>> float(length[1]), round(float(np.hypot(*uv[1])), 6)
    (0.05, 0.05)
    """
    frames = tangent_frames(normals[[source]]) if frame is None else np.asarray(frame)[None]
    uv, length = _log_maps(points, normals, graph, np.array([source]), reach, frames)
    return uv[0], length[0]


class LogMaps:
    """The log maps around any point of one surface, for who asks for many.

    Those of small surfaces are made some at once and kept: steps along paths cost the same for one
    source as for a few dozen.

    Parameters
    ----------
    points, normals : (n, 3) float
        [m], and outward directions of length 1.
    graph : (n, n) sparse
        Steps along the surface, symmetric [m].
    reach : float
        As `log_map` takes it [m].
    """

    def __init__(
        self, points: FloatArray, normals: FloatArray, graph: csr_array, reach: float
    ) -> None:
        self.points, self.normals, self.graph, self.reach = points, normals, graph, reach
        self._kept: dict[int, FloatArray] = {}

    def around(self, source: int) -> FloatArray:
        """(n, 2) coordinates around a point, the same as of `log_map`."""
        if len(self.points) > KEPT_POINTS:
            return log_map(self.points, self.normals, self.graph, source, self.reach)[0]
        block, row = divmod(source, BLOCK)
        if block not in self._kept:
            sources = np.arange(block * BLOCK, min((block + 1) * BLOCK, len(self.points)))
            frames = tangent_frames(self.normals[sources])
            self._kept[block], _ = _log_maps(
                self.points, self.normals, self.graph, sources, self.reach, frames
            )
        return self._kept[block][row]


def _log_maps(
    points: FloatArray,
    normals: FloatArray,
    graph: csr_array,
    sources: IntArray,
    reach: float,
    frames: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Coordinates (s, n, 2) and path lengths (s, n) around sources (s,) with axes (s, 2, 3)."""
    # Directed, as a symmetric graph says all twice already.
    length, parent = dijkstra(
        graph, directed=True, indices=sources, limit=reach, return_predecessors=True
    )
    count = len(points)
    uv = np.full((len(sources) * count, 2), np.nan)
    axes = np.zeros((len(sources) * count, 2, 3))
    begin = np.arange(len(sources)) * count + sources
    uv[begin], axes[begin] = 0.0, frames
    done = np.zeros(len(uv), bool)
    done[begin] = True
    row, child = np.nonzero(np.isfinite(length) & (parent >= 0))
    before = parent[row, child]
    step = points[child] - points[before]
    size = np.linalg.norm(step, axis=1, keepdims=True)
    turn = _turn(normals[before], normals[child])
    end, here, there = normals[child], row * count + before, row * count + child
    waiting = np.arange(len(here))
    while len(waiting):
        ready = done[here[waiting]]
        now, waiting = waiting[ready], waiting[~ready]
        axes_before = axes[here[now]]
        along = np.einsum("nai,ni->na", axes_before, end[now])
        carried = axes_before - along[..., None] * turn[now][:, None]
        flat = np.einsum("nai,ni->na", axes_before + carried, step[now])
        uv[there[now]] = uv[here[now]] + unit(flat) * size[now]
        axes[there[now]] = carried
        done[there[now]] = True
    return uv.reshape(len(sources), count, 2), length


def _turn(start: FloatArray, end: FloatArray) -> FloatArray:
    """(n, 3) by what axes change per share of them along `end`, in the least rotation to it."""
    scale = 1.0 / np.maximum(1.0 + np.einsum("ni,ni->n", start, end), 1e-9)
    return np.asarray((start + end) * scale[:, None])

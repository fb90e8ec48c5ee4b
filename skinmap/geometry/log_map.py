"""Plane coordinates of everything around one point of a bent surface.

Schmidt, Grimm and Wyvill, "Interactive Decal Compositing with Discrete Exponential Maps",
ACM Transactions on Graphics 25(3), 2006.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from skinmap.arrays import FloatArray
from skinmap.geometry.triangles import unit


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

    Frames are carried along the shortest paths of the graph by the least rotation between
    normals; each step is laid into the frame at its full 3D length. On a plane the coordinates
    are exact. Points further than `reach` [m] get NaN and inf. `frame` (2, 3) are the axes at the
    source, any by default.
    """
    length, parent = dijkstra(
        graph, directed=False, indices=source, limit=reach, return_predecessors=True
    )
    uv = np.full((len(points), 2), np.nan)
    axes = np.zeros((len(points), 2, 3))
    axes[source] = _any_frame(normals[source]) if frame is None else frame
    uv[source] = 0.0
    reached = np.isfinite(length)
    reached[source] = False
    waiting = np.flatnonzero(reached)
    done = np.zeros(len(points), bool)
    done[source] = True
    while len(waiting):
        ready = done[parent[waiting]]
        child, waiting = waiting[ready], waiting[~ready]
        before = parent[child]
        axes[child] = _carried(axes[before], normals[before], normals[child])
        step = points[child] - points[before]
        mean_axes = axes[before] + axes[child]
        flat = np.einsum("nai,ni->na", mean_axes, step)
        uv[child] = uv[before] + unit(flat) * np.linalg.norm(step, axis=1, keepdims=True)
        done[child] = True
    return uv, length


def _any_frame(normal: FloatArray) -> FloatArray:
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = unit(np.cross(normal, helper))
    return np.stack([first, np.cross(normal, first)])


def _carried(axes: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Axes (n, 2, 3) turned by the least rotation that takes each start normal to its end."""
    middle = start + end
    scale = 1.0 / np.maximum(1.0 + np.einsum("ni,ni->n", start, end), 1e-9)
    along = np.einsum("nai,ni->na", axes, end)
    return np.asarray(axes - along[..., None] * (middle * scale[:, None])[:, None])

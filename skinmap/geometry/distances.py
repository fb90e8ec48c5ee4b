"""Lengths along the skin: shortest paths over a graph of its points."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import neighbour_graph


def edge_graph(vertices: FloatArray, edges: IntArray) -> csr_array:
    """Symmetric (n, n) graph of mesh edges, weighted by their length [m]."""
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    graph = coo_array((length, (edges[:, 0], edges[:, 1])), shape=(len(vertices),) * 2).tocsr()
    return graph.maximum(graph.T)


def bridged_graph(points: FloatArray, k: int, limit: float) -> csr_array:
    """Neighbour graph whose separate pieces are joined by their shortest straight bridges.

    A limb carries several patches; a hand spans the gaps between them, so distances between
    patches matter. Bridges follow Boruvka's algorithm: each round joins every piece to its
    nearest other piece.
    """
    graph = neighbour_graph(points, k, limit)
    while True:
        count, label = connected_components(graph, directed=False)
        if count == 1:
            return graph
        row, column, length = [], [], []
        for piece in range(count):
            inside, outside = np.flatnonzero(label == piece), np.flatnonzero(label != piece)
            gap = np.linalg.norm(points[inside, None] - points[None, outside], axis=2)
            i, j = np.unravel_index(np.argmin(gap), gap.shape)
            row.append(inside[i])
            column.append(outside[j])
            length.append(gap[i, j])
        bridges = coo_array((length, (row, column)), shape=graph.shape).tocsr()
        graph = graph.maximum(bridges).maximum(bridges.T)


def path_distances(graph: csr_array, sources: IntArray | None = None) -> FloatArray:
    """(s, n) shortest-path lengths [m] from the sources (all vertices by default); inf if none.

    Of a symmetric graph: read as directed it says all that it says, once.
    """
    return np.asarray(dijkstra(graph, directed=True, indices=sources))

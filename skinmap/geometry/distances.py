"""Lengths along the skin: shortest paths over a graph of its points."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import nearest_first, neighbour_graph
from skinmap.geometry.triangles import pair_lengths


def edge_graph(vertices: FloatArray, edges: IntArray) -> csr_array:
    """Symmetric (n, n) graph of mesh edges, weighted by their length [m]."""
    length = pair_lengths(vertices, edges)
    graph = coo_array((length, (edges[:, 0], edges[:, 1])), shape=(len(vertices),) * 2).tocsr()
    return graph.maximum(graph.T)


def bridged_graph(points: FloatArray, k: int, limit: float) -> csr_array:
    """Neighbour graph whose separate pieces are joined by their shortest straight bridges.

    A limb carries several patches; a hand spans the gaps between them, so distances between
    patches matter. Bridges follow Boruvka's algorithm: each round joins every piece to its
    nearest other piece.

    Parameters
    ----------
    points : (n, 3) array of float
    Positions [m].
    k : int
    Neighbours of each point.
    limit : float
    Neighbours further away are left out [m].

    Returns
    -------
    csr_array
    (n, n) lengths [m]; symmetric, in one piece.

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.geometry import bridged_graph
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 0, 0]])
    >>> bridged_graph(points, 2, 1.5).nnz
    6
    """
    graph = neighbour_graph(points, k, limit)
    while True:
        count, label = connected_components(graph, directed=False)
        if count == 1:
            return graph
        row, column, length = [], [], []
        for piece in range(count):
            inside, outside = np.flatnonzero(label == piece), np.flatnonzero(label != piece)
            gap, other = cKDTree(points[outside]).query(points[inside])
            here = nearest_first(gap)[0]
            row.append(inside[here])
            column.append(outside[other[here]])
            length.append(gap[here])
        bridges = coo_array((length, (row, column)), shape=graph.shape).tocsr()
        graph = graph.maximum(bridges).maximum(bridges.T)


def path_distances(graph: csr_array, sources: IntArray | None = None) -> FloatArray:
    """(s, n) shortest-path lengths [m] from the sources (all vertices by default); inf if none.

    Of a symmetric graph: read as directed it says all that it says, once.

    Parameters
    ----------
    graph : (n, n) csr_array
    Lengths of edges [m].
    sources : (s,) array of int, optional
    All vertices by default.

    Returns
    -------
    (s, n) array of float
    [m].

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.geometry import bridged_graph, path_distances
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    >>> path_distances(bridged_graph(points, 2, 2.5), np.array([0])).tolist()
    [[0.0, 1.0, 3.0]]
    """
    return np.asarray(dijkstra(graph, directed=True, indices=sources))

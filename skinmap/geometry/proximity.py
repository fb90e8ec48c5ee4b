"""Nearest things: spacing of points, neighbour graphs, closest points on a mesh.

Lengths along the skin: shortest paths over a graph of its points.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.disk_cache import cached
from skinmap.errors import InvalidArrayError
from skinmap.geometry.triangles import pair_lengths


def symmetric_graph(n: int, pairs: IntArray, weights: FloatArray) -> csr_array:
    """(n, n) graph of weighted pairs (e, 2), each in both directions."""
    graph = coo_array((weights, pairs.T), shape=(n, n)).tocsr()
    return graph.maximum(graph.T)


def edge_graph(vertices: FloatArray, edges: IntArray) -> csr_array:
    """Symmetric (n, n) graph of mesh edges, weighted by their length [m]."""
    return symmetric_graph(len(vertices), edges, pair_lengths(vertices, edges))


def bridged_graph(points: FloatArray, k: int, limit: float | FloatArray) -> csr_array:
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
    limit : float or (n,) array of float
    Neighbours further away are left out [m]; of the limits at two points the smaller counts.

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
            length.append(max(gap[here], np.finfo(float).tiny))  # a sparse graph drops zeros
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


MAX_COINCIDENT = 1000  # points at one place: a search among them takes their number squared
TIE = 9  # digits of a length [m] that are compared: on a lattice many differ by rounding alone


def nearest_first(distances: FloatArray) -> IntArray:
    """(n,) rows by distance (n,) [m]; those within a nanometre stay in the order they came in.

    Parameters
    ----------
    distances : (n,) array of float
    [m].

    Returns
    -------
    (n,) array of int

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.geometry import nearest_first
    >>> nearest_first(np.array([0.3, 0.1, 0.1 - 1e-15])).tolist()
    [1, 2, 0]
    """
    return np.argsort(distances.round(TIE), kind="stable")


def median_spacing(points: FloatArray) -> float:
    """Median distance to the nearest other point [m]; 0 for fewer than two points.

    Parameters
    ----------
    points : (n, d) array of float
    [m].

    Returns
    -------
    float
    [m].

    Raises
    ------
    InvalidArrayError
        More than `MAX_COINCIDENT` points at one place.

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.geometry import median_spacing
    >>> median_spacing(np.array([[0.0, 0, 0], [2, 0, 0], [4, 0, 0]]))
    2.0
    """
    if len(points) < 2:
        return 0.0
    check_coincident(points)
    distance, _ = cKDTree(points).query(points, k=2)
    return float(np.median(distance[:, 1]))


def check_coincident(points: FloatArray) -> None:
    """Refuse more points (n, 3) or (n, 2) at one place than a search among them can bear.

    Raises
    ------
    InvalidArrayError
        Says how many, and where.
    """
    _, alike = np.unique(points[:, 0], return_counts=True)  # settles nearly all, in no time
    if alike.max(initial=0) <= MAX_COINCIDENT:
        return
    places, counts = np.unique(points, axis=0, return_counts=True)
    worst = int(counts.argmax())
    if counts[worst] > MAX_COINCIDENT:
        where = ", ".join(f"{value:g}" for value in places[worst])
        raise InvalidArrayError(
            f"{counts[worst]} points at one place ({where}), at most {MAX_COINCIDENT} may coincide"
        )


def nearest(points: FloatArray, k: int) -> tuple[FloatArray, IntArray]:
    """Distances (n, k) [m] and indices (n, k) of the k nearest others, fewer if n is small."""
    return nearest_of(cKDTree(points), np.arange(len(points)), k)


def nearest_of(tree: cKDTree, rows: IntArray, k: int) -> tuple[FloatArray, IntArray]:
    """The same for some (r,) of the points of a tree only: (r, k) each."""
    k = min(k, tree.n - 1)
    distance, index = tree.query(tree.data[rows], k=np.arange(1, k + 2))
    # A coincident point may come before the query itself: move self to the front.
    own = index == rows[:, None]
    if own[:, 0].all():
        return distance[:, 1:], index[:, 1:]
    missing = ~own.any(axis=1)
    own[missing, -1] = True
    order = np.argsort(~own, axis=1, kind="stable")[:, 1:]
    return np.take_along_axis(distance, order, 1), np.take_along_axis(index, order, 1)


def neighbour_graph(points: FloatArray, k: int, limit: float | FloatArray) -> csr_array:
    """Symmetric (n, n) graph of the k nearest within a limit [m], weighted by distance [m]."""
    distance, index = nearest(points, k)
    row = np.repeat(np.arange(len(points)), index.shape[1])
    limit = np.broadcast_to(limit, len(points))
    keep = distance.ravel() <= np.minimum(limit[row], limit[index.ravel()])
    pairs = np.column_stack([row, index.ravel()])[keep]
    return symmetric_graph(len(points), pairs, distance.ravel()[keep])


def closest_on_mesh(
    points: FloatArray, vertices: FloatArray, faces: IntArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Distance (n,) [m], face (n,) and closest point (n, 3) [m] on a mesh, through libigl.

    Parameters
    ----------
    points : (n, 3) array of float
    [m].
    vertices, faces : (v, 3) array of float, (m, 3) array of int
    The mesh [m].

    Returns
    -------
    distance : (n,) array of float
    [m].
    face : (n,) array of int
    closest : (n, 3) array of float
    [m].

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.geometry import closest_on_mesh
    >>> triangle = np.eye(3), np.array([[0, 1, 2]])
    >>> distance, face, _ = closest_on_mesh(np.array([[2.0, 0, 0]]), *triangle)
    >>> float(distance[0]), int(face[0])
    (1.0, 0)
    """
    import igl

    squared, face, closest = igl.point_mesh_squared_distance(points, vertices, faces)
    return np.sqrt(squared), np.asarray(face, np.int64), closest


def ray_hits(
    origins: FloatArray, directions: FloatArray, vertices: FloatArray, faces: IntArray
) -> BoolArray:
    """(n,) whether each ray meets the mesh, through libigl: in double precision, and always there.

    Kept between runs: a skin asks the same of its body each time.
    """

    def shoot() -> dict[str, BoolArray]:
        import igl

        if len(faces) == 0:
            return {"hits": np.zeros(len(origins), bool)}
        tree = igl.AABB()
        tree.init(vertices, faces)
        face, _, _ = tree.intersect_ray_first(vertices, faces, origins, directions)
        return {"hits": np.asarray(face) >= 0}

    return cached("rays", [origins, directions, vertices, faces], shoot, made_by=("libigl",))[
        "hits"
    ]

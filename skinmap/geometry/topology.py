"""Edges, loops, components and Euler number of triangle meshes."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidMeshError


def half_edges(faces: IntArray) -> IntArray:
    """(3 m, 2) directed edges, face by face."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def edge_keys(faces: IntArray) -> IntArray:
    """(3 m,) one number for each directed edge, k or ~k for the two directions of an edge."""
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    key = np.minimum(start, end) * (int(faces.max(initial=0)) + 1) + np.maximum(start, end)
    return np.where(start < end, key, ~key)


def by_edge(faces: IntArray) -> tuple[IntArray, BoolArray]:
    """(3 m,) directed edges in the order of their two ends; whether the next has the same two."""
    ends = faces.astype(np.min_scalar_type(int(faces.max(initial=0))))  # short ones sort quickly
    start, end = ends.ravel(), ends[:, [1, 2, 0]].ravel()
    first, second = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((second, first))
    first, second = first.take(order), second.take(order)
    return order, (first[1:] == first[:-1]) & (second[1:] == second[:-1])


def twins(faces: IntArray) -> IntArray:
    """(3 m,) directed edge that runs back along each one, -1 at the border.

    Edges in more than two faces or with faces turned over have a twin where any edge runs back.
    """
    order, same = by_edge(faces)
    twin = np.full(faces.size, -1, np.int64)
    if (same[1:] & same[:-1]).any():
        key = edge_keys(faces)
        by_key = np.argsort(key, kind="stable")
        place = np.searchsorted(key[by_key], ~key)
        place[place == len(key)] = 0
        back = by_key[place]
        return np.where(key[back] == ~key, back, twin)
    first, second = order[:-1][same], order[1:][same]
    start = faces.ravel()
    opposite = start[first] != start[second]
    first, second = first[opposite], second[opposite]
    twin[first], twin[second] = second, first
    return twin


def border_edges(faces: IntArray) -> IntArray:
    """(b, 2) directed edges that no other runs back along."""
    return half_edges(faces)[twins(faces) < 0]


def edges(faces: IntArray) -> IntArray:
    """(e, 2) undirected edges, each once, smaller index first, sorted."""
    order, same = by_edge(faces)
    return np.sort(half_edges(faces)[order[~np.append(False, same)[: len(order)]]])


def face_components(faces: IntArray) -> IntArray:
    """(m,) component of each face, numbered by first appearance; faces touch through edges."""
    if len(faces) == 0:
        return np.zeros(0, np.int64)
    order, same = by_edge(faces)
    one, other = order[1:][same] // 3, order[:-1][same] // 3
    return number_by_appearance(components(one, other, len(faces)))


def components(one: IntArray, other: IntArray, n: int) -> IntArray:
    """(n,) component of each of n nodes that some pairs (e,) of them join."""
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def number_by_appearance(labels: IntArray) -> IntArray:
    """Renumber labels 0, 1, 2... in the order in which they first appear."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse.ravel()]


def euler_number(faces: IntArray) -> int:
    """Vertices - edges + faces, counting only vertices in use: 2 for a sphere, 1 for a disc."""
    return len(np.unique(faces)) - len(edges(faces)) + len(faces)


def boundary_loops(faces: IntArray) -> list[IntArray]:
    """Closed boundary loops, each in the direction of its faces, longest (in vertices) first.

    Raises
    ------
    InvalidMeshError
        Where two boundary loops meet in one vertex or a face is turned over.
    """
    open_edges = border_edges(faces)
    following = dict(map(tuple, open_edges.tolist()))
    if len(following) != len(open_edges):
        raise InvalidMeshError("two boundary loops meet in one vertex: the mesh is not manifold")
    loops = []
    while following:
        start, vertex = following.popitem()
        loop = [start]
        while vertex != start:
            loop.append(vertex)
            if vertex not in following:
                raise InvalidMeshError(f"the boundary ends at vertex {vertex}: a face is reversed")
            vertex = following.pop(vertex)
        smallest = loop.index(min(loop))
        loops.append(np.array(loop[smallest:] + loop[:smallest]))
    return sorted(loops, key=lambda loop: (-len(loop), loop[0]))


def loop_length(points: FloatArray, loop: IntArray) -> float:
    """Length of a closed loop [m]."""
    return float(np.linalg.norm(points[loop] - points[np.roll(loop, -1)], axis=1).sum())


def loops_by_length(points: FloatArray, faces: IntArray) -> list[IntArray]:
    """The boundary loops of faces (m, 3) over points (n, d), the longest first.

    Parameters
    ----------
    points : (n, d) array of float
    [m].
    faces : (m, 3) array of int

    Returns
    -------
    list of (k,) array of int
    Vertices of each loop, in its order.

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.geometry import loops_by_length
    >>> (loop,) = loops_by_length(np.eye(3), np.array([[0, 1, 2]]))
    >>> sorted(loop.tolist())
    [0, 1, 2]
    """
    return sorted(boundary_loops(faces), key=lambda loop: -loop_length(points, loop))


def check_surface(faces: IntArray) -> None:
    """Refuse what no flattening or walk over the mesh can trust.

    Raises
    ------
    InvalidMeshError
        An edge in more than two faces, or neighbours that turn opposite ways.
    """
    order, same = by_edge(faces)
    if (same[1:] & same[:-1]).any():
        worst, count = np.unique(np.sort(half_edges(faces)), axis=0, return_counts=True)
        edge = tuple(worst[count > 2][0].tolist())
        raise InvalidMeshError(f"edge {edge} lies in {count[count > 2][0]} faces, at most 2")
    start = faces.ravel()[order]
    if (start[1:] == start[:-1])[same].any():
        raise InvalidMeshError("two neighbouring faces turn opposite ways: orient the mesh first")

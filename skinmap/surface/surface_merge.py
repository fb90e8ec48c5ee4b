"""From votes to a manifold: greedy insertion of the triangles that most taxels agree on."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.topology import twins
from skinmap.geometry.triangles import cross_products, edge_lengths
from skinmap.surface.compiled import take_kernel

FACING = 0.3  # cosine between a triangle's normal and its taxels': 73 degrees
PACKED = 2**21  # points up to here: three indices fit into one 64-bit key


def consensus(
    points: FloatArray,
    normals: FloatArray,
    votes: IntArray,
    least_altitude: float,
    *,
    weights: IntArray | None = None,
    compiled: bool | None = None,
) -> IntArray:
    """Faces (m, 3) chosen from voted triangles (t, 3): most votes first, then shortest.

    Slivers below an altitude [m] and triangles that stand upright on the skin (three border
    taxels round a bend) are none of it. A triangle is taken if each of its directed edges is
    still free, which keeps the mesh edge-manifold, oriented and free of folds; smaller fans at
    pinched corners go at last. `weights` (t,) say how much each vote counts, 1 by default.
    """
    if len(votes) == 0:
        return np.zeros((0, 3), np.int64)
    triangles, count = tally(votes, len(points), weights)
    solid = is_solid(points, normals, triangles, least_altitude)
    longest = edge_lengths(points, triangles[solid]).max(axis=1)
    order = np.lexsort((longest, -count[solid]))
    triangles = triangles[solid][order]
    kernel = take_kernel(len(points), compiled)
    taken = (take_in_turn if kernel is None else kernel)(_edge_numbers(triangles, len(points)))
    return without_pinches(triangles[taken])


def is_solid(
    points: FloatArray, normals: FloatArray, triangles: IntArray, least_altitude: float
) -> BoolArray:
    """(t,) whether triangles have an altitude above a limit and lie on the skin, outside up."""
    cross = cross_products(points, triangles)
    double = np.sqrt(np.einsum("ij,ij->i", cross, cross))
    up = normals[triangles]
    mean = up.sum(axis=1)
    facing = np.einsum("ij,ij->i", cross, mean)
    solid = double > least_altitude * edge_lengths(points, triangles).max(axis=1)
    solid &= facing > FACING * double * np.sqrt(np.einsum("ij,ij->i", mean, mean))
    # No corner may look the other way: its taxel is on the far side, or its normal turned over.
    solid &= np.einsum("tij,tj->ti", up, cross).min(axis=1, initial=np.inf) > 0
    return np.asarray(solid)


def tally(votes: IntArray, n: int, weights: IntArray | None = None) -> tuple[IntArray, IntArray]:
    """Triangles (k, 3) that got votes (t, 3), smallest corner first, sorted; votes (k,) of each."""
    start = np.argmin(votes, axis=1)
    rolled = np.take_along_axis(votes, (start[:, None] + np.arange(3)) % 3, axis=1)
    if n <= PACKED:
        key = (rolled[:, 0] * n + rolled[:, 1]) * n + rolled[:, 2]
        order = np.argsort(key, kind="stable")
        ordered = key[order]
        fresh = np.flatnonzero(np.diff(ordered, prepend=-1))
    else:
        order = np.lexsort(rolled.T[::-1])
        ordered_rows = rolled[order]
        changed = (np.diff(ordered_rows, axis=0) != 0).any(axis=1)
        fresh = np.flatnonzero(np.concatenate([[True], changed]))
    weight = np.ones(len(votes), np.int64) if weights is None else weights[order]
    return rolled[order[fresh]], np.add.reduceat(weight, fresh)


def _edge_numbers(triangles: IntArray, n: int) -> IntArray:
    """(t, 3) number of the directed edge behind each corner: equal edges, equal numbers."""
    key = triangles * n + triangles[:, [1, 2, 0]]
    _, number = np.unique(key, return_inverse=True)
    return np.asarray(number.reshape(-1, 3), np.int64)


def take_in_turn(numbers: IntArray) -> BoolArray:
    """(t,) whether each triangle is taken, first come first served by its edges (t, 3).

    In rounds over all triangles at once: whoever is first at all three edges is taken, and those
    that share an edge with it are out. The outcome is that of going through them one by one.
    """
    taken = np.zeros(len(numbers), np.bool_)
    waiting = np.arange(len(numbers))
    first = np.empty(int(numbers.max(initial=-1)) + 1, np.int64)
    while len(waiting):
        edges = numbers[waiting]
        # The last to be written stays, so the earliest triangle is written last. In copies: numpy
        # goes through views with negative strides in the order of memory.
        first[edges.ravel()[::-1].copy()] = np.repeat(waiting, 3)[::-1].copy()
        winner = (first[edges] == waiting[:, None]).all(axis=1)
        taken[waiting[winner]] = True
        used = np.zeros(len(first), np.bool_)
        used[edges[winner]] = True
        waiting = waiting[~used[edges].any(axis=1)]
    return taken


def without_pinches(faces: IntArray) -> IntArray:
    """Faces less the smaller fans at vertices where two or more fans meet in a point."""
    while True:
        fan, vertex = fans(faces)
        size = np.bincount(fan)
        if len(size) == np.count_nonzero(np.bincount(faces.ravel())):
            return faces
        # Largest fan first at each vertex, then the one with the earliest face.
        rank = np.lexsort((np.arange(len(size)), -size, vertex))
        smaller = np.zeros(len(size), np.bool_)
        smaller[rank[1:]] = vertex[rank[1:]] == vertex[rank[:-1]]
        faces = faces[~smaller[fan].reshape(-1, 3).any(axis=1)]


def pinched_vertex(faces: IntArray) -> int:
    """A vertex where two fans meet in a point; -1 where there is none."""
    _, vertex = fans(faces)
    used, count = np.unique(vertex, return_counts=True)
    return int(used[np.argmax(count)]) if (count > 1).any() else -1


def fans(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Fan (3 m,) of each corner, numbered by first appearance, and the vertex (k,) of each fan.

    Corners of one vertex are of one fan where their faces share an edge at it.
    """
    start = faces.ravel()
    twin = twins(faces)
    corner = np.flatnonzero(twin >= 0)
    # The edge behind corner c runs back from the corner after its twin, at the same vertex.
    ahead = twin[corner] - twin[corner] % 3 + (twin[corner] + 1) % 3
    graph = coo_array((np.ones(len(corner), np.int8), (corner, ahead)), shape=(faces.size,) * 2)
    count, label = connected_components(graph, directed=False)
    first = np.full(count, faces.size)
    np.minimum.at(first, label, np.arange(faces.size))
    rank = np.empty(count, np.int64)
    rank[np.argsort(first)] = np.arange(count)
    return rank[label], start[np.sort(first)]

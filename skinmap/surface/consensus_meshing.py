"""The consensus recipe over one cloud: stars, votes, small holes; and the limits it works in.

From votes to a manifold: greedy insertion of the triangles that most taxels agree on.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.topology import (
    boundary_loops,
    by_edge,
    components,
    face_components,
    half_edges,
    loop_length,
    number_by_appearance,
    twins,
)
from skinmap.geometry.triangles import cross_2d, cross_products, edge_lengths, unit
from skinmap.surface.taxel_cloud import Cloud

EDGE_LIMIT = 2.5  # in local spacings: spans the gap between two modules, not between patches
SLIVER = 0.02  # in spacings: flatter triangles are three taxels in a row
BEYOND = 10.0  # times the size of the skin: longer than any length that is meant


class Limits:
    """What a triangle and a hole may be, in the units of a cloud, from whose spacing they derive.

    Parameters
    ----------
    cloud : Cloud
    max_edge, least_altitude : float or None
        Given ones [m].
    largest_hole : int

    Attributes
    ----------
    max_edge : (k,) float
        Of a triangle at each point: an edge is no longer than either end allows.
    least_altitude : float
        Of a triangle.
    largest_hole : int
        Vertices of the longest inner loop that is closed.
    """

    def __init__(
        self, cloud: Cloud, max_edge: float | None, least_altitude: float | None, largest_hole: int
    ) -> None:
        for name, value in (("max_edge", max_edge), ("least_altitude", least_altitude)):
            if value is None:
                continue
            if not (np.isfinite(value) and value >= 0):
                raise InvalidArrayError(f"{name} must be a length of 0 m or more, got {value}")
            size = cloud.unit * float(np.linalg.norm(np.ptp(cloud.points, axis=0)))
            if value > BEYOND * size > 0.0:
                raise InvalidArrayError(
                    f"{name} of {value:g} m, on a skin of {size:.2g} m: is it in millimetres?"
                )
        self.max_edge, self.largest_hole = EDGE_LIMIT * cloud.spacings, largest_hole
        if max_edge is not None:
            self.max_edge = np.full(len(cloud.points), max_edge / cloud.unit)
        self.least_altitude = SLIVER * cloud.spacing
        if least_altitude is not None:
            self.least_altitude = least_altitude / cloud.unit


def voted_faces(cloud: Cloud, limits: Limits, votes: IntArray) -> IntArray:
    """Faces (m, 3) over the points of a cloud from votes (t, 3), small inner loops closed."""
    faces = consensus(cloud.points, cloud.normals, votes, limits.least_altitude)
    least = 1e-3 * limits.least_altitude
    return fill_holes(cloud.points, cloud.normals, faces, limits.largest_hole, least_altitude=least)


# Closing of holes: small inner loops of a surface mesh, and any loop for a solve.

SMALL_HOLE = 8  # vertices: inner loops up to here are disagreements between stars


def fill_holes(
    points: FloatArray,
    normals: FloatArray,
    faces: IntArray,
    largest: int = SMALL_HOLE,
    *,
    least_altitude: float = 0.0,
) -> IntArray:
    """Faces with every inner loop of at most `largest` vertices closed.

    The longest loop of each component [m] is its outer border and stays open, and so does a hole
    that no triangles above an altitude [m], outside up, fit into without using an edge of the
    mesh again: the end of a thin tube is as short a loop as a gap between stars.
    """
    loops = boundary_loops(faces)
    if not any(len(loop) <= largest for loop in loops):
        return faces
    component = np.full(len(points), -1)
    component[faces.ravel()] = np.repeat(face_components(faces), 3)
    by_length = sorted(range(len(loops)), key=lambda k: (loop_length(points, loops[k]), k))
    outer = set({int(component[loops[k][0]]): k for k in by_length}.values())  # the last stays
    patches = [faces]
    for number, loop in enumerate(loops):
        if number in outer or len(loop) > largest:
            continue
        patch = close_loop(points, normals, loop, used=used_chords(np.concatenate(patches), loop))
        sides = edge_lengths(points, patch).max(axis=1)
        if len(patch) and is_solid(points, normals, patch, sides, least_altitude).all():
            patches.append(patch)
    return np.concatenate(patches)


def used_chords(faces: IntArray, loop: IntArray) -> BoolArray:
    """(k, k) whether the mesh has an edge between two vertices of a loop that is none of its."""
    place = np.full(int(faces.max()) + 1, -1)
    place[loop] = np.arange(len(loop))
    directed = half_edges(faces[(place[faces] >= 0).sum(axis=1) >= 2])
    start, end = place[directed].T
    inside = (start >= 0) & (end >= 0)
    used = np.zeros((len(loop),) * 2, np.bool_)
    used[start[inside], end[inside]] = True
    return np.asarray(used | used.T)


def close_loop(
    points: FloatArray, normals: FloatArray, loop: IntArray, *, used: BoolArray | None = None
) -> IntArray:
    """Faces (k - 2, 3) that close a boundary loop of k vertices, the worst one as good as can be.

    Klincsek's dynamic programme over chords: of all triangulations the one whose flattest
    triangle is least flat, so triangles turned over or without area come last. `used` (k, k)
    tells which chords are taken; none at all (0, 3) where there is no way without them.
    """
    hole = loop[::-1]  # a boundary loop runs with its faces, so the hole's own turn is reversed
    normal = unit(normals[hole].sum(axis=0))
    flat = points[hole] @ tangent_frames(normal).T
    n = len(hole)
    taken = np.zeros((n, n), np.bool_) if used is None else used[::-1, ::-1]
    worst = np.full((n, n), np.inf)  # quality of the worst triangle beyond the chord i, j
    split = np.zeros((n, n), np.int64)
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            between = np.arange(i + 1, j)
            shape = _quality(flat[i], flat[between], flat[j])
            value = np.minimum(shape, np.minimum(worst[i, between], worst[between, j]))
            worst[i, j], split[i, j] = value.max(), between[np.argmax(value)]
            if taken[i, j] and span < n - 1:
                worst[i, j] = -np.inf
    if worst[0, n - 1] == -np.inf:
        return np.zeros((0, 3), np.int64)
    faces, chords = [], [(0, n - 1)]
    while chords:
        i, j = chords.pop()
        if j - i >= 2:
            m = int(split[i, j])
            faces.append(hole[[i, m, j]])
            chords += [(i, m), (m, j)]
    return np.array(faces, dtype=np.int64)


def _quality(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """(k,) twice the signed area over the squared longest edge of triangles a, b (k, 2), c."""
    sides = np.stack([b - a, b - c, np.broadcast_to(c - a, b.shape)])
    longest = (sides**2).sum(axis=2).max(axis=0)
    area = cross_2d(b - a, c - a)
    return np.divide(area, longest, out=np.zeros_like(area), where=longest > 0)


FACING = 0.3  # cosine between a triangle's normal and its taxels': 73 degrees


def consensus(
    points: FloatArray,
    normals: FloatArray,
    votes: IntArray,
    least_altitude: float,
) -> IntArray:
    """Faces (m, 3) chosen from voted triangles (t, 3): most votes first, then shortest.

    Slivers below an altitude [m] and triangles that stand upright on the skin (three border
    taxels round a bend) are none of it. A triangle is taken if each of its directed edges is
    still free, which keeps the mesh edge-manifold, oriented and free of folds; smaller fans at
    pinched corners go at last.
    """
    if len(votes) == 0:
        return np.zeros((0, 3), np.int64)
    triangles, count = tally(votes, len(points))
    longest = edge_lengths(points, triangles).max(axis=1)
    solid = is_solid(points, normals, triangles, longest, least_altitude)
    order = np.lexsort((longest, -count))
    triangles = triangles.take(order[solid[order]], axis=0)
    return without_pinches(triangles[take_in_turn(_edge_numbers(triangles))])


def is_solid(
    points: FloatArray,
    normals: FloatArray,
    triangles: IntArray,
    longest: FloatArray,
    least_altitude: float,
) -> BoolArray:
    """(t,) whether triangles of longest edges (t,) are high enough and lie outside up."""
    cross = np.ascontiguousarray(cross_products(points, triangles).T)
    double = np.sqrt(np.einsum("at,at->t", cross, cross))
    up = normals.T.take(triangles.T, axis=1)
    mean = up[:, 0] + up[:, 1] + up[:, 2]
    facing = np.einsum("at,at->t", cross, mean)
    solid = double > least_altitude * longest
    solid &= facing > FACING * double * np.sqrt(np.einsum("at,at->t", mean, mean))
    # No corner may look the other way: its taxel is on the far side, or its normal turned over.
    return np.asarray(solid & (np.einsum("akt,at->kt", up, cross) > 0).all(axis=0))


def tally(votes: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Triangles (k, 3) that got votes (t, 3), smallest corner first, sorted; votes (k,) of each."""
    corners = np.array(votes.T, np.min_scalar_type(n), order="C")  # short numbers sort quickly
    for _ in range(2):
        corners = np.where(
            corners[0] > corners.min(axis=0), corners.take([1, 2, 0], axis=0), corners
        )
    corners = corners.take(np.lexsort(corners[::-1]), axis=1)
    a, b, c = corners[:, 1:] != corners[:, :-1]
    fresh = np.flatnonzero(np.append(True, a | b | c))
    return np.array(corners[:, fresh].T, np.int64, order="C"), np.diff(fresh, append=len(votes))


def _edge_numbers(triangles: IntArray) -> IntArray:
    """(t, 3) number of the directed edge behind each corner: equal edges, equal numbers."""
    order, same = by_edge(triangles)
    number = np.empty(triangles.size, np.int64)
    number[order] = 2 * np.cumsum(~np.append(False, same)[: len(order)])
    return number.reshape(-1, 3) + (triangles < triangles[:, [1, 2, 0]])


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
    while not one_fan(faces).all():
        fan, vertex = fans(faces)
        size = np.bincount(fan)
        # Largest fan first at each vertex, then the one with the earliest face.
        rank = np.lexsort((np.arange(len(size)), -size, vertex))
        smaller = np.zeros(len(size), np.bool_)
        smaller[rank[1:]] = vertex[rank[1:]] == vertex[rank[:-1]]
        faces = faces[~smaller[fan].reshape(-1, 3).any(axis=1)]
    return faces


def one_fan(faces: IntArray) -> BoolArray:
    """(3 m,) whether each corner is met on one walk round its vertex: not if in a second fan."""
    vertex, ahead = faces.ravel(), corners_ahead(faces)
    begin = np.full(int(vertex.max(initial=-1)) + 1, -1)
    begin[vertex] = np.arange(len(vertex))
    behind = np.zeros(len(vertex) + 1, np.bool_)
    behind[ahead] = True
    ends = np.flatnonzero(~behind[:-1])
    begin[vertex[ends]] = ends
    met, here = np.zeros(len(vertex), np.bool_), begin[begin >= 0]
    while len(here):
        met[here] = True
        here = ahead[here]
        here = here[here >= 0]
        here = here[~met[here]]
    return met


def corners_ahead(faces: IntArray) -> IntArray:
    """(3 m,) next corner at the same vertex, clockwise; -1 where the fan ends."""
    twin = twins(faces)
    # The edge behind corner c runs back from the corner after its twin, at the same vertex.
    after = np.arange(faces.size).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    return np.where(twin >= 0, after[twin], -1)


def fans(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Fan (3 m,) of each corner, numbered by first appearance, and the vertex (k,) of each fan.

    Corners of one vertex are of one fan where their faces share an edge at it.
    """
    start, ahead = faces.ravel(), corners_ahead(faces)
    corner = np.flatnonzero(ahead >= 0)
    fan = number_by_appearance(components(corner, ahead[corner], faces.size))
    return fan, start[np.unique(fan, return_index=True)[1]]

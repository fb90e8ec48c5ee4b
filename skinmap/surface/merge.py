"""From votes to a manifold: greedy insertion, then the closing of small holes."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.topology import boundary_loops, face_components, loop_length
from skinmap.geometry.triangles import (
    cross_2d,
    edge_lengths,
    face_normals,
    smallest_altitudes,
    unit,
)
from skinmap.surface.stars import tangent_frames

SLIVER = 0.02  # in spacings: flatter triangles are three taxels in a row
FACING = 0.3  # cosine between a triangle's normal and its taxels': 73 degrees
SMALL_HOLE = 8  # vertices: inner loops up to here are disagreements between stars


def consensus(points: FloatArray, normals: FloatArray, votes: IntArray, spacing: float) -> IntArray:
    """Faces (m, 3) chosen from voted triangles (t, 3): most votes first, then shortest.

    Slivers and triangles that stand upright on the skin (three border taxels round a bend) are
    none of it. A triangle is taken if each of its directed edges is still free, which keeps the
    mesh edge-manifold, oriented and free of folds; smaller fans at pinched corners go at last.
    """
    if len(votes) == 0:
        return np.zeros((0, 3), np.int64)
    start = np.argmin(votes, axis=1)
    rolled = np.take_along_axis(votes, (start[:, None] + np.arange(3)) % 3, axis=1)
    triangles, count = np.unique(rolled, axis=0, return_counts=True)
    upright = face_normals(points, triangles) * unit(normals[triangles].sum(axis=1))
    solid = smallest_altitudes(points, triangles) > SLIVER * spacing
    solid &= upright.sum(axis=1) > FACING
    triangles, count = triangles[solid], count[solid]
    longest = edge_lengths(points, triangles).max(axis=1)
    taken: set[tuple[int, int]] = set()
    faces = []
    for face in triangles[np.lexsort((longest, -count))].tolist():
        a, b, c = face
        around = ((a, b), (b, c), (c, a))
        if not any(edge in taken for edge in around):
            taken.update(around)
            faces.append(face)
    return without_pinches(np.array(faces, dtype=np.int64).reshape(-1, 3))


def without_pinches(faces: IntArray) -> IntArray:
    """Faces less the smaller fans at vertices where two or more fans meet in a point."""
    while True:
        fans = _fans(faces)
        drop = set()
        for groups in fans.values():
            if len(groups) > 1:
                groups.sort(key=lambda group: (-len(group), group[0]))
                for group in groups[1:]:
                    drop.update(group)
        if not drop:
            return faces
        faces = np.delete(faces, sorted(drop), axis=0)


def _fans(faces: IntArray) -> dict[int, list[list[int]]]:
    """Faces around each vertex, grouped into fans that share edges at that vertex."""
    following: dict[int, dict[int, tuple[int, int]]] = {}
    for number, (a, b, c) in enumerate(faces.tolist()):
        for corner, right, left in ((a, b, c), (b, c, a), (c, a, b)):
            following.setdefault(corner, {})[right] = (left, number)
    fans = {}
    for vertex, steps in following.items():
        lefts = {left for left, _ in steps.values()}
        starts = [right for right in steps if right not in lefts] or [next(iter(steps))]
        groups: list[list[int]] = []
        seen = 0
        while seen < len(steps):
            # Open fans start where nothing comes before; what is left over are closed ones.
            if starts:
                at = starts.pop(0)
            else:
                used = {number for group in groups for number in group}
                at = next(right for right, (_, number) in steps.items() if number not in used)
            group: list[int] = []
            first = at
            while at in steps:
                at, number = steps[at]
                group.append(number)
                if at == first:
                    break
            seen += len(group)
            groups.append(group)
        fans[vertex] = groups
    return fans


def fill_holes(
    points: FloatArray, normals: FloatArray, faces: IntArray, largest: int = SMALL_HOLE
) -> IntArray:
    """Faces with every inner loop of at most `largest` vertices closed.

    The longest loop of each component [m] is its outer border and stays open.
    """
    if len(faces) == 0:
        return faces
    component = np.full(len(points), -1)
    component[faces.ravel()] = np.repeat(face_components(faces), 3)
    longest: dict[int, tuple[float, int]] = {}
    loops = boundary_loops(faces)
    for number, loop in enumerate(loops):
        rank = (loop_length(points, loop), number)
        longest[component[loop[0]]] = max(longest.get(component[loop[0]], rank), rank)
    outer = {number for _, number in longest.values()}
    patches = [
        patch
        for number, loop in enumerate(loops)
        if number not in outer and len(loop) <= largest
        for patch in [close_loop(points, normals, loop)]
    ]
    return np.concatenate([faces, *patches])


def close_loop(points: FloatArray, normals: FloatArray, loop: IntArray) -> IntArray:
    """Faces (k - 2, 3) that close a boundary loop of k vertices, the worst one as good as can be.

    Klincsek's dynamic programme over chords: of all triangulations the one whose flattest
    triangle is least flat, so triangles turned over or without area come last.
    """
    hole = loop[::-1]  # a boundary loop runs with its faces, so the hole's own turn is reversed
    normal = unit(normals[hole].sum(axis=0))
    first, second = tangent_frames(normal[None])
    flat = points[hole] @ np.column_stack([first[0], second[0]])
    n = len(hole)
    worst = np.full((n, n), np.inf)  # quality of the worst triangle beyond the chord i, j
    split = np.zeros((n, n), np.int64)
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            between = np.arange(i + 1, j)
            shape = _quality(flat[i], flat[between], flat[j])
            value = np.minimum(shape, np.minimum(worst[i, between], worst[between, j]))
            worst[i, j], split[i, j] = value.max(), between[np.argmax(value)]
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

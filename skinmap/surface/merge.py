"""From votes to a manifold: greedy insertion, then the closing of small holes."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.topology import boundary_loops, face_components, loop_length
from skinmap.geometry.triangles import cross_2d, edge_lengths, smallest_altitudes
from skinmap.surface.stars import tangent_frames

SLIVER = 0.02  # in spacings: flatter triangles are three taxels in a row
SMALL_HOLE = 8  # vertices: inner loops up to here are disagreements between stars


def consensus(points: FloatArray, votes: IntArray, spacing: float) -> IntArray:
    """Faces (m, 3) chosen from voted triangles (t, 3): most votes first, then shortest.

    A triangle is taken if each of its directed edges is still free, which keeps the mesh
    edge-manifold, oriented and free of folds, and if no corner would be pinched.
    """
    if len(votes) == 0:
        return np.zeros((0, 3), np.int64)
    start = np.argmin(votes, axis=1)
    rolled = np.take_along_axis(votes, (start[:, None] + np.arange(3)) % 3, axis=1)
    triangles, count = np.unique(rolled, axis=0, return_counts=True)
    solid = smallest_altitudes(points, triangles) > SLIVER * spacing
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
    """Faces (k - 2, 3) that close a boundary loop of k vertices, best-shaped ear first."""
    hole = loop[::-1]  # a boundary loop runs with its faces, so the hole's own turn is reversed
    normal = normals[hole].sum(axis=0)
    first, second = tangent_frames((normal / max(np.linalg.norm(normal), 1e-300))[None])
    flat = points[hole] @ np.column_stack([first[0], second[0]])
    left = list(range(len(hole)))
    faces = []
    while len(left) > 3:
        ears = [_ear_quality(flat, left, i) for i in range(len(left))]
        best = int(np.argmax(ears))
        a, b, c = left[best - 1], left[best], left[(best + 1) % len(left)]
        faces.append((hole[a], hole[b], hole[c]))
        left.pop(best)
    faces.append(tuple(hole[left]))
    return np.array(faces, dtype=np.int64)


def _ear_quality(flat: FloatArray, left: list[int], i: int) -> float:
    """Twice the area over the squared longest edge of an ear; negative where it is no ear."""
    corners = [left[i - 1], left[i], left[(i + 1) % len(left)]]
    a, b, c = flat[corners]
    area = float(cross_2d(b - a, c - a))
    longest = max(float((p - q) @ (p - q)) for p, q in ((a, b), (b, c), (c, a)))
    quality = area / longest if longest > 0 else 0.0
    others = flat[[k for k in left if k not in corners]]
    inside = (
        (cross_2d(b - a, others - a) > 0)
        & (cross_2d(c - b, others - b) > 0)
        & (cross_2d(a - c, others - c) > 0)
    )
    return quality - 2.0 if inside.any() else quality

"""Triangles of a plane on a grid of pixels: which triangle a pixel's centre lies in, and coverage.

Pixel (row, column) covers [column, column + 1] x [row, row + 1] in pixel coordinates; x grows to
the right, y downwards.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.topology import border_edges
from skinmap.geometry.triangles import cross_2d

CHUNK = 2**21  # candidates (triangle, pixel) looked at together
ON_EDGE = -1e-9  # barycentric: a centre on an edge belongs to the triangle despite rounding


def locate_pixels(
    points: FloatArray, faces: IntArray, shape: tuple[int, int]
) -> tuple[IntArray, IntArray, FloatArray]:
    """The triangle under each pixel's centre, and where in it.

    Parameters
    ----------
    points : (n, 2) array of float
        In pixel coordinates.
    faces : (m, 3) array of int
    shape : (rows, columns)

    Returns
    -------
    pixels : (k,) array of int
        Row-major numbers of the pixels whose centre lies in a triangle, ascending.
    face : (k,) array of int
        The triangle; where several overlap, the one that the centre lies deepest in.
    weights : (k, 3) array of float
        Barycentric, not negative, summing to 1.
    """
    corners = points[faces]
    low = np.ceil(corners.min(axis=1) - 0.5).astype(np.int64)
    high = np.floor(corners.max(axis=1) - 0.5).astype(np.int64)
    low, high = np.maximum(low, 0), np.minimum(high, np.array(shape[::-1]) - 1)
    size = np.maximum(high - low + 1, 0)
    count = size.prod(axis=1)
    found = [
        _candidates(corners, low, size, count, block, shape[1]) for block in _blocks(count, CHUNK)
    ]
    # Every centre with every triangle that it lies in, down to rounding below 0.
    pixels, face, weights = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    order = np.lexsort((-weights.min(axis=1), pixels))
    first = order[np.flatnonzero(np.diff(pixels[order], prepend=-1))]
    weights = np.maximum(weights[first], 0.0)
    return pixels[first], face[first], weights / weights.sum(axis=1, keepdims=True)


def enclosing_triangles(
    points: FloatArray, faces: IntArray, wanted: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The triangle that each of some points lies deepest in, -1 for none, and where in it.

    Parameters
    ----------
    points : (n, 2) array of float
    faces : (m, 3) array of int
    wanted : (p, 2) array of float

    Returns
    -------
    (p,) array of int
    (p, 3) array of float
        Barycentric, not negative, summing to 1; NaN without a triangle.
    """
    corners = points[faces].swapaxes(0, 1)
    face, weights = np.full(len(wanted), -1), np.full((len(wanted), 3), np.nan)
    step = max(1, CHUNK // max(len(faces), 1))
    for start in range(0, len(wanted) if len(faces) else 0, step):
        every = _barycentric(corners, wanted[start : start + step, None])
        depth = np.where(np.isfinite(every).all(axis=2), every.min(axis=2), -np.inf)
        best = depth.argmax(axis=1)
        rows = np.flatnonzero(depth[np.arange(len(best)), best] >= ON_EDGE)
        inside = np.maximum(every[rows, best[rows]], 0.0)
        face[start + rows] = best[rows]
        weights[start + rows] = inside / inside.sum(axis=1, keepdims=True)
    return face, weights


def _barycentric(corners: FloatArray, at: FloatArray) -> FloatArray:
    """(..., 3) weights of places (..., 2) in triangles (3, ..., 2); not finite without an area."""
    a, b, c = corners
    side, other, to = b - a, c - a, at - a
    area = cross_2d(side, other)
    with np.errstate(divide="ignore", invalid="ignore"):
        beta, gamma = cross_2d(to, other) / area, cross_2d(side, to) / area
        return np.stack([1.0 - beta - gamma, beta, gamma], axis=-1)


def _blocks(count: IntArray, limit: int) -> list[IntArray]:
    """Runs of triangles with about `limit` candidates each."""
    block = np.cumsum(count) // limit
    return np.split(np.arange(len(count)), np.flatnonzero(np.diff(block)) + 1)


def _candidates(
    corners: FloatArray,
    low: IntArray,
    size: IntArray,
    count: IntArray,
    block: IntArray,
    columns: int,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pixel, triangle and weights of every centre that lies in a triangle of the block."""
    face = np.repeat(block, count[block])
    start = np.cumsum(count[block]) - count[block]
    within = np.arange(len(face)) - np.repeat(start, count[block])
    row, column = np.divmod(within, np.maximum(size[face, 0], 1))
    cell = low[face] + np.column_stack([column, row])
    weights = _barycentric(corners[face].swapaxes(0, 1), cell + 0.5)
    inside = weights.min(axis=1) >= ON_EDGE  # a triangle without area holds no centre
    return (cell[:, 1] * columns + cell[:, 0])[inside], face[inside], weights[inside]


def pixel_coverage(points: FloatArray, faces: IntArray, shape: tuple[int, int]) -> FloatArray:
    """(rows, columns) share of each pixel that lies in the triangles, exact, 0 to 1.

    Green's theorem: the area to the right of each border edge, signed, row by row, as in the
    anti-aliasing of glyphs. Edges inside cancel, so only the border is walked along.

    Parameters
    ----------
    points : (n, 2) array of float
        In pixel coordinates, inside the grid.
    faces : (m, 3) array of int
        Counter-clockwise where y grows upwards, not overlapping.
    shape : (rows, columns)
    """
    start, end = _pieces(points[border_edges(faces)])
    middle = 0.5 * (start + end)
    column, row = np.clip(np.floor(middle).astype(np.int64), 0, np.array(shape[::-1]) - 1).T
    rise = end[:, 1] - start[:, 1]
    area = np.zeros((shape[0], shape[1] + 1))
    np.add.at(area, (row, column), rise * (column + 1 - middle[:, 0]))
    onward = np.zeros_like(area)
    np.add.at(onward, (row, column + 1), rise)
    covered = area + np.cumsum(onward, axis=1)
    return np.asarray(np.clip(covered[:, :-1], 0.0, 1.0))


def _pieces(edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Edges (k, 2, 2) cut at the grid lines: starts and ends, each piece within one pixel."""
    number = np.arange(len(edges))
    owner, at = [number, number], [np.zeros(len(edges)), np.ones(len(edges))]
    for axis in (0, 1):
        a, b = edges[:, 0, axis], edges[:, 1, axis]
        first = np.floor(np.minimum(a, b)).astype(np.int64) + 1
        count = np.maximum(np.ceil(np.maximum(a, b)).astype(np.int64) - first, 0)
        edge = np.repeat(number, count)
        line = first[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
        owner.append(edge)
        at.append((line - a[edge]) / (b - a)[edge])
    edge, t = np.concatenate(owner), np.concatenate(at)
    order = np.lexsort((t, edge))
    edge, t = edge[order], np.clip(t[order], 0.0, 1.0)
    places = edges[edge, 0] + t[:, None] * (edges[edge, 1] - edges[edge, 0])
    same = edge[1:] == edge[:-1]
    return places[:-1][same], places[1:][same]

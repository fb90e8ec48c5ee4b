"""Delaunay stars in tangent planes: which triangles each taxel would have around itself."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.proximity import nearest_of
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit
from skinmap.surface.compiled import star_kernel
from skinmap.surface.taxel_cloud import faces_away

NEIGHBOURS = 20  # more than two rings of a hexagonal lattice; a star needs one
FEW = 12  # close most stars too; at borders a little less is seen
JITTER = 1e-4  # in spacings: the least that breaks the ties of a square grid bent in space
FIRST = 12  # nearest to begin with: they close most stars, and the rest then only confirms it
FLAT = 1e-12  # of the inverted size squared: less is a rounding error
CHUNK = 256  # taxels at a time: the k^2 numbers of a star stay in the processor's cache
COMPILED_CHUNK = 65_536  # bounds the memory of the neighbour table


def tangent_offsets(offsets: FloatArray, normals: FloatArray) -> FloatArray:
    """(n, k, 2) offsets (n, k, 3) laid into each tangent plane at their full 3D length [m].

    Keeping the length, not the shadow, makes strongly bent neighbourhoods near-isometric.
    """
    flat = np.einsum("nki,nai->nka", offsets, tangent_frames(normals))
    return unit(flat) * np.linalg.norm(offsets, axis=2, keepdims=True)


def delaunay_stars(
    points: FloatArray,
    normals: FloatArray,
    spacing: float,
    limit: float,
    *,
    neighbours: int = NEIGHBOURS,
    allowed: csr_array | None = None,
    compiled: bool | None = None,
) -> IntArray:
    """Triangles (t, 3) that each point's own tangent-plane Delaunay diagram has around it.

    The first column is the point that votes; the order is counter-clockwise about its normal.
    The neighbours of a point in a Delaunay diagram are the corners of the convex hull of its
    neighbourhood inverted in the unit circle: from each neighbour the hull can only go on to the
    one that turns least, and it does if all others lie to the left of that step.

    Parameters
    ----------
    points : (n, 3) array of float
        [m].
    normals : (n, 3) array of float
        Unit, consistent.
    spacing, limit : float
        Typical distance of neighbours, and the longest edge allowed [m].
    neighbours : int
        Nearest others that a star is made of.
    allowed : (n, n) sparse array, optional
        Its entries are the pairs that may be neighbours; all by default.
    compiled : bool, optional
        Whether numba does it; by default where it is installed and worth its import.

    References
    ----------
    K. Q. Brown, "Voronoi diagrams from convex hulls", Information Processing Letters 9, 1979.
    """
    # Symbolic perturbation: the same for every run, so that co-circular taxels agree on one
    # diagonal. It is no source of randomness that a caller would want to choose.
    jitter = np.random.default_rng(0).normal(scale=JITTER * spacing, size=points.shape)
    shaken = points + jitter
    tree = cKDTree(shaken)
    kernel = star_kernel(len(points), compiled)
    size = CHUNK if kernel is None else COMPILED_CHUNK
    votes = [np.zeros((0, 3), np.int64)]
    for start in range(0, len(points), size):
        rows = np.arange(start, min(start + size, len(points)))
        distance, index = nearest_of(tree, rows, neighbours)
        distance = np.where(faces_away(normals, rows, index), np.inf, distance)
        if allowed is not None:
            own = np.repeat(np.arange(len(rows)), index.shape[1])
            fits = contains(allowed[rows], own, index.ravel()).reshape(index.shape)
            distance = np.where(fits, distance, np.inf)
        if kernel is not None:
            first, second = tangent_frames(normals[rows]).swapaxes(0, 1)
            votes.append(kernel(shaken, first, second, rows, index, distance, limit))
        else:
            votes.append(_stars(shaken, normals, index, distance, limit, rows))
    return np.concatenate(votes)


def contains(pairs: csr_array, first: IntArray, second: IntArray) -> BoolArray:
    """(k,) whether a sparse array has entries at first, second (k,)."""
    n = pairs.shape[1]
    row, column = pairs.tocoo().coords
    return np.isin(first * n + second, row.astype(np.int64) * n + column)


def _stars(
    points: FloatArray,
    normals: FloatArray,
    index: IntArray,
    distance: FloatArray,
    limit: float,
    rows: IntArray,
) -> IntArray:
    flat = tangent_offsets(points[index] - points[rows, None], normals[rows])
    near = (distance <= limit) & (distance > 0)
    squared = np.where(near, distance**2, 1.0)
    inverted = np.where(near[..., None], flat / squared[..., None], 0.0)
    x, y = np.ascontiguousarray(inverted[..., 0]), np.ascontiguousarray(inverted[..., 1])
    tiny = FLAT * np.maximum(np.abs(x), np.abs(y)).max(axis=1, initial=0.0)[:, None] ** 2
    step = np.full(index.shape, -1)
    first = min(FIRST, index.shape[1])
    step[:, :first] = _hull_steps(x[:, :first], y[:, :first], tiny)
    open_rows = np.flatnonzero(_changed_by_more(x, y, tiny, step, first))
    step[open_rows] = _hull_steps(x[open_rows], y[open_rows], tiny[open_rows])
    row, start = np.nonzero((step >= 0) & near)
    end = step[row, start]
    triangles = np.column_stack([rows[row], index[row, start], index[row, end]])
    chord = np.linalg.norm(points[triangles[:, 1]] - points[triangles[:, 2]], axis=1)
    return np.asarray(triangles[near[row, end] & (chord <= limit)])


def _hull_steps(x: FloatArray, y: FloatArray, tiny: FloatArray) -> IntArray:
    """(r, k) where the hull of inverted neighbours x, y (r, k) goes on to from each; else -1."""
    # Of the steps i > j with the origin to the left, that is counter-clockwise about the point,
    # the one that turns least from the way out of the origin through i.
    turn = x[:, :, None] * y[:, None, :] - y[:, :, None] * x[:, None, :]
    along = x[:, :, None] * x[:, None, :] + y[:, :, None] * y[:, None, :]
    along -= (x * x + y * y)[:, :, None]
    forward = turn > tiny[..., None]
    ratio = np.full_like(turn, -np.inf)
    np.divide(along, turn, out=ratio, where=forward)
    step = ratio.argmax(axis=2)
    dx = np.take_along_axis(x, step, 1) - x
    dy = np.take_along_axis(y, step, 1) - y
    side = dx[..., None] * y[:, None, :]
    side -= dy[..., None] * x[:, None, :]
    hull = side.min(axis=2, initial=np.inf) - (dx * y - dy * x) >= -tiny
    return np.where(hull & forward.any(axis=2), step, -1)


def _changed_by_more(
    x: FloatArray, y: FloatArray, tiny: FloatArray, step: IntArray, first: int
) -> BoolArray:
    """(r,) whether the hull of the first neighbours is open, or misses one of the others."""
    if first == x.shape[1]:
        return np.zeros(len(x), np.bool_)
    used = step >= 0
    ends = np.zeros_like(used)
    row, start = np.nonzero(used)
    end = step[row, start]
    ends[row, end] = True
    dx, dy = x[row, end] - x[row, start], y[row, end] - y[row, start]
    side = dx[:, None] * (y[row, first:] - y[row, start][:, None])
    side -= dy[:, None] * (x[row, first:] - x[row, start][:, None])
    outside = side.min(axis=1) < -tiny[row, 0]
    changed = (used != ends).any(axis=1) | (used.sum(axis=1) < 3)
    changed[row[outside]] = True
    return np.asarray(changed)

"""Delaunay stars in tangent planes: which triangles each taxel would have around itself."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import nearest
from skinmap.geometry.triangles import cross_2d, unit

NEIGHBOURS = 20  # more than two rings of a hexagonal lattice; a star needs one
JITTER = 1e-4  # in spacings: the least that breaks the ties of a square grid bent in space
CHUNK = 512  # taxels at a time: the tests of a star are k^3 numbers


def tangent_frames(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit axes (n, 3) each that span the plane across each unit normal (n, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = unit(np.cross(normals, helper))
    return first, np.cross(normals, first)


def tangent_offsets(offsets: FloatArray, normals: FloatArray) -> FloatArray:
    """(n, k, 2) offsets (n, k, 3) laid into each tangent plane at their full 3D length [m].

    Keeping the length, not the shadow, makes strongly bent neighbourhoods near-isometric.
    """
    first, second = tangent_frames(normals)
    flat = np.stack(
        [np.einsum("nki,ni->nk", offsets, first), np.einsum("nki,ni->nk", offsets, second)], axis=2
    )
    return unit(flat) * np.linalg.norm(offsets, axis=2, keepdims=True)


def delaunay_stars(
    points: FloatArray, normals: FloatArray, spacing: float, limit: float
) -> IntArray:
    """Triangles (t, 3) that each point's own tangent-plane Delaunay diagram has around it.

    The first column is the point that votes; the order is counter-clockwise about its normal.
    The neighbours of a point in a Delaunay diagram are the corners of the convex hull of its
    neighbourhood inverted in the unit circle, so one sidedness test per pair gives all stars
    at once.

    Parameters
    ----------
    points : (n, 3) array of float
        [m].
    normals : (n, 3) array of float
        Unit, consistent.
    spacing, limit : float
        Typical distance of neighbours, and the longest edge allowed [m].

    References
    ----------
    K. Q. Brown, "Voronoi diagrams from convex hulls", Information Processing Letters 9, 1979.
    """
    # Symbolic perturbation: the same for every run, so that co-circular taxels agree on one
    # diagonal. It is no source of randomness that a caller would want to choose.
    jitter = np.random.default_rng(0).normal(scale=JITTER * spacing, size=points.shape)
    shaken = points + jitter
    distance, index = nearest(shaken, NEIGHBOURS)
    votes = [
        _stars(shaken, normals, index, distance, limit, rows)
        for rows in np.array_split(np.arange(len(points)), -(-len(points) // CHUNK))
    ]
    return np.concatenate(votes) if votes else np.zeros((0, 3), np.int64)


def _stars(
    points: FloatArray,
    normals: FloatArray,
    index: IntArray,
    distance: FloatArray,
    limit: float,
    rows: IntArray,
) -> IntArray:
    around = index[rows]
    flat = tangent_offsets(points[around] - points[rows, None], normals[rows])
    near = (distance[rows] <= limit) & (distance[rows] > 0)
    squared = np.where(near, distance[rows] ** 2, 1.0)
    inverted = np.where(near[..., None], flat / squared[..., None], 0.0)
    edge = inverted[:, None, :] - inverted[:, :, None]  # [i, j] runs from i to j
    to_other = inverted[:, None, None, :] - inverted[:, :, None, None]
    side = cross_2d(edge[:, :, :, None], to_other)  # [i, j, k]: k left of the edge i > j
    scale = np.abs(inverted).max(axis=(1, 2))[:, None, None, None] ** 2
    hull = (side >= -1e-12 * scale).all(axis=3)
    # The origin strictly to the left: the triangle turns counter-clockwise about the point.
    turns = cross_2d(inverted[:, :, None], inverted[:, None, :]) > 1e-12 * scale[..., 0]
    chord = np.linalg.norm(points[around][:, :, None] - points[around][:, None, :], axis=3)
    fits = hull & turns & near[:, :, None] & near[:, None, :] & (chord <= limit)
    row, first, second = np.nonzero(fits)
    return np.column_stack([rows[row], around[row, first], around[row, second]])

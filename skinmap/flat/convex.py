"""Maps onto a circle: far from isometric, but free of flips whatever the surface.

Floater, "One-to-one piecewise linear mappings over triangulations", Mathematics of Computation
72, 2003: with positive weights and a convex border no triangle flips.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.disc import Disc, factorise
from skinmap.geometry.topology import edges


def uniform_on_circle(disc: Disc) -> FloatArray:
    """(n, 2) every inner vertex in the middle of its neighbours (Tutte 1963) [m]."""
    return _extend(disc, uniform_laplacian(disc.faces, len(disc.vertices)))


def uniform_laplacian(faces: IntArray, n: int) -> csc_array:
    """(n, n) number of neighbours less the neighbours of each vertex."""
    pairs = edges(faces)
    half = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n)).tocsc()
    degree = np.bincount(pairs.ravel(), minlength=n).astype(np.float64)
    return (diags_array(degree) - half - half.T).tocsc()


def harmonic_on_circle(disc: Disc) -> FloatArray:
    """(n, 2) least Dirichlet energy; obtuse triangles can make it flip [m]."""
    return _extend(disc, disc.laplacian)


def _extend(disc: Disc, laplacian: csc_array) -> FloatArray:
    """Solve for the inner vertices, the border on a circle."""
    inner = disc.inner
    uv = np.zeros((len(disc.vertices), 2))
    uv[disc.loop] = _circle(disc)
    if len(inner):
        rows = laplacian[:, inner]
        border = rows[disc.loop].T @ uv[disc.loop]
        uv[inner] = factorise(rows[inner])(-border)
    return uv


def _circle(disc: Disc) -> FloatArray:
    """Border positions (b, 2) on a circle of the area of the disc, spaced by length."""
    border = disc.vertices[disc.loop]
    length = np.linalg.norm(np.roll(border, -1, axis=0) - border, axis=1)
    angle = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(length)[:-1]]) / length.sum()
    radius = np.sqrt(disc.areas.sum() / np.pi)
    return np.asarray(radius * np.column_stack([np.cos(angle), np.sin(angle)]))

"""Boundary first flattening: a conformal map whose border keeps its lengths.

Sawhney and Crane, "Boundary First Flattening", ACM Transactions on Graphics 37(1), 2017.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.flat.disc import Disc
from skinmap.flat.factorisation import factorise


def boundary_first(disc: Disc) -> FloatArray:
    """Flatten a disc with scale factor 1 along its border.

    Returns
    -------
    (n, 2) array of float
        Flat coordinates [m].
    """
    laplacian, loop, inner = disc.laplacian, disc.loop, disc.inner
    rows = laplacian[:, inner]
    coupling = rows[loop].T.tocsc()
    solve = factorise(rows[inner], solver=disc.solver) if len(inner) else None
    # Cherrier: the curvature that leaves the inside appears along the border.
    scale = solve(disc.angle_sums[inner] - 2.0 * np.pi) if solve else np.zeros(0)
    turning = np.pi - disc.angle_sums[loop] + coupling.T @ scale
    border = _closed_curve(disc.vertices[loop], turning)
    uv = np.zeros((len(disc.vertices), 2))
    uv[loop] = border
    if solve:
        uv[inner] = solve(-(coupling @ border))
    return uv


def _closed_curve(points: FloatArray, turning: FloatArray) -> FloatArray:
    """Plane curve (b, 2) with given exterior angles and nearly the lengths of a space loop."""
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    # The angles sum to 2 pi but for rounding; spread what is missing.
    heading = np.cumsum(turning * (2.0 * np.pi / turning.sum()))
    heading -= heading[0]
    tangent = np.stack([np.cos(heading), np.sin(heading)])
    weighted = tangent * length  # N^-1 T^T of the paper, N = diag(1 / length)
    length = length - weighted.T @ np.linalg.solve(tangent @ weighted.T, tangent @ length)
    curve = np.cumsum(tangent * length, axis=1).T
    return np.vstack([np.zeros(2), curve[:-1]])

"""Boundary first flattening: a conformal map whose border keeps its lengths.

Sawhney and Crane, "Boundary First Flattening", ACM Transactions on Graphics 37(1), 2017.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from skinmap.arrays import FloatArray, IntArray


def bff(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Flatten a disc with scale factor 1 along its border.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m]; every vertex belongs to a face.
    faces : (m, 3) array of int
        A disc.
    loop : (b,) array of int
        Its boundary, in the direction of its faces.

    Returns
    -------
    (n, 2) array of float
        Flat coordinates [m].
    """
    import igl

    inner = np.setdiff1d(np.arange(len(vertices)), loop)
    laplacian = csc_array(-igl.cotmatrix(vertices, faces))
    factor = splu(laplacian[inner][:, inner]) if len(inner) else None
    coupling = laplacian[inner][:, loop]
    angle_sum = np.bincount(
        faces.ravel(), igl.internal_angles(vertices, faces).ravel(), minlength=len(vertices)
    )
    # Cherrier: the curvature that leaves the inside appears along the border.
    scale = factor.solve(angle_sum[inner] - 2.0 * np.pi) if factor else np.zeros(0)
    turning = np.pi - angle_sum[loop] + coupling.T @ scale
    border = _closed_curve(vertices[loop], turning)
    uv = np.zeros((len(vertices), 2))
    uv[loop] = border
    if factor:
        uv[inner] = factor.solve(-(coupling @ border))
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

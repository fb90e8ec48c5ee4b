"""Rigid transforms, written T_a_b: they map b-coordinates to a; turns and frames of planes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, check_finite
from skinmap.errors import InvalidArrayError
from skinmap.geometry.triangles import cross, unit

DIGITS = 6  # that a component of a normal is compared to: rounding errors lie ten digits below


def tangent_frames(normals: FloatArray) -> FloatArray:
    """Two axes across each normal, right-handed with it.

    The first lies across the coordinate axis that the normal has least of. Where the skin is flat,
    two components of a normal are near zero and which is less depends on how a processor rounds.
    So components are compared to six digits, and of equal ones the first coordinate is taken.

    Parameters
    ----------
    normals : (..., 3) array of float
        Unit.

    Returns
    -------
    (..., 2, 3) array of float
        Unit axes; zero where a normal is.

    Examples
    --------
    >>> import numpy as np
    >>> tangent_frames(np.array([0.0, 0.0, 1.0])) + 0.0
    array([[ 0.,  1.,  0.],
           [-1.,  0.,  0.]])
    """
    helper = np.eye(3)[np.argmin(np.abs(normals).round(DIGITS), axis=-1)]
    first = unit(cross(normals, helper))
    return np.stack([first, cross(normals, first)], axis=-2)


def plane_turns(angles: FloatArray | float) -> FloatArray:
    """(..., 2, 2) rotations of columns by angles (...) [rad], counter-clockwise.

    Points in rows (n, 2) are turned by `points @ plane_turns(angle).T`.

    Parameters
    ----------
    angles : (...) array of float
    [rad].

    Returns
    -------
    (..., 2, 2) array of float

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.geometry import plane_turns
    >>> (np.array([[1.0, 0.0]]) @ plane_turns(np.pi / 2).T).round(9) + 0.0
    array([[0., 1.]])
    """
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def check_transform(transform: ArrayLike, name: str = "transform") -> FloatArray:
    """A rigid (4, 4) matrix.

    Raises
    ------
    InvalidArrayError
        Not of that shape, not finite, or not a rotation with a translation.
    """
    matrix = check_finite(transform, name, (4, 4))
    rotation = matrix[:3, :3]
    # URDF files give angles with six or more digits; 1e-6 forgives them and nothing coarser.
    if not (
        np.allclose(rotation @ rotation.T, np.eye(3), rtol=0, atol=1e-6)
        and np.linalg.det(rotation) > 0
        and np.array_equal(matrix[3], [0, 0, 0, 1])
    ):
        raise InvalidArrayError(f"{name} is not rigid: {matrix.tolist()}")
    return matrix


def rpy_matrix(rpy: Sequence[float]) -> FloatArray:
    """(3, 3) of roll, pitch, yaw [rad] about fixed x, y, z: Rz(yaw) Ry(pitch) Rx(roll)."""
    (a, b, c), (sa, sb, sc) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [b * c, c * sa * sb - a * sc, sa * sc + a * c * sb],
            [b * sc, a * c + sa * sb * sc, a * sb * sc - c * sa],
            [-sb, b * sa, a * b],
        ]
    )


def transform_points(transform: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 3) points [m] carried by a (4, 4) transform."""
    return points @ transform[:3, :3].T + transform[:3, 3]


def transform_directions(transform: FloatArray, directions: FloatArray) -> FloatArray:
    """(n, 3) directions turned by a (4, 4) transform."""
    return directions @ transform[:3, :3].T


def rigid_transform(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """T (4, 4) that turns by a rotation (3, 3) and then shifts by a translation (3,)."""
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = translation
    return transform


def turn_about(
    middle: FloatArray, rotation: FloatArray, shift: FloatArray | float = 0.0
) -> FloatArray:
    """T (4, 4) that turns by a rotation (3, 3) about a point (3,), and then shifts by (3,)."""
    return rigid_transform(rotation, middle + shift - rotation @ middle)


def motion_slopes(arms: FloatArray) -> FloatArray:
    """(n, 3, 6) slopes of points at arms (n, 3) to a small turn about the pivot, and a shift."""
    swept = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
    return np.concatenate([swept, np.broadcast_to(np.eye(3), swept.shape)], axis=2)


def rigid_fit(places: FloatArray, points: FloatArray, weights: FloatArray) -> FloatArray:
    """T (4, 4) that carries places (k, 3) nearest to points (k, 3) in the weighted mean square.

    Kabsch, Acta Crystallographica A32, 1976; never a mirror image.
    """
    share = weights / weights.sum()
    a, b = share @ places, share @ points
    u, _, vt = np.linalg.svd(((places - a) * share[:, None]).T @ (points - b))
    sign = np.sign(np.linalg.det(vt.T @ u.T))
    rotation = vt.T @ np.diag([1.0, 1.0, sign]) @ u.T
    return rigid_transform(rotation, b - rotation @ a)

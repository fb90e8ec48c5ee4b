"""Axes in the plane across a normal, and turns in a plane."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.geometry.triangles import unit

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
    first = unit(np.cross(normals, helper))
    return np.stack([first, np.cross(normals, first)], axis=-2)


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

"""Which way is up on a flat map: along the limb, the same for every pose and numbering."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.triangles import cross_products

LENGTH_SHARE = 0.2  # how much the spread counts against the normals: enough for flat plates
SURE = 0.3  # cosine: an axis further than 73 degrees from the upward direction says nothing
STEEP = 0.35  # slope: flatter charts lie across the limb, another direction has to tell


def limb_frame(vertices: FloatArray, faces: IntArray, up: FloatArray | None = None) -> FloatArray:
    """Directions (3, 3) in rows: along the limb, then the way most of its surface looks.

    The surface of a limb looks away from its axis, so the axis is the direction that normals
    contain least of; a plate has two such, and its length decides.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m].
    faces : (m, 3) array of int
    up : (3,) array of float, optional
        Upward direction. Where there is none, or the limb lies across it, the narrow end hangs
        down: area reaches further below its centre than above.

    Returns
    -------
    (3, 3) array of float
        Unit vectors, orthogonal. They turn with the body, mirror with it, and do not depend on
        the order of vertices or faces.
    """
    cross = cross_products(vertices, faces)
    double = np.linalg.norm(cross, axis=1)
    weight = double / double.sum()
    normals = cross / np.where(double > 0, double, 1.0)[:, None]
    looks = (normals * weight[:, None]).T @ normals
    corners, share = vertices[faces].reshape(-1, 3), np.repeat(weight / 3.0, 3)
    centred = corners - share @ corners
    spread = (centred * share[:, None]).T @ centred
    _, directions = np.linalg.eigh(looks - LENGTH_SHARE * spread / np.trace(spread))
    axis = _signed(directions[:, 0], centred, share, up)
    facing = weight @ normals - (weight @ normals @ axis) * axis
    if np.linalg.norm(facing) < 1e-6:  # looks everywhere alike: a tube, a ball
        facing = _signed(directions[:, 1], centred, share, None)
    facing = facing / np.linalg.norm(facing)
    return np.stack([axis, facing, np.cross(axis, facing)])


def _signed(
    axis: FloatArray, centred: FloatArray, weight: FloatArray, up: FloatArray | None
) -> FloatArray:
    if up is not None and abs(axis @ up) > SURE * np.linalg.norm(up):
        return np.asarray(axis * np.sign(axis @ up))
    height = centred @ axis
    skew = weight @ height**3 / (weight @ height**2) ** 1.5
    if abs(skew) > 1e-6:  # rounding on a body with two like ends stays below this
        return np.asarray(-axis * np.sign(skew))
    return np.asarray(axis * np.sign(axis[np.argmax(np.abs(axis))]))


def upright(uv: FloatArray, height: FloatArray) -> FloatArray:
    """Coordinates (n, 2) turned so that the values `height` (n,) [m] grow upwards on average."""
    gradient = _slope(uv, height)
    centred = uv - uv.mean(axis=0)
    length = float(np.linalg.norm(gradient))
    if length == 0.0:
        return np.asarray(centred)
    c, s = gradient[1] / length, gradient[0] / length
    return np.asarray(centred @ np.array([[c, s], [-s, c]]))


def turn_upright(uv: FloatArray, vertices: FloatArray, frame: FloatArray) -> FloatArray:
    """A chart (n, 2) of vertices (n, 3) [m] turned so that the limb's axis points up.

    On a chart that lies across the limb, such as the cap at its end, the way that the limb's
    surface looks points down: the cap continues below it.
    """
    for direction in (frame[0], -frame[1], frame[2]):
        height = vertices @ direction
        if np.linalg.norm(_slope(uv, height)) > STEEP:
            return upright(uv, height)
    return upright(uv, vertices @ frame[0])


def _slope(uv: FloatArray, height: FloatArray) -> FloatArray:
    gradient, *_ = np.linalg.lstsq(uv - uv.mean(axis=0), height - height.mean(), rcond=None)
    return np.asarray(gradient)

"""A checkerboard on a flat map, carried to the body: what one square becomes there is seen."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray

BOARD = np.array([[0.93, 0.94, 0.95, 1.0], [0.30, 0.44, 0.62, 1.0]])  # squares: light, dark
SQUARES = 14  # across a map, about
MAX_CUT = 8_000  # triangles: finer ones take the colour under their middle


def square_side(uv: FloatArray) -> float:
    """Side of the squares for a map (n, 2): the largest of 1, 2, 5 times a power of ten."""
    length = float(np.ptp(uv, axis=0).max()) / SQUARES
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= 1.000001 * length))


def checkerboard(
    uv: FloatArray, body: FloatArray, side: float
) -> tuple[list[FloatArray], IntArray, IntArray]:
    """Triangles cut along the lines of a board.

    Parameters
    ----------
    uv : (m, 3, 2) array of float
        Corners on the map.
    body : (m, 3, 3) array of float
        The same on the body.
    side : float
        Of the squares, in the unit of the map.

    Returns
    -------
    pieces : list of (k, 5) array of float
        Polygons: coordinates on the map, then on the body.
    triangle : (p,) array of int
        Where each piece comes from.
    colour : (p,) array of int
        0 or 1.
    """
    both = np.concatenate([uv, body], axis=2)
    if len(uv) > MAX_CUT:
        cell = np.floor(uv.mean(axis=1) / side).astype(np.int64)
        return list(both), np.arange(len(uv)), cell.sum(axis=1) % 2
    pieces, triangle, colour = [], [], []
    for number, corners in enumerate(both):
        for column, strip in _strips(corners, 0, side):
            for row, piece in _strips(strip, 1, side):
                pieces.append(piece)
                triangle.append(number)
                colour.append((column + row) % 2)
    return pieces, np.array(triangle, np.int64), np.array(colour, np.int64)


def _strips(polygon: FloatArray, axis: int, side: float) -> list[tuple[int, FloatArray]]:
    """A convex polygon (k, 5) cut along the lines x_axis = i side, each strip with its i."""
    low = int(np.floor(polygon[:, axis].min() / side))
    high = int(np.ceil(polygon[:, axis].max() / side))
    found = []
    rest = polygon
    for i in range(low, max(high - 1, low)):
        line = (i + 1) * side
        below = _half(rest, line - rest[:, axis])
        rest = _half(rest, rest[:, axis] - line)
        if len(below) >= 3:
            found.append((i, below))
    if len(rest) >= 3:
        found.append((max(high - 1, low), rest))
    return found


def _half(polygon: FloatArray, inside: FloatArray) -> FloatArray:
    """The part (k, 5) of a convex polygon where a linear function (k,) is not negative.

    Sutherland and Hodgman, Communications of the ACM 17(1), 1974.
    """
    kept = []
    for k in range(len(polygon)):
        a, b = inside[k - 1], inside[k]
        if (a < 0) != (b < 0):
            kept.append(polygon[k - 1] + a / (a - b) * (polygon[k] - polygon[k - 1]))
        if b >= 0:
            kept.append(polygon[k])
    return np.array(kept).reshape(-1, polygon.shape[1])

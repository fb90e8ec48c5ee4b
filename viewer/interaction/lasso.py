"""The lasso: a line drawn by hand around points, closed by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import BoolArray, FloatArray, check_finite

STRIDE = 2.0  # shorter moves add no corner [px]
LEAST = 3  # corners that enclose anything


class Lasso:
    """Corners (k, 2) of a line that follows the mouse [px]."""

    def __init__(self, x: float, y: float) -> None:
        self._corners = [(float(x), float(y))]

    def to(self, x: float, y: float) -> bool:
        """Go on to a place; False where that is too near to the last corner to count."""
        if np.hypot(x - self._corners[-1][0], y - self._corners[-1][1]) < STRIDE:
            return False
        self._corners.append((float(x), float(y)))
        return True

    @property
    def corners(self) -> FloatArray:
        """(k, 2) [px]."""
        return np.array(self._corners)

    @property
    def drawn(self) -> bool:
        """Whether it encloses anything: a click does not."""
        return len(self._corners) >= LEAST

    def holds(self, points: ArrayLike) -> BoolArray:
        """(n,) which of the points (n, 2) [px] lie inside."""
        return inside(self.corners, points)


def inside(polygon: ArrayLike, points: ArrayLike) -> BoolArray:
    """Which points lie inside a closed polygon that may cross itself: the even-odd rule.

    Parameters
    ----------
    polygon : (k, 2) array-like of float
    points : (n, 2) array-like of float
        In the same unit.

    Returns
    -------
    (n,) array of bool
        NaN points lie outside.

    References
    ----------
    Shimrat, "Algorithm 112: Position of point relative to polygon", CACM 1962.
    """
    corners = check_finite(polygon, "polygon", (None, 2))
    x, y = np.asarray(points, np.float64).reshape(-1, 2).T
    odd = np.zeros(len(x), bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        crossed = (y0 > y) != (y1 > y)
        odd ^= crossed & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return odd

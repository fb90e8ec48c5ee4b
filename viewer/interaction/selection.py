"""Chosen taxels: one by one, by module, by patch, or all within a lasso."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite
from skinmap.surface.surface_mesh import SurfaceMesh

Reach = Literal["taxel", "module", "patch"]
NONE = np.zeros(0, np.int64)

STRIDE = 2.0  # shorter moves add no corner [px]
LEAST = 3  # corners that enclose anything


class Selection(dict[str, IntArray]):
    """Chosen taxels (k,) of each part, dense rows in rising order; parts without any are absent."""

    @property
    def count(self) -> int:
        """Taxels chosen on all parts."""
        return sum(len(taxels) for taxels in self.values())

    def taxels(self, part: str) -> IntArray:
        """(k,) chosen taxels of a part."""
        return self.get(part, NONE)

    def set(self, part: str, taxels: ArrayLike) -> None:
        """Choose these taxels of a part and no others of it."""
        rows = np.unique(np.asarray(taxels, np.int64))
        if len(rows):
            self[part] = rows
        else:
            self.pop(part, None)

    def replace(self, part: str, taxels: ArrayLike) -> None:
        """Choose these taxels of a part and nothing else at all."""
        self.clear()
        self.set(part, taxels)

    def toggle(self, part: str, taxels: ArrayLike) -> None:
        """Add taxels; where all of them are chosen already, let them go."""
        rows = np.asarray(taxels, np.int64)
        old = self.taxels(part)
        if np.isin(rows, old).all():
            self.set(part, np.setdiff1d(old, rows))
        else:
            self.set(part, np.concatenate([old, rows]))


def reached(mesh: SurfaceMesh, taxel: int, reach: Reach) -> IntArray:
    """(k,) what one click chooses: the taxel, its module or its patch.

    A taxel that no face uses is a patch alone.
    """
    groups = {"module": mesh.skin.modules, "patch": mesh.taxel_patches}
    if reach == "taxel" or groups[reach][taxel] < 0:
        return np.array([taxel])
    return np.flatnonzero(groups[reach] == groups[reach][taxel])


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
        if y0 != y1:
            odd ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return odd

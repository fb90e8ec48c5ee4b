"""The way that a contact's centre has gone along the skin."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.geometry.surface_path import SurfaceWalker

STEP = 2e-3  # the noise of a resting finger moves its centre by less than this [m]
POINTS = 512  # of a way kept; a longer one forgets its beginning, not its length


class Stroke:
    """A way along the surface, a point whenever the centre is a step from the last one.

    Parameters
    ----------
    walker : SurfaceWalker
    start : (3,) float
        [m].
    face : int
        Triangle of the start.
    """

    def __init__(self, walker: SurfaceWalker, start: FloatArray, face: int) -> None:
        self._walker = walker
        self._place = np.array(start)
        self._face = face
        self._points = [self._place]
        self.length = 0.0

    def add(self, centre: FloatArray, face: int) -> bool:
        """Follow the centre (3,) [m]; whether it was far enough."""
        x, y, z = (centre - self._place).tolist()
        if x * x + y * y + z * z < STEP * STEP:
            return False
        way = self._walker.path(self._place, self._face, centre, face)
        self.length += float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
        self._points.extend(way[1:])
        del self._points[:-POINTS]
        self._place, self._face = np.array(centre), face
        return True

    @property
    def points(self) -> FloatArray:
        """(p, 3) oldest first [m]."""
        return np.array(self._points)

"""A contact that is followed: its number, its taxels and its measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.surface_path import SurfaceWalker
from skinmap.live.contacts.sample_contacts import Measured

SETTLED = 0.1  # contacts that join or part do so in earnest after this time [s]
SAMPLES = 1.5  # and never from one sample to the next, however slow the stream
DRAWING = 0.25  # of its largest load: a contact that leaves draws no way
STEP = 2e-3  # the noise of a resting finger moves its centre by less than this [m]
POINTS = 512  # of a way kept; a longer one forgets its beginning, not its length


@dataclass(eq=False, slots=True)
class Track:
    """A contact that is followed.

    Attributes
    ----------
    identity, part : int
        Its number, and its part's row.
    began, seen : float
        First sample, and the last one in which it was felt [s].
    taxels : (k,) int
        In the numbering of `JoinedSkin`.
    centre, normal : (3,) float
    area, load, peak, mean, force : float
        As measured last; force is NaN where nobody knows.
    stroke : Stroke
    largest, highest, heaviest : float
        Area, peak and load at their largest.
    touch : int
        Number of the touch that it is part of.
    apart : float
        Since when a piece of it lies apart [s]; NaN where none does.
    flat : float
        Since when it has had no summit of its own [s]; NaN where it has one.
    looked : float
        When it was last looked for a saddle that parts it [s].
    saddle : bool
        Whether there was one then.
    into : int
        That took its place without a valley between, -1 else.
    """

    identity: int
    part: int
    began: float
    seen: float
    taxels: IntArray
    centre: FloatArray
    normal: FloatArray
    area: float = 0.0
    load: float = 0.0
    peak: float = 0.0
    mean: float = 0.0
    force: float = float("nan")
    stroke: Stroke | None = None
    largest: float = 0.0
    highest: float = 0.0
    heaviest: float = 0.0
    touch: int = -1
    apart: float = float("nan")
    flat: float = float("nan")
    looked: float = float("-inf")
    saddle: bool = False
    into: int = -1

    def note(self, found: Measured, place: int, time: float, walker: SurfaceWalker) -> bool:
        """Keep what was measured of it at `place`; whether its stroke has grown."""
        self.seen, self.into = time, -1
        self.centre, self.normal = found.centre[place], found.normal[place]
        self.area, self.load = float(found.area[place]), float(found.load[place])
        self.peak, self.mean = float(found.peak[place]), float(found.mean[place])
        if found.force is not None:
            self.force = float(found.force[place])
        self.largest = max(self.largest, self.area)
        self.highest = max(self.highest, self.peak)
        face = int(found.face[place])
        grown = False
        if self.stroke is None or time - self.began < SETTLED:
            # While it lands the centre goes with what lands next, not with the hand.
            self.stroke = Stroke(walker, self.centre, face)
        elif self.load >= DRAWING * self.heaviest:
            grown = self.stroke.add(self.centre, face)
        self.heaviest = max(self.heaviest, self.load)
        return grown


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

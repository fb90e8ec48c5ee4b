"""A contact that is followed: its number, its taxels and its measures."""

from __future__ import annotations

from dataclasses import dataclass

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.surface_path import SurfaceWalker
from skinmap.live.contacts.contact_path import Stroke
from skinmap.live.contacts.sample_contacts import Measured

SETTLED = 0.1  # contacts that join or part do so in earnest after this time [s]
DRAWING = 0.25  # of its largest load: a contact that leaves draws no way


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

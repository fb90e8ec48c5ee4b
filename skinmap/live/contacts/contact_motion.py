"""Which way a touch moves and how fast: from its centre, rolled out along the surface.

The centre is that of the load of all contacts of a touch, so it goes on evenly where contacts
part, join or cross a gap. Its steps are laid into a plane whose axes are carried along by the least
rotation between the normals: a geodesic becomes a straight line, and the velocity is the slope of a
line through the last places. docs/motion.md has the formulas and what the errors were fitted on.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, Frozen, IntArray
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import tangent_frames
from skinmap.live.contacts.sample_contacts import DRAWING, Track
from skinmap.live.robot_skin import JoinedSkin
from skinmap.skin.skin import Skin
from skinmap.summary import Summary
from skinmap.touch.contacts.motion_features import presses
from skinmap.touch.contacts.skin_geometry import ACTIVE

Triple = tuple[float, float, float]
Heading = Literal["still", "up", "down", "round left", "round right", "to and fro"]
WINDOW = 0.2  # a velocity is taken from the places of so long at least [s]
LONGEST = 1.0  # and at most [s]
# And from a way of so many spacings: over one the lattice makes the centre go unevenly, over some
# the islands of a contact do.
PITCHES = 5.0
PLACES = 256  # that are kept
# Of the middle speed: less is landing, turning or leaving; and the share of the others that the
# speed of a touch exceeds. Fitted on strokes on three parts of the iCub, our own and MuJoCo's.
EVEN, UPPER = 0.8, 60.0
STILL = 8e-3  # slower is still: a resting finger trembles [m/s]
FASTEST = 1.0  # nobody strokes quicker: a step beyond is a contact that came or went [m/s]
# Of the variance of a window's residuals that its slope may be wrong by: the centre wanders within
# the contact, over ways as long as the window's, so that little of it shows as residuals. Fitted on
# our strokes and two variants of MuJoCo's: nine of ten velocities are wrong by less than twice it.
FREE = 0.25
WOBBLE = 0.12  # by which the lattice misplaces a centre, in spacings: the least error of a place
STEEP = 0.35  # of what is up, less is left in the skin's plane: its long axis tells instead
SHORT = 15e-3  # a shorter way has no heading [m]
STRAIGHT = 0.5  # of the way, a touch that comes less far goes to and fro
OPPOSED = 0.05  # shorter mean normals are of contacts that face away from each other
LAID = 1e-3  # steps are laid into the plane when they are so long [m]
# The way is that of the smoothed place, in steps of so many spacings: what trembles adds no length.
SMOOTH, STRIDE = 0.05, 0.25  # [s]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Motion(Frozen, Summary):
    """How a touch moves now, and how it has moved.

    Attributes
    ----------
    velocity : (3,) float
        Along the skin, in the link's frame [m/s].
    error : float
        Standard error of the velocity in any direction [m/s]; inf while too little is known.
    up, right : float
        The velocity in the part's axes: up as the robot at rest has it (along the part where
        that is out of the skin), and to the right as one sees who looks at the skin [m/s].
    heading : {"still", "up", "down", "round left", "round right"}
        The same as a word.
    length : float
        Of the way so far [m].
    presses : int
        How often it was pressed: 1, or more of taps and pats.
    period : float
        Mean time between their beginnings [s]; NaN of a single press.
    answer : str
        How it moves, by a model: still, tap, pat, stroke, rub, slide, twist or squeeze; empty where
        no model answers.
    probability : float
        That this is right; NaN where there is none.
    set : tuple of str
        The names that hold the truth in nine of ten touches, the likeliest first.
    """

    velocity: FloatArray
    error: float
    up: float
    right: float
    heading: Heading
    length: float
    presses: int = 1
    period: float = float("nan")
    answer: str = ""
    probability: float = float("nan")
    set: tuple[str, ...] = ()

    @property
    def speed(self) -> float:
        """[m/s]."""
        return float(np.linalg.norm(self.velocity))

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "heading": self.heading,
            "speed": f"{1e3 * self.speed:.0f} mm/s",
            "length": f"{1e3 * self.length:.0f} mm",
            "presses": self.presses,
        }


@dataclass(frozen=True, slots=True)
class Course:
    """How a touch went on, from its beginning on.

    Attributes
    ----------
    heading : str
        As of `Motion`, or "to and fro".
    speed : float
        While it moved evenly [m/s].
    length : float
        Of the way [m].
    up, right : float
        How far it came in the part's axes, as of `Motion` [m].
    """

    heading: Heading = "still"
    speed: float = 0.0
    length: float = 0.0
    up: float = 0.0
    right: float = 0.0


class RolledWay:
    """The way of one touch, rolled out into a plane as it comes.

    Parameters
    ----------
    spacing : float
        Of the taxels [m].

    Attributes
    ----------
    gone : list of 2 float
        How far up and to the right it has come [m].
    speeds : deque of (float, float)
        While it moved, the last ones, and their errors [m/s].
    """

    def __init__(self, spacing: float) -> None:
        self.spacing = spacing
        self._passed = 0.0  # of the smoothed way [m]
        # Places in the plane, as complex numbers [m]: of the last sample, and where it is laid to.
        self._last = self._at = 0j
        self.gone = [0.0, 0.0]  # up and to the right, in sum [m]
        self.speeds: deque[tuple[float, float]] = deque(maxlen=PLACES)
        self._moved = False
        self._heaviest = 0.0
        # Time and place in the plane, and the way so far, column by column; the last ones count.
        self._rows: FloatArray = np.zeros((3, 2 * PLACES))
        self._ways: list[tuple[float, float]] = []
        self._first = 0  # column of the window's first place
        self._axes: tuple[Triple, Triple] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._centre: Triple = (0.0, 0.0, 0.0)
        self._normal: Triple = (0.0, 0.0, 0.0)
        self._smooth = self._anchor = 0j
        self._velocity: tuple[FloatArray, float] | None = None

    def add(self, time: float, centre: Triple, normal: Triple, load: float) -> Triple | None:
        """Follow the centre [m] of a touch whose skin faces along a normal.

        Returns
        -------
        tuple of 3 float or None
            By how much the plane was laid further, in the link's frame [m]; None where it was not.
        """
        self._heaviest = max(self._heaviest, load)
        if not self._ways:
            self._axes = tangent_frames(np.array(normal)).tolist()
            self._centre, self._normal = centre, normal
        elif load < DRAWING * self._heaviest:
            return None  # what lets go draws no way
        before, place = self._at, self._rolled(centre, normal)
        step = _size(place - before)
        past = time - self._ways[-1][0] if self._ways else 0.0
        if past > 0 and step > FASTEST * past + 0.5 * self.spacing:
            place = before  # a contact came or went: the plane is moved on instead
            self._begin_at(centre, normal, place)
        elif step >= LAID:
            self._begin_at(centre, normal, place)
        if len(self._ways) == 2 * PLACES:
            self._rows[:, :PLACES] = self._rows[:, PLACES:]
            del self._ways[:PLACES]
            self._first = max(0, self._first - PLACES)
        self._smooth -= math.expm1(-past / SMOOTH) * (place - self._smooth)
        stride = _size(self._smooth - self._anchor)
        if stride >= STRIDE * self.spacing:
            self._passed += stride
            self._anchor = self._smooth
        self._rows[:, len(self._ways)] = time, place.real, place.imag
        self._ways.append((time, self._passed))
        self._last = place
        self._velocity = None
        laid, (a, b) = self._at - before, self._axes
        x, y, z = (laid.real * one + laid.imag * other for one, other in zip(a, b, strict=True))
        return (x, y, z) if laid else None

    @property
    def length(self) -> float:
        """Of the way: the smoothed one, and from its last step to the last place [m]."""
        return self._passed + _size(self._last - self._anchor)

    def velocity(self) -> tuple[FloatArray, float]:
        """Velocity (3,) and its standard error [m/s]: a line through the last places.

        The window goes back until the way in it is `PITCHES` spacings. Its residuals repeat as the
        lattice does, not from sample to sample, so that their number does not make it better.
        """
        if self._velocity is None:
            slope, error = self._slope()
            a, b = self._axes
            found = [slope[0] * one + slope[1] * other for one, other in zip(a, b, strict=True)]
            self._velocity = np.array(found), error
            speed = math.hypot(*slope)
            if speed > STILL and math.isfinite(error):
                self.speeds.append((speed, error))
                self._moved |= speed > error
        return self._velocity

    @property
    def speed(self) -> float:
        """While it moved evenly [m/s]; 0 where it stayed.

        The median of all speeds by the weight of their errors says which were slower: of a touch
        that lands, turns or leaves. Of the others it is the one that `UPPER` % do not exceed.
        """
        if not self.speeds or not self._moved:
            return 0.0
        speeds, errors = np.array(self.speeds).T
        order = np.argsort(speeds)
        weight = np.cumsum(errors[order] ** -2.0)
        middle = speeds[order][int(np.searchsorted(weight, 0.5 * weight[-1]))]
        return float(np.percentile(speeds[speeds >= EVEN * middle], UPPER))

    def _slope(self) -> tuple[tuple[float, float], float]:
        """Slope in the plane and its standard error."""
        first, count = self._begin_window(), len(self._ways)
        if count - first < 3:
            return (0.0, 0.0), float("inf")
        rows = self._rows[:, first:count]
        slope, away, spread = _line(rows)
        half = len(away) // 2  # np.median takes several times as long
        most = 9.0 * float(np.partition(away, half)[half]) + (0.1 * self.spacing) ** 2
        if away.max() > most:
            keep = away <= most
            if np.count_nonzero(keep) >= 3:
                # Once more without what lies far off: a landing, a contact that came.
                slope, away, spread = _line(rows[:, keep])
        variance = 0.5 * float(np.add.reduce(away)) / len(away) + (WOBBLE * self.spacing) ** 2
        error = math.sqrt(variance / (FREE * spread)) if spread > 0 else float("inf")
        return slope, error

    def _begin_window(self) -> int:
        """Column of the first place that a velocity is taken from; it only moves on."""
        ways, first = self._ways, self._first
        now, way = ways[-1] if ways else (0.0, 0.0)
        early, near = now - WINDOW, way - PITCHES * self.spacing
        while first < len(ways) and (
            ways[first][0] < now - LONGEST or (ways[first][0] < early and ways[first][1] < near)
        ):
            first += 1
        self._first = first
        return first

    def _rolled(self, centre: Triple, normal: Triple) -> complex:
        """Place in the plane of a centre one step further."""
        (u, v, w), (x, y, z) = centre, self._centre
        step = u - x, v - y, w - z
        (a, b), (c, d) = self._axes, self._carried(normal)
        flat = complex(dot(a, step) + dot(c, step), dot(b, step) + dot(d, step))
        size = _size(flat)
        return self._at + math.hypot(*step) / size * flat if size else self._at

    def _begin_at(self, centre: Triple, normal: Triple, at: complex) -> None:
        self._axes = self._carried(normal)
        self._centre, self._normal, self._at = centre, normal, at

    def _carried(self, normal: Triple) -> tuple[Triple, Triple]:
        """The plane's axes turned by the least rotation to another normal."""
        before = self._normal
        scale = 1.0 / max(1.0 + dot(before, normal), 1e-9)
        m = (
            (before[0] + normal[0]) * scale,
            (before[1] + normal[1]) * scale,
            (before[2] + normal[2]) * scale,
        )

        def turned(axis: Triple) -> Triple:
            along = dot(axis, normal)
            return axis[0] - along * m[0], axis[1] - along * m[1], axis[2] - along * m[2]

        return turned(self._axes[0]), turned(self._axes[1])


def _size(way: complex) -> float:
    return math.hypot(way.real, way.imag)


def _line(rows: FloatArray) -> tuple[tuple[float, float], FloatArray, float]:
    """Slope of a line through times and places (3, k), squared residuals and variance of times."""
    count = rows.shape[1]
    away = rows - np.add.reduce(rows, axis=1, keepdims=True) / count
    t, places = away[0], away[1:]
    spread, tx, ty = (away @ t).tolist()
    u, v = (tx / spread, ty / spread) if spread > 0 else (0.0, 0.0)
    left = places - np.array([[u], [v]]) * t
    left *= left
    return (u, v), left[0] + left[1], spread / count


def dot(one: Triple, other: Triple) -> float:
    """Product of two vectors of three numbers."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


class MotionBook:
    """The motion of each touch.

    Parameters
    ----------
    skin : JoinedSkin
    """

    def __init__(self, skin: JoinedSkin) -> None:
        self.skin = skin
        self.ways: dict[int, RolledWay] = {}
        skins = [one.skin for one in skin.skins.values()]
        self._spacing = [median_spacing(one.positions) for one in skins]
        self._axes = [_axes_of(one) for one in skins]
        self._beside = np.zeros(len(skin) + 1, np.bool_)
        self._places: FloatArray = np.column_stack([skin.positions, skin.normals])

    def update(
        self, time: float, groups: Mapping[int, Sequence[Track]], pressures: FloatArray
    ) -> None:
        """Take the contacts of a sample with pressures (N,), by the number of what is followed."""
        for number, members in groups.items():
            rows = [one.taxels for one in members]
            index = self._with_faint(rows[0] if len(rows) == 1 else np.concatenate(rows), pressures)
            centre, normal = self.middle(index, pressures[index])
            load = sum(one.load for one in members)
            self.add(time, number, members[0].part, centre, normal, load)

    def _with_faint(self, taxels: IntArray, pressures: FloatArray) -> IntArray:
        """The taxels of a contact, and those beside them that feel too little to be part of it.

        They tell where its edge lies in between.
        """
        self._beside[self.skin.neighbours[taxels]] = True
        near = np.flatnonzero(self._beside[:-1])
        self._beside[near] = self._beside[-1] = False
        level = pressures[near]
        faint = near[(level > 0.0) & (level <= ACTIVE)]
        return np.concatenate([taxels, faint]) if len(faint) else taxels

    def middle(self, taxels: IntArray, pressures: FloatArray) -> tuple[Triple, Triple]:
        """Centre [m] and mean normal of taxels (k,) with pressures (k,).

        Each counts by its area, as it speaks for that, and by the root of its pressure: gains of
        taxels and what is stiff below the skin move the heaviest spot about inside of a contact.
        """
        share = np.sqrt(np.maximum(pressures, 0.0)) * self.skin.areas[taxels]
        x, y, z, a, b, c = (share @ self._places[taxels]).tolist()
        whole = float(share.sum())
        size = math.sqrt(a * a + b * b + c * c)
        if whole <= 0 or size < OPPOSED * whole:  # both sides of a limb: no plane is theirs
            a, b, c = self.skin.normals[taxels[0]].tolist()
            size = 1.0
        if whole <= 0:
            x, y, z = self.skin.positions[taxels].mean(axis=0).tolist()
            whole = 1.0
        return (x / whole, y / whole, z / whole), (a / size, b / size, c / size)

    def add(
        self, time: float, number: int, part: int, centre: Triple, normal: Triple, load: float
    ) -> None:
        """Take the centre [m], mean normal and load of what is followed at a time [s]."""
        way = self.ways.get(number)
        if way is None:
            way = self.ways[number] = RolledWay(self._spacing[part])
        step = way.add(time, centre, normal, load)
        if step is not None:
            up, right = self._axes_at(part, normal)
            way.gone[0] += dot(step, up)
            way.gone[1] += dot(step, right)

    def motion(
        self,
        number: int,
        part: int,
        normal: FloatArray,
        *,
        presses: int = 1,
        period: float = float("nan"),
    ) -> Motion | None:
        """How a touch moves now; None of one that is not followed."""
        way = self.ways.get(number)
        if way is None:
            return None
        velocity, error = way.velocity()
        x, y, z = velocity.tolist()
        n = (float(normal[0]), float(normal[1]), float(normal[2]))
        up, right = self._axes_at(part, n)
        rise, aside, speed = dot((x, y, z), up), dot((x, y, z), right), math.hypot(x, y, z)
        word = heading(rise, aside, speed, error)
        return Motion(velocity, error, rise, aside, word, way.length, presses, period)

    def course(self, number: int) -> Course:
        """How a touch has gone so far."""
        way = self.ways.get(number)
        if way is None:
            return Course()
        speed, (up, right) = way.speed, way.gone
        if way.length < SHORT or speed <= 0:
            return Course("still", 0.0, way.length, up, right)
        word: Heading = heading(up, right, 1.0, 0.0)
        if math.hypot(up, right) < STRAIGHT * way.length:
            word = "to and fro"
        return Course(word, speed, way.length, up, right)

    def join(self, number: int, into: int) -> None:
        """A touch turned out to be part of another one."""
        if number in self.ways and into not in self.ways:
            self.ways[into] = self.ways[number]
        self.ways.pop(number, None)

    def drop(self, number: int) -> None:
        """Forget a touch that is over."""
        self.ways.pop(number, None)

    def forget(self) -> None:
        """The clock began anew."""
        self.ways.clear()

    def _axes_at(self, part: int, normal: Triple) -> tuple[Triple, Triple]:
        """Unit directions in the skin: up, and to the right as one sees who looks at it."""
        u, n = self._up_at(part, normal), normal
        right = u[1] * n[2] - u[2] * n[1], u[2] * n[0] - u[0] * n[2], u[0] * n[1] - u[1] * n[0]
        return u, right

    def _up_at(self, part: int, normal: Triple) -> Triple:
        """Unit direction in the skin that is up, or along the part where none is."""
        for axis in self._axes[part]:
            along = dot(axis, normal)
            flat = tuple(one - along * other for one, other in zip(axis, normal, strict=True))
            size = math.hypot(*flat)
            if size >= STEEP:
                return flat[0] / size, flat[1] / size, flat[2] / size
        return tuple(tangent_frames(np.array(normal))[0].tolist())


def recorded_course(book: MotionBook, samples: NDArray[np.uint8], rate: float) -> Course:
    """How a recorded touch went in its longest press.

    Parameters
    ----------
    book : MotionBook
        Of its part alone; what it followed before is forgotten.
    samples : (k, n) array of 0 to 255
        Of the taxels of the touch; those of others are 0.
    rate : float
        Samples a second.
    """
    book.forget()
    weight = np.where(samples > ACTIVE, samples, 0).astype(np.float64)
    loads = weight.sum(axis=1)
    longest = max(presses(loads, rate), key=lambda one: one[1] - one[0], default=(0, 0))
    for row in range(*longest):
        index = np.flatnonzero(weight[row])
        if len(index) == 0:  # a press may leave off for a moment
            continue
        centre, normal = book.middle(index, weight[row, index])
        book.add(row / rate, 0, 0, centre, normal, float(loads[row]))
        book.ways[0].velocity()
    return book.course(0)


def heading(up: float, right: float, speed: float, error: float) -> Heading:
    """A velocity [m/s] as a word; slower than `STILL` or than its error is still."""
    if speed < STILL or not speed > error:
        return "still"
    if abs(up) >= abs(right):
        return "up" if up > 0 else "down"
    return "round right" if right > 0 else "round left"


def _axes_of(skin: Skin) -> tuple[Triple, ...]:
    """What is up on a part, where that is known, and the direction in which it is longest."""
    away = skin.positions - skin.positions.mean(axis=0)
    longest = np.linalg.svd(away, full_matrices=False)[2][0]
    longest = longest * np.sign(longest[int(np.argmax(np.abs(longest)))])
    found = [longest] if skin.up is None else [skin.up, longest]
    return tuple((float(a), float(b), float(c)) for a, b, c in found)

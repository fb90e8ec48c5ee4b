"""Touches in time laid on a skin: the loads of poses on the way, and the course through them.

A hand goes along the surface itself (`geometry.point_surface`), so strokes follow the body and
cross the gaps between patches. Its footprint is computed every few millimetres or degrees, on the
same bed of springs as that of still touches, and in between is mixed of its neighbours.

Touches in time: what strokes, pats, rubs and grips are made with, and how they go on.

Speeds and rhythms are those of people who touch robots and each other: strokes of 20 to 300 mm/s,
pats and taps two to five times a second, rubs at one to two and a half (docs/motion.md has the
sources, and says what is estimated). A slow person is slow in all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from skinmap.arrays import FloatArray
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.point_surface import STEP, PointSurface, Way
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit
from skinmap.skin.skin import Skin
from skinmap.touch.recording import TrueMotion
from skinmap.touch.simulation.elastic_bed import Foam, bed_loads
from skinmap.touch.simulation.hands import HANDS, STIFF, Body, Draw, fingertip, shared, shifted
from skinmap.touch.simulation.variety import LESS_ON_SKIN, Subject

SPEED = (0.02, 0.3)  # of strokes [m/s]
RHYTHM = (0.8, 1.0, 1.25)  # of a person, by habit


@dataclass(frozen=True, eq=False, slots=True)
class Course:
    """How a touch goes on, sampled.

    Attributes
    ----------
    times : (t,) float
        Of the samples [s].
    press : (t,) float
        Share of the full force.
    along : (t,) float
        How far it has come on its way [m].
    turned : (t,) float
        How far it has turned [rad].
    onsets, ends : (k,) float
        Of each press [s].
    """

    times: FloatArray
    press: FloatArray
    along: FloatArray
    turned: FloatArray
    onsets: FloatArray
    ends: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class TimeGesture:
    """A touch in time, drawn.

    Attributes
    ----------
    bodies : tuple of Body
        What presses, x ahead.
    way : float
        How far it goes [m]; 0 where it stays.
    bend : float
        Geodesic curvature of the way [1/m].
    course : callable
        Of the length of way that there is [m], to a `Course`.
    other : tuple of Body
        What presses on the opposed side; nothing where it does not grip.
    """

    bodies: tuple[Body, ...]
    way: float
    bend: float
    course: Callable[[float], Course]
    other: tuple[Body, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Timing:
    """What courses are drawn with: samples a second, random numbers, and who touches."""

    rate: float
    rng: np.random.Generator
    subject: Subject

    def seconds(self, low: float, high: float) -> float:
        """A time of this person [s]."""
        return self.subject.pace * float(self.rng.uniform(low, high))

    def period(self, low: float, high: float) -> float:
        """A time between two beats of this person [s]."""
        drawn = float(np.exp(self.rng.uniform(np.log(low), np.log(high))))
        return float(np.clip(drawn * RHYTHM[self.subject.habit], low, high))

    def times(self, seconds: float) -> FloatArray:
        """(t,) of the samples of so many seconds [s]."""
        return np.arange(0.0, seconds, 1.0 / self.rate) + 0.5 / self.rate


def _row(count: int, draw: Draw) -> list[Body]:
    """Fingertips side by side, across the way."""
    between = draw.length(16.0, 22.0)
    tips = [
        fingertip((float(draw.within(-3e-3, 3e-3)), (k - (count - 1) / 2) * between), 1.0, draw)
        for k in range(count)
    ]
    return shared(tips, draw.force(0.8 * count, 3.0 * count), draw, 0.2)


def _flat(draw: Draw) -> list[Body]:
    """Fingers laid down side by side, without the palm, as a soft hand strokes."""
    fingers, between = int(draw.rng.integers(2, 5)), draw.length(17.0, 21.0)
    half, radius = draw.length(16.0, 30.0), draw.length(6.5, 9.5)
    flesh = draw.ratio(0.8e7, 4e7)
    bodies = []
    for k in range(fingers):
        y = (k - (fingers - 1) / 2) * between
        follows = draw.within(0.3, 0.95)
        bodies.append(Body((-half, y), (half, y), radius, draw.within(0, 12), 1.0, flesh, follows))
    # The fingers of a hand that strokes lie along the way or across it.
    turn = float(draw.rng.choice([0.0, 0.5 * np.pi])) + draw.within(-0.5, 0.5)
    return shared(turned(bodies, turn), draw.force(1.5 * fingers, 4.0 * fingers), draw, 0.3)


def turned(bodies: Sequence[Body], angle: float) -> list[Body]:
    """Bodies turned about the origin [rad]."""
    c, s = float(np.cos(angle)), float(np.sin(angle))

    def about(point: tuple[float, float]) -> tuple[float, float]:
        return c * point[0] - s * point[1], s * point[0] + c * point[1]

    return [replace(one, start=about(one.start), end=about(one.end)) for one in bodies]


def _stroking(draw: Draw) -> list[Body]:
    kind = draw.rng.random()
    if kind < 0.35:
        return _row(1, draw)
    return _row(int(draw.rng.integers(2, 4)), draw) if kind < 0.65 else _flat(draw)


def _moved(
    timing: Timing, reach: float, speed: float, *, rise: float, fall: float, early: float
) -> Course:
    """Along `reach` at a speed; it lands while it begins to move, or a little before."""
    ramp = min(0.12, 0.5 * reach / speed)
    moving = reach / speed + ramp
    start = early * rise
    time = timing.times(start + moving + fall * 0.6)
    since = np.clip(time - start, 0.0, moving)
    grow, last = np.minimum(since, ramp), np.clip(since - (moving - ramp), 0.0, ramp)
    along = speed * (since - grow + grow**2 / (2.0 * ramp) - last**2 / (2.0 * ramp))
    end = start + moving + fall * 0.6
    press = np.clip(np.minimum(time / rise, (end - time) / fall), 0.0, 1.0)
    return Course(time, press, along, np.zeros(len(time)), np.zeros(1), np.array([end]))


def stroke(draw: Draw, timing: Timing) -> TimeGesture:
    """A hand or fingers drawn along the skin: straight, or in a curve."""
    rng, subject = draw.rng, timing.subject
    speed = float(np.clip(np.exp(rng.uniform(*np.log(SPEED))) / subject.pace, *SPEED))
    bend = 0.0 if rng.random() < 0.5 else float(rng.choice([-1.0, 1.0]) / rng.uniform(0.06, 0.2))
    rise, fall = timing.seconds(0.05, 0.15), timing.seconds(0.05, 0.15)
    early = float(rng.uniform(0.2, 1.5))

    def course(reach: float) -> Course:
        return _moved(timing, reach, speed, rise=rise, fall=fall, early=early)

    return TimeGesture(tuple(_stroking(draw)), float(rng.uniform(0.06, 0.22)), bend, course)


def slide(draw: Draw, timing: Timing) -> TimeGesture:
    """The edge of a board that slides across the skin, mostly sideways."""
    rng = draw.rng
    speed = float(np.exp(rng.uniform(*np.log((0.02, 0.2)))))
    half, radius = 1e-3 * draw.within(18.0, 45.0), 1e-3 * draw.within(1.5, 3.5)
    angle = 0.5 * np.pi + draw.within(-0.6, 0.6)
    one = Body((-half, 0.0), (half, 0.0), radius, 0.0, draw.force(3.0, 15.0), STIFF)
    rise, fall = timing.seconds(0.08, 0.2), timing.seconds(0.08, 0.2)

    def course(reach: float) -> Course:
        return _moved(timing, reach, speed, rise=rise, fall=fall, early=1.0)

    return TimeGesture(tuple(turned([one], angle)), float(rng.uniform(0.04, 0.14)), 0.0, course)


def rub(draw: Draw, timing: Timing) -> TimeGesture:
    """To and fro, two to six times."""
    rng = draw.rng
    reach = float(rng.uniform(0.018, 0.06))
    period, cycles = timing.period(0.4, 1.0), int(rng.integers(2, 7))
    rise, fall = timing.seconds(0.05, 0.15), timing.seconds(0.05, 0.15)

    def course(there: float) -> Course:
        end = rise + cycles * period + fall
        time = timing.times(end)
        phase = np.clip(time - rise, 0.0, cycles * period) / period
        along = 0.5 * min(reach, there) * (1.0 - np.cos(2.0 * np.pi * phase))
        press = np.clip(np.minimum(time / rise, (end - time) / fall), 0.0, 1.0)
        return Course(time, press, along, np.zeros(len(time)), np.zeros(1), np.array([end]))

    return TimeGesture(tuple(_stroking(draw)), reach, 0.0, course)


def _beats(timing: Timing, count: int, period: float, share: float) -> Course:
    """Presses in a rhythm, each of its own strength."""
    rng = timing.rng
    late = np.clip(rng.normal(0.0, 0.05, count), -0.12, 0.12)
    starts: FloatArray = np.asarray(period * (np.arange(count) + late - late[0]), np.float64)
    drawn = period * share * rng.uniform(0.85, 1.15, count)
    lasting: FloatArray = np.asarray(np.clip(drawn, 0.05, None), np.float64)
    time = timing.times(float(starts[-1] + lasting[-1]))
    press = np.zeros(len(time))
    for start, long in zip(starts, lasting, strict=True):
        ramp = 0.3 * long
        beat = np.minimum((time - start) / ramp, (start + long - time) / ramp)
        press = np.maximum(press, rng.uniform(0.7, 1.0) * np.clip(beat, 0.0, 1.0))
    still = np.zeros(len(time))
    return Course(time, press, still, still, starts, starts + lasting)


def tap(draw: Draw, timing: Timing) -> TimeGesture:
    """A fingertip, or two, one to five times and quickly."""
    rng = draw.rng
    count, period = int(rng.integers(1, 6)), timing.period(0.2, 0.45)
    share = float(rng.uniform(0.3, 0.5))
    tips = _row(1 if rng.random() < 0.8 else 2, draw)
    return TimeGesture(tuple(tips), 0.0, 0.0, lambda _: _beats(timing, count, period, share))


def pat(draw: Draw, timing: Timing) -> TimeGesture:
    """A flat hand, two to six times."""
    rng = draw.rng
    count, period = int(rng.integers(2, 7)), timing.period(0.28, 0.6)
    share = float(rng.uniform(0.35, 0.6))
    hand = HANDS["whole_hand"](draw) if rng.random() < 0.6 else _flat(draw)
    return TimeGesture(tuple(hand), 0.0, 0.0, lambda _: _beats(timing, count, period, share))


def twist(draw: Draw, timing: Timing) -> TimeGesture:
    """Fingertips round a knob, or a finger laid down: pressed, then turned by 35 to 110 degrees."""
    rng = draw.rng
    made = HANDS["three_finger" if rng.random() < 0.6 else "full_finger"](draw)
    angle = float(np.radians(rng.uniform(35.0, 110.0)) * rng.choice([-1.0, 1.0]))
    rise, fall = timing.seconds(0.08, 0.2), timing.seconds(0.08, 0.2)
    before, turning = timing.seconds(0.0, 0.3), timing.seconds(0.4, 1.1)

    def course(_: float) -> Course:
        end = rise + before + turning + fall
        time = timing.times(end)
        share = np.clip((time - rise - before) / turning, 0.0, 1.0)
        press = np.clip(np.minimum(time / rise, (end - time) / fall), 0.0, 1.0)
        bent = angle * share**2 * (3.0 - 2.0 * share)
        return Course(time, press, np.zeros(len(time)), bent, np.zeros(1), np.array([end]))

    middle = np.mean([one.middle for one in made], axis=0)
    return TimeGesture(tuple(shifted(made, -middle)), 0.0, 0.0, course)


def _held(timing: Timing, lasting: float, waves: int) -> Course:
    """Pressed for a time, with some waves of the force."""
    rise, fall = timing.seconds(0.1, 0.3), timing.seconds(0.08, 0.25)
    end = rise + lasting + fall
    time = timing.times(end)
    press = np.clip(np.minimum(time / rise, (end - time) / fall), 0.0, 1.0)
    wave = np.sin(np.pi * waves * np.clip((time - rise) / lasting, 0.0, 1.0)) ** 2
    press = press * (1.0 - 0.4 * wave)
    still = np.zeros(len(time))
    return Course(time, press, still, still, np.zeros(1), np.array([end]))


def squeeze(draw: Draw, timing: Timing) -> TimeGesture:
    """Thumb and fingers on opposed sides of a limb."""
    lasting, waves = timing.seconds(0.3, 1.6), int(draw.rng.integers(0, 3))
    thumb = _row(1, draw)
    fingers = turned(_row(int(draw.rng.integers(1, 5)), draw), float(draw.rng.uniform(0, np.pi)))
    return TimeGesture(
        tuple(thumb), 0.0, 0.0, lambda _: _held(timing, lasting, waves), tuple(fingers)
    )


def hold(draw: Draw, timing: Timing) -> TimeGesture:
    """A hand or a finger that stays for 2 to 5 seconds."""
    kinds = ("whole_hand", "full_finger", "three_finger", "poke")
    made = HANDS[kinds[int(draw.rng.integers(len(kinds)))]](draw)
    lasting = float(draw.rng.uniform(2.0, 5.0))
    return TimeGesture(tuple(made), 0.0, 0.0, lambda _: _held(timing, lasting, 0))


TIME_GESTURES: dict[str, Callable[[Draw, Timing], TimeGesture]] = {
    made.__name__: made for made in (stroke, pat, tap, rub, slide, twist, squeeze, hold)
}


POSES = 4e-3  # between two footprints of a way [m]
TURN = np.radians(9.0)  # and of a twist
LEAST_SHARE = 0.5  # of the way that was wanted
FELT = 0.15  # load that any taxel tells from noise
ALWAYS = 0.85  # share of the poses in which it is felt
FAR = 0.02  # what lies further from all bodies of a pose bears no load [m]
OPPOSED = -0.3  # cosine of the normals under thumb and fingers at most
GRIP = (0.025, 0.11)  # across a limb, for an adult's hand [m]


@dataclass(frozen=True, eq=False, slots=True)
class Laid:
    """A touch in time on a skin.

    Attributes
    ----------
    loads : (k, n) float
        Of each pose at full press.
    weights : (t, k) float
        Share of each pose in each sample.
    motion : TrueMotion
        From its first sample on.
    """

    loads: FloatArray
    weights: FloatArray
    motion: TrueMotion


# Loads (n,) at full press of a hand at a spot (3,), its x along a heading (3,), turned by an angle
# [rad]; of what presses on the opposed side where the last is true.
Press = Callable[[FloatArray, FloatArray, float, bool], FloatArray]


def bed_press(
    skin: Skin, graph: csr_array, surface: PointSurface, gesture: TimeGesture, foam: Foam
) -> Press:
    """Our own bed of springs, on a skin with its steps (n, n) [m]."""

    def press(spot: FloatArray, heading: FloatArray, angle: float, other: bool) -> FloatArray:
        bodies = turned(gesture.other if other else gesture.bodies, angle)
        source = surface.nearest(spot)
        normal = skin.normals[source]
        first = unit(heading - (heading @ normal) * normal)
        frame = np.stack([first, np.cross(normal, first)])
        reach = FAR + max(
            float(np.hypot(*end)) + one.radius for one in bodies for end in (one.start, one.end)
        )
        uv, _ = log_map(skin.positions, skin.normals, graph, source, reach, frame=frame)
        step = spot - skin.positions[source]
        flat = frame @ step
        length = float(np.linalg.norm(flat))
        if length > 0:
            flat *= float(np.linalg.norm(step)) / length
        return bed_loads(bodies, foam, uv - flat, skin).sum(axis=0)

    return press


def lay(
    surface: PointSurface,
    gesture: TimeGesture,
    press: Press,
    hand: float,
    *,
    rng: np.random.Generator,
    over: float = 0.0,
) -> Laid | None:
    """A touch in time at a taxel drawn at random; None where it does not fit.

    One that moves along the skin may go `over` its rim so far [m], or come from there.
    """
    start = int(rng.integers(len(surface.points)))
    heading = _tangent(surface.normals[start], float(rng.uniform(0.0, 2.0 * np.pi)))
    if gesture.other:
        return _grip(surface, gesture, start, heading, hand, press)
    if gesture.way > 0:
        return _moving(surface, gesture, start, heading, press, over=over, rng=rng)
    return _staying(surface, gesture, start, heading, press)


def _moving(
    surface: PointSurface,
    gesture: TimeGesture,
    start: int,
    heading: FloatArray,
    press: Press,
    *,
    over: float,
    rng: np.random.Generator,
) -> Laid | None:
    way = surface.walk(surface.points[start], heading, gesture.way, bend=gesture.bend, over=over)
    if way.length < LEAST_SHARE * gesture.way:
        return None
    if over > 0.0 and rng.random() < 0.5:
        way = way.back()
    course = gesture.course(way.length)
    laid = along_way(way, course, press)
    felt = (laid.loads > FELT).any(axis=1)
    return laid if felt.mean() >= ALWAYS - LESS_ON_SKIN * (over > 0.0) else None


def along_way(way: Way, course: Course, press: Press) -> Laid:
    """A hand that goes along a way as a course says."""
    far = float(course.along.max(initial=0.0))
    count = max(2, int(np.ceil(far / POSES)) + 1)
    at = np.linspace(0.0, max(far, POSES), count)
    rows = np.minimum(np.rint(at / STEP).astype(np.int64), len(way.points) - 1)
    loads = [press(way.points[k], way.headings[k], 0.0, False) for k in rows.tolist()]
    place = course.along / (at[1] - at[0])
    lengths = STEP * np.arange(len(way.points))
    spots = np.column_stack([np.interp(course.along, lengths, one) for one in way.points.T])
    weights = _between(place, count) * course.press[:, None]
    return Laid(np.array(loads), weights, _truth(course, spots))


def _staying(
    surface: PointSurface, gesture: TimeGesture, start: int, heading: FloatArray, press: Press
) -> Laid | None:
    course = gesture.course(0.0)
    spot, normal, _ = surface.project(surface.points[start])
    heading = unit(heading - (heading @ normal) * normal)
    whole = float(np.abs(course.turned).max(initial=0.0))
    count = 1 + int(np.ceil(whole / TURN))
    angles = np.linspace(0.0, 1.0, count) * float(course.turned[-1])
    loads = np.array([press(spot, heading, angle, False) for angle in angles.tolist()])
    least = 3 if count > 1 else 1  # one taxel does not show how it turns
    if (loads > FELT).sum(axis=1).min() < least or loads.max() < 2.0 * FELT:
        return None
    place = np.zeros(len(course.press))
    if count > 1:
        place = np.abs(course.turned) / whole * (count - 1)
    return Laid(loads, _between(place, count) * course.press[:, None], _truth(course))


def _grip(
    surface: PointSurface,
    gesture: TimeGesture,
    start: int,
    heading: FloatArray,
    hand: float,
    press: Press,
) -> Laid | None:
    """Thumb on one side of a limb, fingers on the other."""
    points, normals = surface.points, surface.normals
    away = points - points[start]
    gap = np.linalg.norm(away, axis=1)
    opposed = normals @ normals[start] < OPPOSED
    opposed &= (gap > GRIP[0]) & (gap < GRIP[1] * hand)
    opposed &= away @ normals[start] < -0.5 * gap
    if not opposed.any():
        return None
    depth = np.where(opposed, away @ normals[start] / np.maximum(gap, 1e-9), np.inf)
    end = int(np.argmin(depth))
    course = gesture.course(0.0)
    far = unit(heading - (heading @ normals[end]) * normals[end])
    sides = [
        press(points[start], heading, 0.0, False),
        press(points[end], far, 0.0, True),
    ]
    if min(float(side.max()) for side in sides) < 2.0 * FELT:
        return None
    return Laid(np.sum(sides, axis=0)[None], course.press[:, None], _truth(course))


def _between(place: FloatArray, count: int) -> FloatArray:
    """(t, count) weights of the two poses beside each place (t,), counted in poses."""
    low = np.clip(place.astype(np.int64), 0, max(count - 2, 0))
    share = np.clip(place - low, 0.0, 1.0)
    weights = np.zeros((len(place), count))
    rows = np.arange(len(place))
    weights[rows, low] += 1.0 - share
    if count > 1:
        weights[rows, low + 1] += share
    return weights


def _truth(course: Course, spots: FloatArray | None = None) -> TrueMotion:
    turn = float(course.turned[-1]) if len(course.turned) else 0.0
    if spots is None:
        return TrueMotion(course.onsets, course.ends, np.zeros(0), np.zeros((0, 3)), turn)
    return TrueMotion(course.onsets, course.ends, course.times, spots, turn)


def _tangent(normal: FloatArray, angle: float) -> FloatArray:
    return np.asarray([np.cos(angle), np.sin(angle)] @ tangent_frames(normal))

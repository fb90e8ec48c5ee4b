"""Touches in time laid on a skin: the loads of poses on the way, and the course through them.

A hand goes along the surface itself (`geometry.point_surface`), so strokes follow the body and
cross the gaps between patches. Its footprint is computed every few millimetres or degrees, on the
same bed of springs as that of still touches, and in between is mixed of its neighbours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
from skinmap.touch.simulation.hands import Body
from skinmap.touch.simulation.time_gestures import Course, TimeGesture, turned

POSES = 4e-3  # between two footprints of a way [m]
TURN = np.radians(9.0)  # and of a twist
LEAST_SHARE = 0.5  # of the way that was wanted
FELT = 0.15  # load that any taxel tells from noise
ALWAYS = 0.85  # share of the poses in which it is felt
FAR = 0.02  # what lies further from all bodies of a pose bears no load [m]
OPPOSED = -0.3  # cosine of the normals under thumb and fingers at most
GRIP = (0.025, 0.11)  # across a limb, for an adult's hand [m]


@dataclass(frozen=True, eq=False, slots=True)
class Ground:
    """A skin to lay touches on.

    Attributes
    ----------
    skin : Skin
    graph : (n, n) sparse
        Steps along the skin [m].
    surface : PointSurface
    """

    skin: Skin
    graph: csr_array
    surface: PointSurface


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


def bed_press(ground: Ground, gesture: TimeGesture, foam: Foam) -> Press:
    """Our own bed of springs."""

    def press(spot: FloatArray, heading: FloatArray, angle: float, other: bool) -> FloatArray:
        bodies = gesture.other if other else gesture.bodies
        return footprint(ground, turned(bodies, angle), spot, heading, foam)

    return press


def lay(
    ground: Ground, gesture: TimeGesture, press: Press, hand: float, *, rng: np.random.Generator
) -> Laid | None:
    """A touch in time at a place drawn at random; None where it does not fit."""
    start = int(rng.integers(len(ground.skin)))
    heading = _tangent(ground.skin.normals[start], float(rng.uniform(0.0, 2.0 * np.pi)))
    if gesture.other:
        return _grip(ground, gesture, start, heading, hand, press)
    if gesture.way > 0:
        return _moving(ground, gesture, start, heading, press)
    return _staying(ground, gesture, start, heading, press)


def _moving(
    ground: Ground, gesture: TimeGesture, start: int, heading: FloatArray, press: Press
) -> Laid | None:
    way = ground.surface.walk(ground.skin.positions[start], heading, gesture.way, bend=gesture.bend)
    if way.length < LEAST_SHARE * gesture.way:
        return None
    course = gesture.course(way.length)
    laid = along_way(way, course, press)
    felt = (laid.loads > FELT).any(axis=1)
    return laid if felt.mean() >= ALWAYS else None


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
    ground: Ground, gesture: TimeGesture, start: int, heading: FloatArray, press: Press
) -> Laid | None:
    course = gesture.course(0.0)
    spot, normal, _ = ground.surface.project(ground.skin.positions[start])
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
    ground: Ground,
    gesture: TimeGesture,
    start: int,
    heading: FloatArray,
    hand: float,
    press: Press,
) -> Laid | None:
    """Thumb on one side of a limb, fingers on the other."""
    skin = ground.skin
    away = skin.positions - skin.positions[start]
    gap = np.linalg.norm(away, axis=1)
    opposed = skin.normals @ skin.normals[start] < OPPOSED
    opposed &= (gap > GRIP[0]) & (gap < GRIP[1] * hand)
    opposed &= away @ skin.normals[start] < -0.5 * gap
    if not opposed.any():
        return None
    depth = np.where(opposed, away @ skin.normals[start] / np.maximum(gap, 1e-9), np.inf)
    end = int(np.argmin(depth))
    course = gesture.course(0.0)
    far = unit(heading - (heading @ skin.normals[end]) * skin.normals[end])
    sides = [
        press(skin.positions[start], heading, 0.0, False),
        press(skin.positions[end], far, 0.0, True),
    ]
    if min(float(side.max()) for side in sides) < 2.0 * FELT:
        return None
    return Laid(np.sum(sides, axis=0)[None], course.press[:, None], _truth(course))


def footprint(
    ground: Ground, bodies: Sequence[Body], spot: FloatArray, heading: FloatArray, foam: Foam
) -> FloatArray:
    """(n,) load of bodies at a spot (3,) of the skin, their x along a heading (3,)."""
    skin, surface = ground.skin, ground.surface
    source = surface.nearest(spot)
    normal = skin.normals[source]
    first = unit(heading - (heading @ normal) * normal)
    frame = np.stack([first, np.cross(normal, first)])
    reach = FAR + max(
        float(np.hypot(*end)) + one.radius for one in bodies for end in (one.start, one.end)
    )
    uv, _ = log_map(skin.positions, skin.normals, ground.graph, source, reach, frame=frame)
    step = spot - skin.positions[source]
    flat = frame @ step
    length = float(np.linalg.norm(flat))
    if length > 0:
        flat *= float(np.linalg.norm(step)) / length
    return bed_loads(bodies, foam, uv - flat, skin).sum(axis=0)


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

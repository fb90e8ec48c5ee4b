"""Touches in time as MuJoCo presses them: a hand at rest in each of the poses of its way.

Quasi-static: in every pose the presser is pushed at the springs until it rests, and in between the
loads are mixed. So foam and flesh are MuJoCo's, and nothing slips, drags or swings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from skinmap.arrays import FloatArray
from skinmap.geometry.point_surface import PointSurface
from skinmap.geometry.triangles import unit
from skinmap.physics.bodies import PRESSERS, Presser
from skinmap.physics.pressing import STEP, mount_frame, press
from skinmap.physics.spring_bed import SpringBed
from skinmap.physics.variants import Variant
from skinmap.touch.simulation import moving_touches
from skinmap.touch.simulation.hands import Draw
from skinmap.touch.simulation.moving_touches import Laid, lay
from skinmap.touch.simulation.time_gestures import TIME_GESTURES, Timing
from skinmap.touch.simulation.variety import HABITS, Subject

# What each gesture is made with, one drawn; the second of a squeeze is its other side.
HANDS: dict[str, tuple[str, ...]] = {
    "stroke": ("poke", "three_finger", "full_finger"),
    "rub": ("poke", "three_finger", "full_finger"),
    "pat": ("whole_hand", "full_finger"),
    "tap": ("poke",),
    "slide": ("edge",),
    "twist": ("three_finger", "full_finger"),
    "squeeze": ("poke",),
    "hold": ("whole_hand", "full_finger", "three_finger", "poke"),
}
RISE, REST = 0.05, 0.07  # an arm pushes as hard as it will within the first, and rests [s]
TRIES = 20


@dataclass(frozen=True, eq=False, slots=True)
class Poses:
    """Contact forces (k,) [N] and their places (k, 3) [m] in the poses of a touch."""

    forces: FloatArray
    centres: FloatArray


def press_in_time(
    name: str,
    bed: SpringBed,
    feel: csr_array,
    foam: float,
    flesh: float,
    variant: Variant,
    subject: Subject,
    *,
    rate: float,
    rng: np.random.Generator,
) -> tuple[Laid, Poses] | None:
    """A touch in time at a place drawn at random, and its forces; None where it does not fit.

    `feel` (n, c) is the load of each taxel for a newton on each spring, the other settings are
    those of `skinmap.physics.simulation.Ground`.
    """
    surface = PointSurface(bed.skin.positions, bed.skin.normals, bed.spacing)
    ground = moving_touches.Ground(bed.skin, bed.graph, surface)
    timing = Timing(rate, rng, subject)
    for _ in range(TRIES):
        gesture = TIME_GESTURES[name](Draw(rng, 1.0, subject.hand), timing)
        kinds = HANDS[name]
        presser = PRESSERS[kinds[int(rng.integers(len(kinds)))]](rng, subject.hand, variant)
        first = 0.5 * np.pi + float(rng.uniform(-0.6, 0.6)) if name == "slide" else 0.0
        forces: list[float] = []
        centres: list[FloatArray] = []

        def push(
            spot: FloatArray,
            heading: FloatArray,
            angle: float,
            other: bool,
            presser: Presser = presser,
            turn: float = first,
            forces: list[float] = forces,
            centres: list[FloatArray] = centres,
        ) -> FloatArray:
            del other  # thumb and finger alike
            frames = _frames(surface, presser, spot, heading, angle + turn)
            made = press(
                bed, presser, frames, foam=foam, flesh=flesh, course=_push(len(frames)), step=STEP,
                friction=variant.friction,
            )  # fmt: skip
            forces.append(float(made.forces[-1]))
            centres.append(np.nan_to_num(made.centres[-1]))
            return np.asarray(feel[:, made.springs] @ made.loads[-1])

        laid = lay(ground, gesture, push, subject.hand, rng=rng)
        if laid is not None:
            if gesture.other:  # both sides of a grip are one pose
                forces, centres = [sum(forces[-2:])], [np.mean(centres[-2:], axis=0)]
            return laid, Poses(np.array(forces), np.array(centres))
    return None


def person(number: int, hand: float, pace: float, rng: np.random.Generator) -> Subject:
    """A person of MuJoCo's hands, with a rhythm."""
    return Subject(number, hand, 1.0, pace, int(rng.integers(HABITS)))


def _push(mounts: int) -> FloatArray:
    time = STEP * np.arange(round((RISE + REST) / STEP))
    return np.repeat(np.minimum(time / RISE, 1.0)[:, None], mounts, axis=1)


def _frames(
    surface: PointSurface, presser: Presser, spot: FloatArray, heading: FloatArray, angle: float
) -> FloatArray:
    """(m, 4, 4) where each mount pushes from: its spot in the plane, on the skin."""
    place, normal, _ = surface.project(spot)
    ahead = unit(heading - (heading @ normal) * normal)
    side = np.cross(normal, ahead)
    c, s = np.cos(angle), np.sin(angle)
    ahead, side = c * ahead + s * side, c * side - s * ahead
    middle = np.mean([mount.spot for mount in presser.mounts], axis=0)
    frames = []
    for mount in presser.mounts:
        x, y = np.array(mount.spot) - (middle if len(presser.mounts) > 1 else 0.0)
        at, up, _ = surface.project(place + x * ahead + y * side)
        frames.append(mount_frame(at, up, ahead))
    return np.array(frames)

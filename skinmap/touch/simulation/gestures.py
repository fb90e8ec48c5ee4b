"""The shapes of touches, in the plane of the skin around the place that is touched.

Sizes of hands are those of adults, with a spread: fingertips 12 to 18 mm wide, fingers 15 to 20 mm
(Dandekar, Raju and Srinivasan, J. Biomech. Eng. 125(5), 2003), palms 70 to 95 mm (Pheasant,
"Bodyspace", 1996), scaled by 0.75 to 1 for hands from child to adult. Sizes of elbows,
forearms and things are estimated; docs/simulator.md lists them all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skinmap.arrays import FloatArray

WRAPS = float("inf")  # the give of a hand: its joints let it follow any limb
Profile = Literal["round", "flat", "bone"]


@dataclass(frozen=True, slots=True)
class Pad:
    """A capsule pressed on the skin: all points within `radius` of a segment [m].

    Attributes
    ----------
    start, end : (2,) float
        Ends of the segment [m]; the same point for a disc.
    radius : float
        [m].
    strength : float
        Load on the axis at full press, 1 = a firm finger.
    profile : {"round", "flat", "bone"}
        How the load falls off from the axis to the rim: as under round flesh (Hertz), not at all
        as under an inflated ball or a straight edge, or steeply as under a bone in flesh.
    give : float
        How far the pad follows a skin that bends away from under it [m].
    """

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float
    strength: float
    profile: Profile = "round"
    give: float = WRAPS

    def depth(self, uv: FloatArray) -> FloatArray:
        """(n,) how far inside the pad points (n, 2) lie, 1 on the axis, negative outside."""
        a, b = np.array(self.start), np.array(self.end)
        axis = b - a
        length = float(axis @ axis)
        along = np.clip((uv - a) @ axis / length, 0.0, 1.0) if length > 0 else np.zeros(len(uv))
        distance = np.linalg.norm(uv - a - along[:, None] * axis, axis=1)
        return np.asarray(1.0 - distance / self.radius)


Gesture = Callable[[np.random.Generator, float], list[Pad]]


def poke(rng: np.random.Generator, hand: float) -> list[Pad]:
    """One fingertip, straight on."""
    return [Pad((0.0, 0.0), (0.0, 0.0), hand * rng.uniform(6e-3, 9e-3), rng.uniform(0.6, 1.6))]


def full_finger(rng: np.random.Generator, hand: float) -> list[Pad]:
    """One finger laid down along two or three phalanges."""
    half = hand * rng.uniform(22e-3, 36e-3)
    radius = hand * rng.uniform(7e-3, 9.5e-3)
    return [Pad((-half, 0.0), (half, 0.0), radius, rng.uniform(0.4, 1.1))]


def three_finger(rng: np.random.Generator, hand: float) -> list[Pad]:
    """Thumb against index and middle finger: three fingertips, apart."""
    opening = hand * rng.uniform(38e-3, 62e-3)
    between = hand * rng.uniform(19e-3, 25e-3)
    skew = rng.uniform(-8e-3, 8e-3)
    strength = rng.uniform(0.5, 1.3)
    tips = [(-opening / 2, skew), (opening / 2, -between / 2), (opening / 2, between / 2)]
    return [
        Pad(tip, tip, hand * rng.uniform(6e-3, 9e-3), strength * rng.uniform(0.75, 1.25))
        for tip in tips
    ]


def whole_hand(rng: np.random.Generator, hand: float) -> list[Pad]:
    """Palm and all five fingers round the body."""
    strength = rng.uniform(0.4, 1.1)
    width = hand * rng.uniform(70e-3, 85e-3)
    palm = Pad((0.0, -0.2 * width), (0.0, 0.2 * width), 0.38 * width, strength)
    pads = [palm]
    pitch = 0.25 * width
    for finger, reach in enumerate((0.85, 1.0, 0.95, 0.75)):
        y = (finger - 1.5) * pitch
        start = 0.42 * width
        end = start + hand * reach * rng.uniform(50e-3, 65e-3)
        bend = rng.uniform(-4e-3, 4e-3)
        push = strength * rng.uniform(0.6, 1.2)
        pads.append(Pad((start, y), (end, y + bend), hand * 7.5e-3, push))
    thumb_end = (0.1 * width, -0.5 * width - hand * rng.uniform(25e-3, 40e-3))
    pads.append(Pad((-0.2 * width, -0.4 * width), thumb_end, hand * 9e-3, strength))
    return pads


def elbow(rng: np.random.Generator, hand: float) -> list[Pad]:
    """The point of an elbow: a bone in flesh of 24 to 38 mm, a little oval."""
    radius = hand * rng.uniform(12e-3, 19e-3)
    half = hand * rng.uniform(1e-3, 5e-3)
    push = rng.uniform(0.9, 2.0)
    return [Pad((-half, 0.0), (half, 0.0), radius, push, "bone", 12e-3)]


def forearm(rng: np.random.Generator, hand: float) -> list[Pad]:
    """The fleshy side of a forearm laid on: 80 to 150 mm long, 36 to 52 mm broad."""
    radius = hand * rng.uniform(18e-3, 26e-3)
    half = hand * rng.uniform(80e-3, 150e-3) / 2.0
    push = rng.uniform(0.35, 0.9)
    return [Pad((-half, 0.0), (half, 0.0), radius, push, "round", 30e-3)]


def ball(rng: np.random.Generator, _: float) -> list[Pad]:
    """An inflated ball: a disc of 28 to 56 mm under the even pressure of its air."""
    push = rng.uniform(0.35, 0.9)
    return [Pad((0.0, 0.0), (0.0, 0.0), rng.uniform(14e-3, 28e-3), push, "flat", 20e-3)]


def edge(rng: np.random.Generator, _: float) -> list[Pad]:
    """The straight edge of a board or table: a line, 4 to 7 mm broad."""
    half = rng.uniform(50e-3, 120e-3) / 2.0
    push = rng.uniform(0.5, 1.3)
    return [Pad((-half, 0.0), (half, 0.0), rng.uniform(2e-3, 3.5e-3), push, "flat", 10e-3)]


def cylinder(rng: np.random.Generator, _: float) -> list[Pad]:
    """A bottle or a pole lying on the skin: a strip of 20 to 32 mm, evenly loaded along it."""
    half = rng.uniform(60e-3, 140e-3) / 2.0
    push = rng.uniform(0.4, 1.0)
    return [Pad((-half, 0.0), (half, 0.0), rng.uniform(10e-3, 16e-3), push, "round", 10e-3)]


GESTURES: dict[str, Gesture] = {
    made.__name__: made
    for made in (poke, full_finger, three_finger, whole_hand, elbow, forearm, ball, edge, cylinder)
}
FOUR = tuple(GESTURES)[:4]  # the touches of the first paper
EIGHT = tuple(GESTURES)[:8]  # those of both papers
# Touches in time, see `moving_touches`.
TIME = ("stroke", "pat", "tap", "rub", "slide", "twist", "squeeze", "hold")
# The least share of a touch that must lie over taxels: a hand is put where the robot has skin,
# long things stick out beyond it.
ON_SKIN = 0.7
LONG_ON_SKIN = dict.fromkeys(
    ("forearm", "edge", "cylinder", "rod", "table_edge", "plate", "link", "shoulder"), 0.45
)

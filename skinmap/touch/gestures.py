"""The shapes of four touches, in the plane of the skin around the place that is touched.

Sizes are those of adult hands, with a spread: fingertips 12 to 18 mm wide, fingers 15 to 20 mm
(Dandekar, Raju and Srinivasan, J. Biomech. Eng. 125(5), 2003), palms 70 to 95 mm (Pheasant,
"Bodyspace", 1996), scaled by 0.75 to 1 for hands from child to adult.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Pad:
    """A capsule of flesh pressed flat on the skin: all points within `radius` of a segment [m]."""

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float
    strength: float

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


GESTURES: dict[str, Gesture] = {
    "poke": poke,
    "full_finger": full_finger,
    "three_finger": three_finger,
    "whole_hand": whole_hand,
}

"""Who touches: subjects with a hand size and habits, and the places that they touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

HAND = (0.75, 1.0)  # sizes of hands, 1 = adult
# Of small children to large men: 120 to 210 mm from wrist to fingertip, where an adult has 185
# (Pheasant, "Bodyspace", 1996).
ALL_HANDS = (0.65, 1.13)
HABITS = 3  # habitual places of a gesture on a part
HABIT_SHIFT = 8e-3  # how near a subject comes to them, standard deviation [m]
HABIT_TURN = 0.25  # and with the angle of the hand [rad]
Places = Literal["anywhere", "habitual", "grips"]  # grips: these alone at habitual places
GRIPS = ("three_finger", "whole_hand")


@dataclass(frozen=True, slots=True)
class Subject:
    """A simulated person who touches.

    Attributes
    ----------
    number : int
        0 first.
    hand : float
        Size of the hand, 1 = adult.
    force : float
        How firmly, 1 = as most.
    pace : float
        How slowly, 1 = as most.
    habit : int
        Which habitual place, 0..HABITS-1.
    left : bool
        Whether a left hand touches: the mirror image of a right one.
    """

    number: int
    hand: float
    force: float
    pace: float
    habit: int
    left: bool = False


def draw_subjects(
    count: int, *, rng: np.random.Generator, further: float = 0.0
) -> tuple[Subject, ...]:
    """Subjects with hands from child to adult, and `further` people from 0 to 1 beside these."""
    low, high = HAND
    low, high = low - further * (low - ALL_HANDS[0]), high + further * (ALL_HANDS[1] - high)
    return tuple(
        Subject(
            number,
            float(rng.uniform(low, high)),
            float(np.exp(rng.normal(-0.2 * further, 0.15 + 0.35 * further))),
            float(np.exp(rng.normal(-0.3 * further, 0.2 + 0.2 * further))),
            int(rng.integers(HABITS)),
        )
        for number in range(count)
    )


@dataclass(frozen=True, slots=True)
class Habit:
    """A place on a part that a gesture is often made at: a taxel and an angle [rad]."""

    taxel: int
    angle: float

"""Who touches: subjects with a hand size and habits, and the places that they touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

HAND = (0.75, 1.0)  # sizes of hands, 1 = adult
HABITS = 3  # habitual places of a gesture on a part
HABIT_SHIFT = 8e-3  # how near a subject comes to them, standard deviation [m]
HABIT_TURN = 0.25  # and with the angle of the hand [rad]
Places = Literal["anywhere", "habitual"]


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
    """

    number: int
    hand: float
    force: float
    pace: float
    habit: int


def draw_subjects(count: int, *, rng: np.random.Generator) -> tuple[Subject, ...]:
    """Subjects with hands from child to adult."""
    return tuple(
        Subject(
            number,
            float(rng.uniform(*HAND)),
            float(np.exp(rng.normal(0.0, 0.15))),
            float(np.exp(rng.normal(0.0, 0.2))),
            int(rng.integers(HABITS)),
        )
        for number in range(count)
    )


@dataclass(frozen=True, slots=True)
class Habit:
    """A place on a part that a gesture is often made at: a taxel and an angle [rad]."""

    taxel: int
    angle: float

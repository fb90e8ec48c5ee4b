"""How far simulated touches are drawn at random: none, some, wide, wider, or a number from 0 to 2.

At 0 touches are the fixed pads of `gestures` on the sensors of `Sensing()`. Above, most touches
are bodies with a force (`hands`) on an elastic bed (`elastic_bed`), a few remain pads, and each
skin has faults. All ranges grow with the number. Above 1 come rarer people and skins: hands from a
child's to large ones, light and quick touches, touches half on the rim, stiff thin and soft thick
foam, and more cross-talk. docs/simulator.md has the sources.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.touch.simulation.elastic_bed import Foam
from skinmap.touch.simulation.sensing import Sensing

LEVELS = {"none": 0.0, "some": 0.5, "wide": 1.0, "wider": 2.0}
DEFAULT = 1.0  # what most people and skins are like
MOST = 2.0
PADS = 0.4  # share of touches that remain fixed pads at full variety
STIFFNESS = (1e7, 1.5e8)  # of a foam of 2 mm with a modulus of 20 to 300 kPa [N/m3]
SPREAD = (1.4e-3, 2.6e-3)  # of a pressure by the foam of a skin, 1 to 3 mm thick [m]
UNEVEN = 0.15  # by which it differs from place to place, as a logarithm
FURTHER = 1.5  # the logarithm of foam's stiffness and spread reach so much further at 2
CROSS_TALK = 0.08  # more at most within a module, at 2
LEANS, ROLLS = 0.35, 0.4  # share of touches that come in obliquely at 2, and that roll while held
COMPRESSION = 0.6  # of high readings at most, at 2
AT_RIM, LESS_ON_SKIN = 0.35, 0.3  # share of touches that lie over a rim at 2, and by how much


def variety_of(text: str) -> float:
    """The number that a word or a figure stands for.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        Neither a level nor a number; a number outside 0 to 2.
    """
    if text in LEVELS:
        return LEVELS[text]
    try:
        number = float(text)
    except ValueError:
        raise UnknownNameError("variety level", text, [*LEVELS, "a number from 0 to 2"]) from None
    return check_variety(number)


def check_variety(variety: float) -> float:
    """The variety, if it lies in 0 to 2."""
    if not 0.0 <= variety <= MOST:  # false for NaN
        raise InvalidArrayError(f"variety must lie in 0..2, got {variety:g}")
    return float(variety)


def beyond(variety: float) -> float:
    """How far a variety is above 1, from 0 to 1."""
    return max(0.0, variety - 1.0)


def on_skin_of(variety: float, enough: float, rng: np.random.Generator) -> float:
    """The least share of a touch over taxels; now and then less above 1, where none else is drawn.

    Half of a touch at the rim of a patch is on nothing.
    """
    return enough - LESS_ON_SKIN * happens(AT_RIM, variety, rng)


def happens(share: float, variety: float, rng: np.random.Generator) -> bool:
    """Whether something rare happens to a touch, in a share of them at 2; nothing is drawn to 1."""
    return beyond(variety) > 0 and bool(rng.random() < share * beyond(variety))


def uses_pads(variety: float, rng: np.random.Generator) -> bool:
    """Whether the next touch is one of fixed pads; nothing is drawn at 0."""
    return variety == 0.0 or bool(rng.random() < 1.0 - (1.0 - PADS) * min(1.0, 2.0 * variety))


def draw_foam(variety: float, spread: float, rng: np.random.Generator) -> Foam:
    """The foam under one touch, of a skin with a known spread [m].

    Its stiffness is drawn for each touch: a training set has too few skins.
    """
    low, high = np.log(STIFFNESS)
    most, further = min(variety, 1.0), 1.0 + (FURTHER - 1.0) * beyond(variety)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) * most * further
    stiffness = np.exp(rng.uniform(middle - half, middle + half))
    return Foam(float(stiffness), float(spread * np.exp(UNEVEN * most * rng.uniform(-1, 1))))


def draw_sensing(variety: float, *, rng: np.random.Generator, rate: float = 50.0) -> Sensing:
    """How the taxels of one skin answer; `Sensing()` at 0, where nothing is drawn.

    Samples are never lost unless asked for: all parts of a robot are sampled together.
    docs/simulator.md has the sources of the ranges.
    """
    clean = Sensing(rate=rate)
    if variety == 0.0:
        return clean
    more, variety = beyond(variety), min(variety, 1.0)
    middle, half = 0.5 * sum(SPREAD), 0.5 * (SPREAD[1] - SPREAD[0]) * variety
    half *= 1.0 + (FURTHER - 1.0) * more
    return replace(
        clean,
        foam=float(rng.uniform(middle - half, middle + half)),
        gain_law="lognormal",
        gain_spread=float(rng.uniform(0.1, 0.1 + 0.3 * variety)),
        sensitivity=float(np.exp(rng.uniform(-0.4, 0.4) * variety)),
        noise=float(rng.uniform(1.0, 1.0 + 0.8 * variety)),
        dead=float(rng.uniform(0.0, 0.02 * variety)),
        unplaced=float(rng.uniform(0.0, 0.02 * variety)),
        stuck=float(rng.uniform(0.0, 0.01 * variety)),
        spikes=float(rng.uniform(0.0, 4e-4 * variety)),
        hysteresis=float(rng.uniform(0.0, 0.2 * variety)),
        creep=float(rng.uniform(0.0, 0.15 * variety)),
        cross_talk=float(rng.uniform(0.0, 0.04 * variety + CROSS_TALK * more)),
        compression=float(rng.uniform(0.0, COMPRESSION * more)) if more > 0 else 0.0,
    )


# Who touches: subjects with a hand size and habits, and the places that they touch.

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

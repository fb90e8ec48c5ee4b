"""How far simulated touches are drawn at random: none, some, wide, or a number from 0 to 1.

At 0 touches are the fixed pads of `gestures` on the sensors of `Sensing()`. Above, most touches
are bodies with a force (`hands`) on an elastic bed (`elastic_bed`), a few remain pads, and each
skin has faults. All ranges grow with the number.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.touch.simulation.elastic_bed import Foam
from skinmap.touch.simulation.sensing import Sensing

LEVELS = {"none": 0.0, "some": 0.5, "wide": 1.0}
DEFAULT = 1.0  # what carries over best to skins and physics that were not trained on
PADS = 0.4  # share of touches that remain fixed pads at full variety
STIFFNESS = (1e7, 1.5e8)  # of a foam of 2 mm with a modulus of 20 to 300 kPa [N/m3]
SPREAD = (1.4e-3, 2.6e-3)  # of a pressure by the foam of a skin, 1 to 3 mm thick [m]
UNEVEN = 0.15  # by which it differs from place to place, as a logarithm


def variety_of(text: str) -> float:
    """The number that a word or a figure stands for.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        Neither a level nor a number; a number outside 0 to 1.
    """
    if text in LEVELS:
        return LEVELS[text]
    try:
        number = float(text)
    except ValueError:
        raise UnknownNameError("variety level", text, [*LEVELS, "a number from 0 to 1"]) from None
    return check_variety(number)


def check_variety(variety: float) -> float:
    """The variety, if it lies in 0 to 1."""
    if not 0.0 <= variety <= 1.0:  # false for NaN
        raise InvalidArrayError(f"variety must lie in 0..1, got {variety:g}")
    return float(variety)


def uses_pads(variety: float, rng: np.random.Generator) -> bool:
    """Whether the next touch is one of fixed pads; nothing is drawn at 0."""
    return variety == 0.0 or bool(rng.random() < 1.0 - (1.0 - PADS) * min(1.0, 2.0 * variety))


def draw_foam(variety: float, spread: float, rng: np.random.Generator) -> Foam:
    """The foam under one touch, of a skin with a known spread [m].

    Its stiffness is drawn for each touch: a training set has too few skins.
    """
    low, high = np.log(STIFFNESS)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) * variety
    stiffness = np.exp(rng.uniform(middle - half, middle + half))
    return Foam(float(stiffness), float(spread * np.exp(UNEVEN * variety * rng.uniform(-1, 1))))


def draw_sensing(variety: float, *, rng: np.random.Generator, rate: float = 50.0) -> Sensing:
    """How the taxels of one skin answer; `Sensing()` at 0, where nothing is drawn.

    Samples are never lost unless asked for: all parts of a robot are sampled together.
    docs/simulator.md has the sources of the ranges.
    """
    clean = Sensing(rate=rate)
    if variety == 0.0:
        return clean
    middle, half = 0.5 * sum(SPREAD), 0.5 * (SPREAD[1] - SPREAD[0]) * variety
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
        cross_talk=float(rng.uniform(0.0, 0.04 * variety)),
    )

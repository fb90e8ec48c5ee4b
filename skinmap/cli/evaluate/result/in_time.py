"""The protocol `time`: touches in time, and how their motion is estimated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from skinmap.cli.evaluate.result.shared import SimulatedGestures


@dataclass(frozen=True, kw_only=True, slots=True)
class SeenRow:
    """A classifier of touches in time, trained on other parts and other people.

    Attributes
    ----------
    features
        What it looks at: contact geometry alone, and motion.
    tested_on
        Ours, or a variant of MuJoCo.
    seen
        Share of each touch that it was shown.
    mean, per_class
        Share named right: mean of the gestures, and each.
    confusion
        Touches of each gesture by the name they were given.
    """

    features: str
    tested_on: str
    seen: float
    mean: float
    per_class: dict[str, float]
    confusion: dict[str, dict[str, int]]


@dataclass(frozen=True, kw_only=True, slots=True)
class StrokesRow:
    """How wrong the motion of strokes of 5 cm or more is, in the median.

    Attributes
    ----------
    physics
        Ours, or a variant of MuJoCo.
    strokes
        How many.
    speed
        Error of the speed as a share of it; this and the others are null without strokes.
    speed_bias
        The same with its sign, or null.
    direction_deg
        Angle between velocities and true ones, or null.
    length
        Error of the length of the way, as a share of it, or null.
    within
        Share of the velocities that are wrong by no more than twice their stated error, or null.
    """

    physics: str
    strokes: int
    speed: float | None
    speed_bias: float | None
    direction_deg: float | None
    length: float | None
    within: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeResult(SimulatedGestures):
    """The protocol `time`.

    Attributes
    ----------
    parts
        What was measured, and where; mirror images are left out.
    per_gesture
        Touches of each on each part; of MuJoCo's a quarter.
    rows
        By features, physics and share seen.
    strokes
        Direction and speed, by physics.
    presses_right
        Share of taps and pats whose presses were counted right, by physics; null without any.
    still_alone, still_together
        Share of the four still gestures named right by a classifier of these alone, and of all.
    gained_points
        By motion, of whole touches.
    half_seen
        Accuracy on half of a touch, as a share of that on all of it.
    skipped
        What was left out, and why.
    """

    protocol: Literal["time"] = "time"
    parts: list[str]
    rows: list[SeenRow]
    strokes: list[StrokesRow]
    presses_right: dict[str, float | None]
    still_alone: float
    still_together: float
    gained_points: float
    half_seen: float
    skipped: dict[str, str]

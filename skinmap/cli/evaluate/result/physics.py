"""The protocol `physics`: classifiers trained on one physics and tested on another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from skinmap.cli.evaluate.result.shared import SimulatedGestures


@dataclass(frozen=True, kw_only=True, slots=True)
class PhysicsRow:
    """A classifier trained on one physics and tested on one, on other parts.

    Attributes
    ----------
    trained_on, tested_on
        Ours, a variant of MuJoCo, or all of both but what is tested on.
    mean, per_class
        Share named right: mean of the gestures, and each.
    ece
        Expected calibration error of the confidences.
    held, set_size
        Share of the touches whose set of names, promised for 0.9 of them, holds the true one, and
        names in a set; null for classifiers without sets.
    confusion
        Touches of each gesture by the name they were given.
    """

    trained_on: str
    tested_on: str
    mean: float
    per_class: dict[str, float]
    ece: float
    held: float | None
    set_size: float | None
    confusion: dict[str, dict[str, int]]


@dataclass(frozen=True, kw_only=True, slots=True)
class PhysicsResult(SimulatedGestures):
    """The protocol `physics`.

    Attributes
    ----------
    parts
        What was measured, and where; mirror images are left out.
    classifier
        What names.
    frozen
        The variant that nothing is trained or tuned on.
    rows
        By training and test.
    """

    protocol: Literal["physics"] = "physics"
    parts: list[str]
    classifier: str
    frozen: str
    rows: list[PhysicsRow]

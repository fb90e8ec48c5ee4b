"""What the results of all protocols of `skinmap evaluate` have in common."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from msgspec import UNSET, UnsetType

Kind = Literal["plain", "event"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Evaluated:
    """What one protocol measured.

    Attributes
    ----------
    protocol, robot
        What was measured, and where.
    files
        Names inside `--out`.
    """

    protocol: str
    robot: str
    files: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True, slots=True)
class Simulated(Evaluated):
    """On simulated touches.

    Attributes
    ----------
    accuracy_is
        Where the touches come from.
    seeds
        Of the repetitions.
    """

    accuracy_is: Literal["simulated"] = "simulated"
    seeds: list[int]


@dataclass(frozen=True, kw_only=True, slots=True)
class SimulatedGestures(Simulated):
    """On so many simulated touches of each gesture.

    Attributes
    ----------
    gestures, per_gesture
        To tell apart, and touches of each on each part or patch, in each physics.
    """

    gestures: list[str]
    per_gesture: int


@dataclass(frozen=True, kw_only=True, slots=True)
class RealSkin(Evaluated):
    """On samples of a real skin.

    Attributes
    ----------
    taxels
        Of the skin.
    archive, patch
        Files of the samples and of the skin.
    accuracy_is
        Where the touches come from.
    unplaced, unrecorded
        Channels without a place, and taxels without a channel.
    """

    taxels: int
    archive: str
    patch: str
    accuracy_is: Literal["real"] = "real"
    unplaced: int
    unrecorded: int


@dataclass(frozen=True, kw_only=True, slots=True)
class AccuracyRow:
    """One classifier under one kind of cross-validation.

    Attributes
    ----------
    percent
        kaspar: share of the samples that was drawn.
    folds
        Plain as published, or by touch event, so that no event is in both halves.
    features, classifier
        What it reads, and what decides.
    per_class
        Share named right, by label.
    mean
        Of the classes.
    std
        Of the mean over the seeds; not of published figures.
    samples, touches
        That were tested: samples (kaspar), touch events (recordings).
    """

    percent: int | UnsetType = UNSET
    folds: Kind
    features: str
    classifier: str
    per_class: dict[str, float]
    mean: float
    std: float | UnsetType = UNSET
    samples: int | UnsetType = UNSET
    touches: int | UnsetType = UNSET

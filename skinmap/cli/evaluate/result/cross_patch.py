"""The protocol `cross-patch`: classifiers on patches that they were not trained on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from skinmap.cli.evaluate.result.shared import SimulatedGestures


@dataclass(frozen=True, kw_only=True, slots=True)
class PatchesRow:
    """One classifier on patches that it was not trained on.

    Attributes
    ----------
    features, classifier
        What it reads, and what decides.
    mean, std
        Share named right, and its spread over the seeds.
    worst, worst_patch
        On the patch that it does worst on.
    per_patch, per_class
        By patch, and by gesture.
    unknown
        Share that the classifier would leave unnamed.
    touches
        That were tested.
    """

    features: str
    classifier: str
    mean: float
    std: float
    worst: float
    worst_patch: str
    per_patch: dict[str, float]
    per_class: dict[str, float]
    unknown: float
    touches: int


@dataclass(frozen=True, kw_only=True, slots=True)
class CrossPatchResult(SimulatedGestures):
    """The protocol `cross-patch`.

    Attributes
    ----------
    train_robot
        Robot trained on; null: all other patches of the same.
    patches
        Taxels by patch.
    rows
        By classifier.
    """

    protocol: Literal["cross-patch"] = "cross-patch"
    train_robot: str | None
    patches: dict[str, int]
    rows: list[PatchesRow]

"""The protocol `kaspar`: features and classifiers on the hand, patches, radius and codewords."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from skinmap.cli.evaluate.result.shared import AccuracyRow, Simulated


@dataclass(frozen=True, kw_only=True, slots=True)
class CarrySummary:
    """How well some features carry over between patches.

    Attributes
    ----------
    features
        What is read.
    same, other
        Accuracy on the patch trained on and on the others; null where there is none.
    difference
        Other less same; null without others.
    worst
        Accuracy of the worst pair of patches; null without others.
    worst_pair
        Trained on and tested on; empty without others.
    """

    features: str
    same: float | None
    other: float | None
    difference: float | None
    worst: float | None
    worst_pair: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class CarryRow:
    """One pair of patches.

    Attributes
    ----------
    features
        What is read.
    trained_on, tested_on
        The patches.
    taxels
        Of both.
    accuracy
        Share named right, by event.
    """

    features: str
    trained_on: str
    tested_on: str
    taxels: list[int]
    accuracy: float


@dataclass(frozen=True, kw_only=True, slots=True)
class CarryOver:
    """Training on one patch, testing on another with other numbers of taxels.

    Attributes
    ----------
    percent
        Share of the samples that was drawn.
    summary
        By features.
    rows
        Pair by pair.
    left_out
        Parts on which not every touch can be simulated.
    """

    percent: int
    summary: list[CarrySummary]
    rows: list[CarryRow]
    left_out: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class SweepRow:
    """Histograms with one radius and number of codewords.

    Attributes
    ----------
    radius_mm, words
        Of a neighbourhood, and codewords of a structure.
    structures, neighbours, bins
        How many there are, of most taxels, and of the histogram.
    mean, std
        Mean of the classes, and its spread over the seeds.
    """

    radius_mm: float
    words: int
    structures: int
    neighbours: int
    bins: int
    mean: float
    std: float


@dataclass(frozen=True, kw_only=True, slots=True)
class KasparResult(Simulated):
    """The protocol `kaspar`.

    Attributes
    ----------
    part, taxels
        What was measured, and where.
    places
        Where people touch.
    samples
        Of each gesture.
    table
        Features and classifiers.
    paper
        The published figures.
    carry_over
        Between patches.
    sweep
        Of radius and codewords; empty without `--sweep` or `--out`.
    """

    protocol: Literal["kaspar"] = "kaspar"
    part: str
    taxels: int
    places: str
    samples: dict[str, int]
    table: list[AccuracyRow]
    paper: list[AccuracyRow]
    carry_over: CarryOver
    sweep: list[SweepRow]

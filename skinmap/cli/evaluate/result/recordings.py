"""Recordings, cross-validated: by event, and by groups that are left out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from skinmap.cli.evaluate.result.shared import AccuracyRow, Evaluated


@dataclass(frozen=True, kw_only=True, slots=True)
class LeakRow:
    """How much plain folds flatter a classifier.

    Attributes
    ----------
    classifier, points
        Its name, and percentage points.
    """

    classifier: str
    points: float


@dataclass(frozen=True, kw_only=True, slots=True)
class LeftOutRow:
    """One classifier, judged on groups of touches that it did not learn from.

    Attributes
    ----------
    classifier
        Its name.
    left_out
        event: touches dealt out whatever group they are of; else session, person, place or part.
    groups
        How many groups there are.
    per_class
        Share named right, by label.
    mean
        Of the classes; null where nothing could be left out.
    right
        Share of all touches named right; null likewise.
    chance
        Share of the most frequent label.
    control, first
        Share named right by the same classifier of what the skin read before the touches, and of
        the first samples; null where it sees nothing there, or nothing was asked.
    raw
        Of what the skin read before the touches, by a linear classifier of raw values; null where
        there is none, or nothing was asked.
    meaning
        Whether the figure says something of touches; null where no control was asked for.
    verdict
        The same in one line; or why there is no figure.
    """

    classifier: str
    left_out: str
    groups: int
    per_class: dict[str, float]
    mean: float | None
    right: float | None
    chance: float
    control: float | None
    first: float | None
    raw: float | None
    meaning: Literal["yes", "no", "doubtful"] | None
    verdict: str


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordingsResult(Evaluated):
    """Recordings, cross-validated.

    Attributes
    ----------
    parts
        What was measured, and where.
    recordings
        The files.
    folds, seeds
        Of the cross-validation.
    touches
        Events by label.
    table
        By classifier and kind of folds.
    leak
        By classifier.
    left_out
        With --leave-out or --leaks: what is left of the figures.
    sessions, people
        Touches of each; people who are not named are left out.
    warnings
        What classifiers may have learnt instead of the touches.
    skipped
        Classifiers that were left out, and why.
    """

    protocol: Literal["recordings"] = "recordings"
    parts: list[str]
    recordings: list[str]
    folds: int
    seeds: list[int]
    touches: dict[str, int]
    table: list[AccuracyRow]
    leak: list[LeakRow]
    left_out: list[LeftOutRow] = field(default_factory=list)
    sessions: dict[str, int]
    people: dict[str, int]
    warnings: list[str]
    skipped: dict[str, str]

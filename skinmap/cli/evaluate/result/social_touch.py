"""The protocol `cost`: the Corpus of Social Touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from skinmap.cli.evaluate.result.shared import Evaluated


@dataclass(frozen=True, kw_only=True, slots=True)
class CostRow:
    """One variant of the Corpus of Social Touch under one split.

    Attributes
    ----------
    variant
        gentle, normal, rough, or all.
    left_out
        Whole subjects, or captures dealt out.
    captures
        That were judged.
    right
        Share named right; null where the split cannot be made.
    first
        The same classifier on the first three samples of each capture; null likewise.
    chance
        Share of the most frequent gesture.
    reason
        Why there is no figure.
    """

    variant: str
    left_out: Literal["subject", "capture"]
    captures: int
    right: float | None
    first: float | None
    chance: float
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class CostResult(Evaluated):
    """The protocol `cost`.

    Attributes
    ----------
    file
        What was measured.
    classifier
        What names.
    captures, subjects, gestures
        Of the file.
    seed
        Of all randomness.
    rows
        By variant and split.
    published
        What others reached, subjects left out.
    """

    protocol: Literal["cost"] = "cost"
    file: str
    classifier: str
    captures: int
    subjects: int
    gestures: list[str]
    seed: int
    rows: list[CostRow]
    published: dict[str, float]

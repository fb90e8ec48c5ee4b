"""The protocol `baxter`: contact images and the methods that read them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from msgspec import UNSET, UnsetType

from skinmap.cli.evaluate.result.shared import Evaluated


@dataclass(frozen=True, kw_only=True, slots=True)
class SplitSpread:
    """Mean of the diagonal of the confusion matrix over the splits.

    Attributes
    ----------
    mean, min, max
        0 to 1.
    """

    mean: float
    min: float
    max: float


@dataclass(frozen=True, kw_only=True, slots=True)
class MethodResult:
    """One method of the protocol `baxter`.

    Attributes
    ----------
    missing
        Which library is not installed; then there is nothing else.
    mean, min, max
        Mean of the diagonal over the splits, by touch.
    plain
        The same for splits as published.
    tuning
        What was tried: settings and their mean.
    k
        bovw: codewords.
    network, learning_rate, epochs
        cnn: its size and training.
    C, gamma
        raw_rbf: penalty and width.
    """

    missing: str | UnsetType = UNSET
    mean: float | UnsetType = UNSET
    min: float | UnsetType = UNSET
    max: float | UnsetType = UNSET
    plain: SplitSpread | UnsetType = UNSET
    tuning: list[dict[str, Any]] | UnsetType = UNSET
    k: int | UnsetType = UNSET
    network: str | UnsetType = UNSET
    learning_rate: float | UnsetType = UNSET
    epochs: int | UnsetType = UNSET
    C: float | UnsetType = UNSET
    gamma: float | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True, slots=True)
class Confusion:
    """Mean confusion matrices: rows are what a touch was, columns what it was named.

    Attributes
    ----------
    labels
        Of rows and columns.
    bovw, cnn, raw_rbf
        Of each method that ran.
    """

    labels: list[str]
    bovw: list[list[float]] | UnsetType = UNSET
    cnn: list[list[float]] | UnsetType = UNSET
    raw_rbf: list[list[float]] | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True, slots=True)
class BaxterResult(Evaluated):
    """The protocol `baxter`.

    Attributes
    ----------
    part, taxels
        What was measured, and where.
    accuracy_is, simulated
        Where the touches come from.
    bovw, cnn, raw_rbf
        Bags of visual words, a network, raw values; those that were asked for.
    confusion
        By method.
    images, touches, repeats
        How many; a repeat is a split into 70 and 30 %.
    seed
        Of all randomness.
    network
        The paper's size, or a smaller one.
    paper
        The published figures, by method.
    """

    protocol: Literal["baxter"] = "baxter"
    part: str
    taxels: int
    accuracy_is: Literal["simulated"] = "simulated"
    bovw: MethodResult | UnsetType = UNSET
    cnn: MethodResult | UnsetType = UNSET
    raw_rbf: MethodResult | UnsetType = UNSET
    confusion: Confusion
    images: int
    touches: int
    repeats: int
    seed: int
    network: str
    paper: dict[str, dict[str, float]]
    simulated: Literal[True] = True

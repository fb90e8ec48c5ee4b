"""Folds of labelled samples, plain or with all samples of one touch on the same side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import IntArray
from skinmap.errors import InvalidArrayError

FoldKind = Literal["plain", "event"]
Fold = tuple[IntArray, IntArray]
Names = NDArray[np.str_]


def make_folds(
    kind: FoldKind, labels: Names, events: IntArray, *, folds: int, rng: np.random.Generator
) -> list[Fold]:
    """Rows to train on and rows to test on, each row tested once, labels in equal shares.

    Parameters
    ----------
    kind : {"plain", "event"}
        Whether samples (n,) of one event may fall on both sides ("plain", as published) or not.
    labels : (n,) array of str
    events : (n,) array of int
    folds : int
    rng : numpy.random.Generator

    Raises
    ------
    InvalidArrayError
        A label with fewer samples (plain) or events (event) than there are folds, or one label.
    """
    from sklearn.model_selection import StratifiedGroupKFold, StratifiedKFold

    counts = smallest(kind, labels, events)
    few = {label: count for label, count in counts.items() if count < folds}
    if few or len(counts) < 2:
        what = "touch events" if kind == "event" else "samples"
        have = ", ".join(f"{count} {label}" for label, count in counts.items()) or "none"
        raise InvalidArrayError(
            f"{folds} folds need two labels with at least {folds} {what} each, got: {have}"
        )
    seed = int(rng.integers(2**31))
    rows = np.zeros(len(labels))
    if kind == "event":
        together = StratifiedGroupKFold(folds, shuffle=True, random_state=seed)
        return list(together.split(rows, labels, events))
    return list(StratifiedKFold(folds, shuffle=True, random_state=seed).split(rows, labels))


def smallest(kind: FoldKind, labels: Names, events: IntArray) -> dict[str, int]:
    """How many samples (plain) or events (event) each label has."""
    return {
        str(label): int(
            len(np.unique(events[labels == label]))
            if kind == "event"
            else np.count_nonzero(labels == label)
        )
        for label in np.unique(labels)
    }


def recalls(labels: Names, named: Names, kinds: Sequence[str]) -> dict[str, float]:
    """Share of the samples of each label that were named right; NaN for a label without any."""
    return {
        kind: float(np.mean(named[labels == kind] == kind)) if (labels == kind).any() else np.nan
        for kind in kinds
    }

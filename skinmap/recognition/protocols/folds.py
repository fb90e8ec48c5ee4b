"""Folds of labelled samples, plain or with all samples of one touch on one side; repetitions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import IntArray
from skinmap.errors import InvalidArrayError
from skinmap.parallel.run import Progress, run_tasks
from skinmap.parallel.workers import ONE, Workers
from skinmap.recognition.protocols.results import AccuracyRow

FoldKind = Literal["plain", "event"]
Fold = tuple[IntArray, IntArray]
Names = NDArray[np.str_]
R = TypeVar("R")


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
        Touch that each sample is of.
    folds : int
        How many, 2 or more.
    rng : numpy.random.Generator
        Deals them out.

    Returns
    -------
    list of (train, test)
        Row numbers of each fold.

    Raises
    ------
    InvalidArrayError
        A label with fewer samples (plain) or events (event) than there are folds, or one label.

    Examples
    --------
    >>> labels, events = np.array(["poke", "rub"]).repeat(4), np.arange(8) // 2
    >>> folds = make_folds("event", labels, events, folds=2, rng=np.random.default_rng(0))
    >>> [sorted(set(events[test].tolist())) for _, test in folds]
    [[1, 2], [0, 3]]
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
    units = events if kind == "event" else np.arange(len(labels))
    return {str(label): len(np.unique(units[labels == label])) for label in np.unique(labels)}


def recalls(labels: Names, named: Names, kinds: Sequence[str]) -> dict[str, float]:
    """Share of the samples of each label that were named right; NaN for a label without any."""
    return {
        kind: float(np.mean(named[labels == kind] == kind)) if (labels == kind).any() else np.nan
        for kind in kinds
    }


def shares(labels: Names, named: Names, kinds: Sequence[str]) -> dict[str, Any]:
    """Fields of a row: `recalls` as `per_class`, and their `mean`."""
    found = recalls(labels, named, kinds)
    return {"per_class": found, "mean": float(np.mean(list(found.values())))}


def mean_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """Mean over repetitions, and its standard deviation; 0 for one."""
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


def averaged(rows: Sequence[AccuracyRow]) -> AccuracyRow:
    """One row for those of several repetitions."""
    mean, std = mean_and_spread([row.mean for row in rows])
    kinds = rows[0].per_class
    per_class = {kind: float(np.mean([row.per_class[kind] for row in rows])) for kind in kinds}
    return replace(rows[0], per_class=per_class, mean=mean, std=std)


def run_repeats(
    work: Callable[..., R],
    varied: Iterable[Mapping[str, Any]],
    *,
    workers: Workers = ONE,
    progress: Progress | None = None,
    **shared: Any,
) -> list[R]:
    """What `work` gives for each repetition, in their order.

    Parameters
    ----------
    work : callable
        A function of a module, called by keywords.
    varied : iterable of mapping
        What differs between the repetitions: `{"seed": 1}`.
    workers : Workers
    progress : callable, optional
        Called after each.
    shared
        What is the same for all.
    """
    repeats = [(work, {**shared, **one}) for one in varied]
    return run_tasks(_run, repeats, workers=workers, progress=progress)


def _run(repeat: tuple[Callable[..., R], Mapping[str, Any]]) -> R:
    work, arguments = repeat
    return work(**arguments)

"""Transfer: trained on all patches of a robot but one, tested on that one; or on another robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator

from skinmap.classify.classifier import TouchClassifier, classifiers
from skinmap.classify.descriptors import Histograms, Touch
from skinmap.classify.evaluate import score
from skinmap.classify.protocols.patches import Patch
from skinmap.errors import InvalidArrayError
from skinmap.parallel.run import run_tasks, task_rng
from skinmap.parallel.workers import ONE, Workers

DEFAULTS = ("contact-geometry", "histogram", "histogram:nearest", "paper")
NEAREST = ":nearest"


@dataclass(frozen=True, eq=False, slots=True)
class Trial:
    """One training: what a worker needs.

    Attributes
    ----------
    classifier : str
    train, test : sequence of Patch
        With touches.
    seed : int
    """

    classifier: str
    train: tuple[Patch, ...]
    test: tuple[Patch, ...]
    seed: int


def leave_one_out(
    patches: Sequence[Patch],
    *,
    names: Sequence[str] = DEFAULTS,
    seed: int,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[dict[str, dict[str, Any]]]:
    """Scores of each classifier on each patch, trained on all others.

    Returns
    -------
    list of dict
        For each of `names`: patch -> {accuracy, touches, per_label}.
    """
    if len(patches) < 2:
        raise InvalidArrayError(f"leaving one patch out needs two patches, got {len(patches)}")
    trials = [
        Trial(name, (*patches[:k], *patches[k + 1 :]), (patch,), seed)
        for name in names
        for k, patch in enumerate(patches)
    ]
    found = run_tasks(run_trial, trials, workers=workers, progress=progress)
    size = len(patches)
    return [
        {patch: s for scores in found[k * size : (k + 1) * size] for patch, s in scores.items()}
        for k in range(len(names))
    ]


def transfer(
    train: Sequence[Patch],
    test: Sequence[Patch],
    *,
    names: Sequence[str] = DEFAULTS,
    seed: int,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[dict[str, dict[str, Any]]]:
    """Scores of each classifier on each patch of `test`, trained on all of `train`."""
    trials = [Trial(name, tuple(train), tuple(test), seed) for name in names]
    return run_tasks(run_trial, trials, workers=workers, progress=progress)


def run_trial(trial: Trial) -> dict[str, dict[str, Any]]:
    """Train once; scores for each test patch by name."""
    touches = [touch for patch in trial.train for touch in patch.touches]
    model = make(trial.classifier).fit(touches, rng=task_rng(trial.seed))
    found = {}
    for patch in trial.test:
        got = score(model, patch.touches)
        found[patch.name] = {
            "accuracy": got.accuracy,
            "touches": got.touches,
            "unknown": got.unknown,
            "per_label": dict(got.per_label),
            "counts": _counts(patch.touches),
        }
    return found


def check_carries_over(names: Sequence[str]) -> None:
    """Refuse classifiers that know one skin only.

    Raises
    ------
    InvalidArrayError, UnknownNameError
    """
    for name in names:
        if getattr(make(name).descriptor, "one_skin", False):
            raise InvalidArrayError(
                f"{name!r} learns the taxels of one part: it cannot be tested on another"
            )


def make(name: str) -> TouchClassifier:
    """An untrained classifier by its name; "histogram:nearest" adopts unseen structures.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        No such classifier, or one without structures that could be adopted.
    """
    model = classifiers.get(name.removesuffix(NEAREST))()
    if name.endswith(NEAREST):
        if not isinstance(model.descriptor, Histograms):
            raise InvalidArrayError(f"{name!r}: only histograms know structures")
        model.descriptor.unseen = "nearest"
    return model


def _counts(touches: Sequence[Touch]) -> dict[str, int]:
    labels, counts = np.unique([touch.label for touch in touches], return_counts=True)
    return {str(label): int(n) for label, n in zip(labels, counts, strict=True)}


def summarise(name: str, seeds: Sequence[dict[str, dict[str, Any]]]) -> dict[str, Any]:
    """One row: means over the seeds per patch and class, mean and worst over the patches."""
    per_patch = {
        patch: float(np.mean([scores[patch]["accuracy"] for scores in seeds])) for patch in seeds[0]
    }
    right: dict[str, float] = {}
    total: dict[str, int] = {}
    for scores in seeds:
        for found in scores.values():
            for label, share in found["per_label"].items():
                right[label] = right.get(label, 0.0) + share * found["counts"][label]
                total[label] = total.get(label, 0) + found["counts"][label]
    means = [float(np.mean([found["accuracy"] for found in s.values()])) for s in seeds]
    worst = min(per_patch, key=lambda patch: per_patch[patch])
    return {
        "features": name,
        "classifier": _machine(make(name).estimator),
        "mean": float(np.mean(means)),
        "std": float(np.std(means, ddof=1)) if len(means) > 1 else 0.0,
        "worst": per_patch[worst],
        "worst_patch": worst,
        "per_patch": per_patch,
        "per_class": {label: right[label] / total[label] for label in total},
        "unknown": float(np.mean([found["unknown"] for s in seeds for found in s.values()])),
        "touches": sum(total.values()),
    }


def _machine(estimator: Any) -> str:
    """The class that decides, without what calibrates or prepares for it."""
    while True:
        if hasattr(estimator, "steps"):
            estimator = estimator.steps[-1][1]
        elif isinstance(getattr(estimator, "estimator", None), BaseEstimator):
            estimator = estimator.estimator
        else:
            return type(estimator).__name__

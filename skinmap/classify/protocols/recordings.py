"""Recordings under cross-validation: folds by touch event, and the leak of plain folds beside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.classify.classifier import classifiers
from skinmap.classify.descriptors import Touch
from skinmap.classify.evaluate import likeliest
from skinmap.classify.protocols.folds import FoldKind, make_folds, recalls
from skinmap.errors import InvalidArrayError, SkinError
from skinmap.parallel.run import run_tasks, task_rng
from skinmap.parallel.workers import ONE, Workers

FOLDS = 4
KINDS: tuple[FoldKind, ...] = ("plain", "event")
TOGETHER = "+"  # joins the labels of touches at once


@dataclass(frozen=True, eq=False, slots=True)
class Trial:
    """One cross-validation: what a worker needs."""

    classifier: str
    touches: tuple[Touch, ...]
    kind: FoldKind
    folds: int
    seed: int


def check_spelling(labels: Sequence[str]) -> None:
    """Refuse labels that differ in spelling only.

    Raises
    ------
    InvalidArrayError
    """
    plain: dict[str, str] = {}
    for label in labels:
        letters = "".join(c for c in label.casefold() if c.isalnum())
        if letters in plain:
            raise InvalidArrayError(
                f"labels {plain[letters]!r} and {label!r} differ in spelling only: "
                "the recordings do not match"
            )
        plain[letters] = label


def evaluate_recordings(
    touches: Sequence[Touch],
    *,
    names: Sequence[str],
    seeds: Sequence[int],
    folds: int = FOLDS,
    optional: bool = False,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Cross-validate classifiers on labelled touches.

    Parameters
    ----------
    touches : sequence of Touch
    names : sequence of str
        Classifiers.
    seeds : sequence of int
        One repetition each: other folds.
    folds : int
    optional : bool
        Whether a classifier that cannot run on these touches is named in `skipped` instead.
    workers : Workers
    progress : callable, optional

    Returns
    -------
    dict
        `table`: for each classifier and kind of folds `per_class`, `mean` (of the classes) and
        `std`; `leak`: by how much plain folds flatter each classifier; `skipped`: name -> reason.

    Raises
    ------
    InvalidArrayError
        Fewer touches of a label than folds.
    """
    labels = np.array([touch.label for touch in touches])
    make_folds(
        "event", labels, np.arange(len(labels)), folds=folds, rng=task_rng(0)
    )  # refuses what cannot be folded before anything is computed
    for name in names:
        classifiers.get(name)
    trials = [
        Trial(name, tuple(touches), kind, folds, seed)
        for name in names
        for kind in KINDS
        for seed in seeds
    ]
    found = run_tasks(run_trial, trials, workers=workers, progress=progress)
    table, skipped = [], {}
    for place in range(0, len(found), len(seeds)):
        trial, repeats = trials[place], found[place : place + len(seeds)]
        failure = next((one for one in repeats if isinstance(one, str)), None)
        if failure is None:
            table.append(_row(trial, [one for one in repeats if not isinstance(one, str)]))
        elif optional:
            skipped[trial.classifier] = failure
        else:
            raise InvalidArrayError(f"{trial.classifier}: {failure}")
    return {"table": table, "leak": _leak(table), "skipped": skipped}


def run_trial(trial: Trial) -> dict[str, float] | str:
    """Share named right of each label, or why the classifier cannot run on these touches."""
    rng = task_rng(trial.seed)
    try:
        named, labels = _cross_validate(trial, rng)
    except SkinError as error:
        return str(error)
    return recalls(labels, named, [str(label) for label in np.unique(labels)])


def _cross_validate(trial: Trial, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    labels = np.array([touch.label for touch in trial.touches])
    own = np.arange(len(labels))
    if trial.kind == "event":
        splits = make_folds("event", labels, own, folds=trial.folds, rng=rng)
        sides = [
            ([trial.touches[i] for i in train], [trial.touches[i] for i in test])
            for train, test in splits
        ]
    else:
        sides = _split_samples(trial.touches, trial.folds, rng)
    named, truth = [], []
    for train, test in sides:
        model = classifiers.get(trial.classifier)().fit(train, rng=rng)
        named += [likeliest(model, touch).label for touch in test]
        truth += [touch.label for touch in test]
    return np.array(named), np.array(truth)


def _split_samples(
    touches: Sequence[Touch], folds: int, rng: np.random.Generator
) -> list[tuple[list[Touch], list[Touch]]]:
    """Samples dealt out to folds whatever touch they are of: a touch is on both sides."""
    deals = [rng.permutation(len(touch.samples)) % folds for touch in touches]
    sides = []
    for fold in range(folds):
        pairs = list(zip(touches, deals, strict=True))
        train = [Touch(t.skin, t.samples[deal != fold], t.label) for t, deal in pairs]
        test = [
            Touch(t.skin, t.samples[deal == fold], t.label)
            for t, deal in pairs
            if (deal == fold).any()
        ]
        sides.append((train, test))
    return sides


def _row(trial: Trial, repeats: Sequence[dict[str, float]]) -> dict[str, Any]:
    means = [float(np.mean(list(one.values()))) for one in repeats]
    return {
        "folds": trial.kind,
        "features": trial.classifier,
        "classifier": trial.classifier,
        "per_class": {
            label: float(np.mean([one[label] for one in repeats])) for label in repeats[0]
        },
        "mean": float(np.mean(means)),
        "std": float(np.std(means, ddof=1)) if len(means) > 1 else 0.0,
        "touches": len(trial.touches),
    }


def _leak(table: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    means = {(row["classifier"], row["folds"]): row["mean"] for row in table}
    names = dict.fromkeys(row["classifier"] for row in table)
    return [
        {"classifier": name, "points": 100.0 * (means[name, "plain"] - means[name, "event"])}
        for name in names
        if (name, "plain") in means and (name, "event") in means
    ]

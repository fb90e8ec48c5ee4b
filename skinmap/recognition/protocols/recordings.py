"""Recordings under cross-validation: folds by touch event, and the leak of plain folds beside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from skinmap.arrays import BoolArray
from skinmap.errors import InvalidArrayError, SkinError
from skinmap.parallel.run import task_rng
from skinmap.parallel.workers import ONE, Workers
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.evaluate import likeliest
from skinmap.recognition.protocols.folds import FoldKind, averaged, make_folds, recalls, run_repeats
from skinmap.recognition.protocols.results import AccuracyRow, LeakRow

FOLDS = 4
KINDS: tuple[FoldKind, ...] = ("plain", "event")
TOGETHER = "+"  # joins the labels of touches at once


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
) -> tuple[list[AccuracyRow], list[LeakRow], dict[str, str]]:
    """Cross-validate classifiers on labelled touches.

    Parameters
    ----------
    touches : sequence of Touch
        Labelled.
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
    list of AccuracyRow
        For each classifier and kind of folds.
    list of LeakRow
        By how much plain folds flatter each classifier.
    dict of str to str
        Classifiers that were skipped, and why.

    Raises
    ------
    InvalidArrayError
        Fewer touches of a label than folds.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.recognition import recorded_touches
    >>> from skinmap.touch.prepared_skin import PreparedSkin
    >>> skin = PreparedSkin(skinmap.load_robot("kaspar").skin("left_hand"))
    >>> kinds = ["poke", "full_finger"]
    >>> played = skinmap.simulate(skin.skin, per_gesture=10, gestures=kinds, rng=0)
    >>> table, leak, skipped = evaluate_recordings(
    ...     recorded_touches(skin, played), names=["raw-intersection"], seeds=[0], folds=2
    ... )
    >>> [(row.folds, row.touches) for row in table], skipped
    ([('plain', 20), ('event', 20)], {})
    """
    labels = np.array([touch.label for touch in touches])
    # Refuses what cannot be folded before anything is computed.
    make_folds("event", labels, np.arange(len(labels)), folds=folds, rng=task_rng(0))
    for name in names:
        classifiers.get(name)
    trials = [
        {"classifier": name, "kind": kind, "seed": seed}
        for name in names
        for kind in KINDS
        for seed in seeds
    ]
    found = run_repeats(
        run_trial, trials, workers=workers, progress=progress, touches=tuple(touches), folds=folds
    )
    table: list[AccuracyRow] = []
    skipped: dict[str, str] = {}
    for place in range(0, len(found), len(seeds)):
        name, repeats = str(trials[place]["classifier"]), found[place : place + len(seeds)]
        rows = [one for one in repeats if isinstance(one, AccuracyRow)]
        if len(rows) == len(repeats):
            table.append(averaged(rows))
            continue
        why = next(one for one in repeats if isinstance(one, str))
        if not optional:
            raise InvalidArrayError(f"{name}: {why}")
        skipped[name] = why
    means = {(row.classifier, row.folds): row.mean for row in table}
    leak = [
        LeakRow(classifier=name, points=100.0 * (mean - means[name, "event"]))
        for (name, kind), mean in means.items()
        if kind == "plain" and (name, "event") in means
    ]
    return table, leak, skipped


def run_trial(
    classifier: str, kind: FoldKind, seed: int, *, touches: Sequence[Touch], folds: int
) -> AccuracyRow | str:
    """Share named right of each label, or why the classifier cannot run on these touches."""
    try:
        named, labels = _cross_validate(classifier, kind, touches, folds, task_rng(seed))
    except SkinError as error:
        return str(error)
    per_class = recalls(labels, named, np.unique(labels).tolist())
    return AccuracyRow(
        folds=kind,
        features=classifier,
        classifier=classifier,
        per_class=per_class,
        mean=float(np.mean(list(per_class.values()))),
        touches=len(touches),
    )


def _cross_validate(
    classifier: str, kind: FoldKind, touches: Sequence[Touch], folds: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    labels = np.array([touch.label for touch in touches])
    if kind == "event":
        splits = make_folds("event", labels, np.arange(len(labels)), folds=folds, rng=rng)
        sides = [
            ([touches[i] for i in train], [touches[i] for i in test]) for train, test in splits
        ]
    else:
        sides = _split_samples(touches, folds, rng)
    named, truth = [], []
    for train, test in sides:
        model = classifiers.get(classifier)().fit(train, rng=rng)
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
        train = [_some(touch, deal != fold) for touch, deal in pairs]
        test = [_some(touch, deal == fold) for touch, deal in pairs if (deal == fold).any()]
        sides.append((train, test))
    return sides


def _some(touch: Touch, chosen: BoolArray) -> Touch:
    """A touch with some of its samples (k,), which take as long as all of them."""
    rate = touch.rate * float(chosen.mean())
    return replace(touch, samples=touch.samples[chosen], rate=rate)

"""Carry-over: histograms learnt on one patch name touches on another with more or fewer taxels.

Literal histograms do not: resting taxels dominate their counts, and another patch has another
number of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.neighbours.structures import assign
from skinmap.parallel.run import task_rng
from skinmap.recognition.histograms.intersection import IntersectionSVC
from skinmap.recognition.protocols.folds import make_folds, run_repeats
from skinmap.recognition.protocols.results import CarryOver, CarryRow, CarrySummary
from skinmap.recognition.protocols.samples import (
    RECIPES,
    Recipe,
    SampleSet,
    count_votes,
    draw_samples,
    learn,
    resample,
    structures_of,
)
from skinmap.touch.histograms.codebook import WORDS
from skinmap.touch.prepared_skin import PreparedSkin

FOLDS = 4
PERCENT = 10  # of the samples of each patch
# A patch of which a whole hand covers less than this is touched by something else than a hand.
ENOUGH_ON_SKIN = 0.4


def evaluate_carry_over(
    skins: Mapping[str, PreparedSkin], *, seeds: Sequence[int], percent: int = PERCENT, **how: Any
) -> CarryOver:
    """Train on each patch in turn, test on held-out touches of it and on all patches.

    Parameters
    ----------
    skins : mapping of str to PreparedSkin
        Patches by name, of one module layout. Those that a gesture does not fit are left out.
    seeds : sequence of int
    percent : int
        Share of the samples that is drawn, trained on by 3 of 4 folds of touches.
    how
        Of `carry_over_repeat`: `samples` of each gesture on each patch, and `variety`; and of
        `run_tasks`: `workers`, and `progress` after each seed.

    Returns
    -------
    CarryOver
        For each kind of histogram and pair of patches, and for each kind.
    """
    for skin in skins.values():
        skin.hoods  # noqa: B018 - computed here once, then carried to the workers
    varied = [{"seed": seed} for seed in seeds]
    found = run_repeats(carry_over_repeat, varied, skins=skins, percent=percent, **how)
    shared = [key for key in found[0] if all(key in scores for scores in found)]
    rows = [
        CarryRow(
            features=features,
            trained_on=source,
            tested_on=target,
            taxels=[len(skins[source]), len(skins[target])],
            accuracy=float(np.mean([scores[features, source, target] for scores in found])),
        )
        for features, source, target in shared
    ]
    used = {row.trained_on for row in rows}
    return CarryOver(
        percent=percent,
        summary=[_summary(recipe.name, rows) for recipe in RECIPES],
        rows=rows,
        left_out=[name for name in skins if name not in used],
    )


def carry_over_repeat(
    seed: int,
    *,
    skins: Mapping[str, PreparedSkin],
    samples: Mapping[str, int],
    percent: float,
    variety: float = 0.0,
) -> dict[tuple[str, str, str], float]:
    """Accuracy of one seed by features, patch trained on and patch tested on."""
    rng = task_rng(seed, 1)
    drawn: dict[str, SampleSet] = {}
    for name, skin in skins.items():
        try:
            found = draw_samples(skin, samples, rng=rng, variety=variety)
        except InvalidArrayError:
            continue
        if found.on_skin >= ENOUGH_ON_SKIN:
            drawn[name] = found.take(resample(found.labels, percent, rng=rng))
    scores = {}
    for recipe in RECIPES:
        for source in drawn:
            for target, accuracy in _from(skins, drawn, recipe, source, rng).items():
                scores[recipe.name, source, target] = accuracy
    return scores


def _from(
    skins: Mapping[str, PreparedSkin],
    drawn: Mapping[str, SampleSet],
    recipe: Recipe,
    source: str,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Accuracy on every patch of classifiers trained on folds of one."""
    own = structures_of(recipe, skins[source].hoods)
    seed = int(rng.integers(2**31))
    book = learn(recipe, own, drawn[source].book, seed=seed, words=WORDS)
    votes: dict[str, FloatArray] = {}
    for name, samples in drawn.items():
        found = own if name == source else assign(skins[name].hoods, book.prototypes)
        votes[name] = count_votes(book, found, samples.pressures)
    labels = drawn[source].labels
    folds = make_folds("event", labels, drawn[source].events, folds=FOLDS, rng=rng)
    right: dict[str, list[float]] = {name: [] for name in drawn}
    for train, test in folds:
        machine = IntersectionSVC().fit(votes[source][train], labels[train])
        for name, samples in drawn.items():
            rows: IntArray = test if name == source else np.arange(len(samples.labels))
            named = machine.predict(votes[name][rows])
            right[name].append(float(np.mean(named == samples.labels[rows])))
    return {name: float(np.mean(shares)) for name, shares in right.items()}


def _summary(features: str, rows: Sequence[CarryRow]) -> CarrySummary:
    own = [row for row in rows if row.features == features]
    away = [row for row in own if row.taxels[0] != row.taxels[1]]
    same = _mean([row.accuracy for row in own if row.trained_on == row.tested_on])
    other = _mean([row.accuracy for row in away])
    worst = min(away, key=lambda row: row.accuracy, default=None)
    return CarrySummary(
        features=features,
        same=same,
        other=other,
        difference=other - same,
        worst=worst.accuracy if worst else None,
        worst_pair=[worst.trained_on, worst.tested_on] if worst else [],
    )


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")

"""The first paper's table: four touches, few training samples, histograms against raw values.

Z. Ji, F. Amirabdollahian, D. Polani, K. Dautenhahn, "Histogram based classification of tactile
patterns on periodically distributed skin sensors for a humanoid robot", RO-MAN 2011.

Carry-over: histograms learnt on one patch name touches on another with more or fewer taxels.

Literal histograms do not: resting taxels dominate their counts, and another patch has another
number of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.errors import InvalidArrayError
from skinmap.neighbours.structures import assign
from skinmap.parallel.run import task_rng
from skinmap.recognition.histograms.intersection import IntersectionSVC, intersection_kernel
from skinmap.recognition.protocols.folds import (
    Fold,
    FoldKind,
    Names,
    averaged,
    make_folds,
    mean_and_spread,
    recalls,
    run_repeats,
    smallest,
)
from skinmap.recognition.protocols.results import (
    AccuracyRow,
    CarryOver,
    CarryRow,
    CarrySummary,
    MarginRow,
    SweepRow,
)
from skinmap.recognition.protocols.samples import (
    COUNTS,
    LITERAL,
    RECIPES,
    ROTATED,
    Recipe,
    SampleSet,
    Sampling,
    count_votes,
    draw_samples,
    learn,
    resample,
    structures_of,
)
from skinmap.touch.histograms.codebook import WORDS
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.variety import Places

# Samples of each class at 50 Hz, the shares drawn of them, and the folds.
SAMPLES = {"poke": 1419, "full_finger": 1712, "three_finger": 1697, "whole_hand": 2318}
PERCENTS = (2, 10)
FOLDS = 4
# Swept are radii and codewords a structure; the paper left both open. The rings of the 12-pad
# lattice lie at 5, 5.8, 7.6, 10, 10.4, 13.2, 14.4 and 15 mm. Both extremes of its discussion are
# there: single taxels, and the whole part.
RADII = (0.0001, 0.0055, 0.008, 0.0095, 0.0115, 0.014, 0.03, 1.0)
WORD_COUNTS = (2, 4, 8, 16, 32, 64)
SWEPT = 10  # percent
KINDS: tuple[FoldKind, ...] = ("plain", "event")
ROBOT, PART = "kaspar", "right_hand"
# Tables of the paper: percent, features, classifier and the accuracy of each class [%].
PAPER = (
    (2, "histogram", "intersection-svm", (83.3, 70.9, 96.3, 96.6)),
    (2, "raw", "rbf-svm", (61.0, 52.4, 90.5, 92.6)),
    (10, "histogram", "intersection-svm", (95.6, 91.4, 97.1, 97.9)),
    (10, "raw", "rbf-svm", (92.9, 84.4, 97.3, 97.9)),
)


def evaluate_kaspar(
    skin: PreparedSkin,
    *,
    seeds: Sequence[int],
    samples: Mapping[str, int] = SAMPLES,
    percents: Sequence[int] = PERCENTS,
    **how: Any,
) -> list[AccuracyRow]:
    """The table on simulated touches anywhere on a part.

    Parameters
    ----------
    skin : PreparedSkin
        Of a part with n_taxels.
    seeds : sequence of int
        One repetition each: new touches, codebook, shares and folds.
    samples : mapping of str to int
        Samples of each gesture; the paper's by default.
    percents : sequence of int
        Shares of them that are drawn and cross-validated.
    how
        `places`, where people touch ("anywhere", "habitual", "grips"); `sampling`, "random" or as
        in the "paper", every 50th and every 10th sample; `variety`, 0 as in the paper; and
        `workers` and `progress` of `run_tasks`, which is called after each seed.

    Returns
    -------
    list of AccuracyRow
        Means over the seeds, by percent, folds, features and classifier.

    Examples
    --------
    >>> import skinmap
    >>> skin = PreparedSkin(skinmap.load_robot("kaspar").skin("right_hand"))
    >>> few = dict.fromkeys(SAMPLES, 240)
    >>> rows = evaluate_kaspar(skin, seeds=[0], samples=few, percents=[20])
    >>> len(rows), rows[0].folds, rows[0].samples
    (10, 'plain', 192)
    """
    skin.hoods  # noqa: B018 - computed here once, then carried to the workers
    shared = {"skin": skin, "samples": samples, "percents": tuple(percents), **how}
    found = run_repeats(kaspar_repeat, [{"seed": seed} for seed in seeds], **shared)
    return [averaged(rows) for rows in zip(*found, strict=True)]


def paper_rows() -> list[AccuracyRow]:
    """The paper's own figures, on recordings of the real robot (4 plain folds)."""
    return [
        AccuracyRow(
            percent=percent,
            folds="plain",
            features=features,
            classifier=classifier,
            per_class={name: value / 100.0 for name, value in zip(SAMPLES, values, strict=True)},
            mean=float(np.mean(values)) / 100.0,
        )
        for percent, features, classifier, values in PAPER
    ]


def margins(table: Sequence[AccuracyRow]) -> list[MarginRow]:
    """By how many points histograms lead raw values in an RBF SVM, beside the paper's margin."""

    def mean(rows: Sequence[AccuracyRow], *wanted: object) -> float:
        (row,) = (
            row for row in rows if (row.percent, row.folds, row.features, row.classifier) == wanted
        )
        return row.mean

    found, published = [], paper_rows()
    for percent in dict.fromkeys(cast(int, row.percent) for row in table):
        theirs = None
        if percent in {row.percent for row in published}:
            ahead = mean(published, percent, "plain", "histogram", "intersection-svm")
            theirs = 100.0 * (ahead - mean(published, percent, "plain", "raw", "rbf-svm"))
        for kind in KINDS:
            raw = mean(table, percent, kind, "raw", "rbf-svm")
            found += [
                MarginRow(
                    percent=percent,
                    folds=kind,
                    features=recipe.name,
                    points=100.0
                    * (mean(table, percent, kind, recipe.name, "intersection-svm") - raw),
                    paper=theirs if kind == "plain" and recipe is LITERAL else None,
                )
                for recipe in RECIPES
            ]
    return found


def kaspar_repeat(
    seed: int,
    *,
    skin: PreparedSkin,
    samples: Mapping[str, int],
    percents: tuple[int, ...],
    places: Places = "anywhere",
    sampling: Sampling = "random",
    variety: float = 0.0,
) -> list[AccuracyRow]:
    """All rows of the table for one seed."""
    rng = task_rng(seed)
    drawn = draw_samples(skin, samples, rng=rng, places=places, variety=variety)
    votes = _votes(skin, drawn, int(rng.integers(2**31)))
    rows = []
    for percent in percents:
        index = resample(drawn.labels, percent, rng=rng, sampling=sampling)
        part = drawn.take(index)
        raw = part.pressures / COUNTS
        kernels = {name: intersection(counts[index]) for name, counts in votes.items()}
        table = [*kernels.items(), ("raw", rbf(raw)), ("raw", intersection(raw))]
        for kind in KINDS:
            folds = make_folds(kind, part.labels, part.events, folds=FOLDS, rng=rng)
            inner = int(rng.integers(2**31))  # the same inner folds for all kernels
            for features, kernel in table:
                rows.append(_row(part, features, kernel, kind, folds, percent, inner))
    return rows


def _votes(skin: PreparedSkin, drawn: SampleSet, seed: int) -> dict[str, Any]:
    """Histograms (n, bins) of all samples under the name of each recipe."""
    votes = {}
    for recipe in RECIPES:
        structures = structures_of(recipe, skin.hoods)
        book = learn(recipe, structures, drawn.book, seed=seed, words=WORDS)
        votes[recipe.name] = count_votes(book, structures, drawn.pressures)
    return votes


def _row(
    part: SampleSet,
    features: str,
    kernel: Kernel,
    kind: FoldKind,
    folds: list[Any],
    percent: int,
    seed: int,
) -> AccuracyRow:
    named = cross_validate(
        kernel, part.labels, part.events, folds, kind=kind, rng=np.random.default_rng(seed)
    )
    per_class = recalls(part.labels, named, tuple(SAMPLES))
    return AccuracyRow(
        percent=percent,
        folds=kind,
        features=features,
        classifier=kernel.name,
        per_class=per_class,
        mean=float(np.mean(list(per_class.values()))),
        samples=len(part.labels),
    )


def sweep_radius_and_words(
    skin: PreparedSkin, *, seeds: Sequence[int], **how: Any
) -> list[SweepRow]:
    """Accuracy of histograms (rotation, rest dropped) for each of `RADII` and `WORD_COUNTS`.

    Folds are grouped by touch event; every cell of a seed sees the same samples and folds.

    Parameters
    ----------
    skin : PreparedSkin
    seeds : sequence of int
    how
        `samples`, `percent`, `variety`, `workers` and `progress` of `evaluate_kaspar`.

    Returns
    -------
    list of SweepRow
    """
    skin.hoods  # noqa: B018 - computed here once, then carried to the workers
    found = run_repeats(sweep_repeat, [{"seed": seed} for seed in seeds], skin=skin, **how)
    rows = []
    for repeats in zip(*found, strict=True):
        mean, std = mean_and_spread([row.mean for row in repeats])
        rows.append(replace(repeats[0], mean=mean, std=std))
    return rows


def sweep_repeat(
    seed: int,
    *,
    skin: PreparedSkin,
    samples: Mapping[str, int] = SAMPLES,
    percent: int = SWEPT,
    variety: float = 0.0,
) -> list[SweepRow]:
    """Rows of one seed: the same samples and folds for each radius and number of codewords."""
    rng = task_rng(seed)
    drawn = draw_samples(skin, samples, rng=rng, variety=variety)
    part = drawn.take(resample(drawn.labels, percent, rng=rng))
    folds = make_folds("event", part.labels, part.events, folds=FOLDS, rng=rng)
    learnt = int(rng.integers(2**31))
    rows = []
    for radius in RADII:
        structures = structures_of(ROTATED, skin.neighbourhoods(radius=radius))
        shapes = structures.prototypes
        for words in WORD_COUNTS:
            book = learn(ROTATED, structures, part.book, seed=learnt, words=words)
            votes = count_votes(book, structures, part.pressures)
            row = _row(part, ROTATED.name, intersection(votes), "event", folds, percent, learnt)
            rows.append(
                SweepRow(
                    radius_mm=1e3 * radius,
                    words=words,
                    structures=len(shapes),
                    neighbours=int(shapes.filled[0].sum()) if len(shapes) else 0,
                    bins=votes.shape[1],
                    mean=row.mean,
                    std=0.0,
                )
            )
    return rows


INNER_FOLDS = 3
PENALTIES = (1.0, 10.0, 100.0)
# Around 1 / (median squared distance): the width at which a kernel is neither constant nor a comb.
WIDTHS = (0.25, 1.0, 4.0, 16.0)


@dataclass(frozen=True, eq=False, slots=True)
class Kernel:
    """A kernel with one Gram matrix for each value of its own parameter.

    Attributes
    ----------
    name : str
    grams : (g, n, n) float
        Over all n rows, training and test.
    """

    name: str
    grams: FloatArray

    def __post_init__(self) -> None:
        freeze(self, grams=self.grams)


def rbf(rows: FloatArray) -> Kernel:
    """Radial basis functions of several widths on rows (n, d)."""
    square = (rows**2).sum(axis=1)
    gap = np.maximum(square[:, None] + square - 2.0 * rows @ rows.T, 0.0)
    typical = float(np.median(gap[gap > 0])) if (gap > 0).any() else 1.0
    return Kernel("rbf-svm", np.stack([np.exp(-width / typical * gap) for width in WIDTHS]))


def intersection(counts: FloatArray) -> Kernel:
    """Histogram intersection on counts (n, d), scaled so that its mean diagonal is 1."""
    gram = intersection_kernel(counts, counts)
    return Kernel("intersection-svm", (gram / (float(np.diag(gram).mean()) or 1.0))[None])


def cross_validate(
    kernel: Kernel,
    labels: Names,
    events: IntArray,
    folds: Sequence[Fold],
    *,
    kind: FoldKind,
    rng: np.random.Generator,
) -> Names:
    """(n,) the label that each row gets from the fold that did not train on it.

    Penalty and kernel parameter are chosen anew on the training rows of each fold, with inner
    folds of the same kind.
    """
    named = np.empty_like(labels)
    for train, test in folds:
        which, penalty = _choose(kernel, labels, events, train, kind, rng)
        named[test] = _predict(kernel.grams[which], labels, train, test, penalty)
    return named


def _choose(
    kernel: Kernel,
    labels: Names,
    events: IntArray,
    train: IntArray,
    kind: FoldKind,
    rng: np.random.Generator,
) -> tuple[int, float]:
    """Gram matrix and penalty that name most training rows right; the middle without a choice."""
    able = min(INNER_FOLDS, *smallest(kind, labels[train], events[train]).values())
    grid = [(which, c) for which in range(len(kernel.grams)) for c in PENALTIES]
    if able < 2:
        return len(kernel.grams) // 2, PENALTIES[len(PENALTIES) // 2]
    inner = make_folds(kind, labels[train], events[train], folds=able, rng=rng)
    sides = [(train[fit], train[check]) for fit, check in inner]
    right = [
        sum((_predict(kernel.grams[which], labels, *side, c) == labels[side[1]]).sum()
            for side in sides)
        for which, c in grid
    ]  # fmt: skip
    return grid[int(np.argmax(right))]


def _predict(
    gram: FloatArray, labels: Names, train: IntArray, test: IntArray, penalty: float
) -> Names:
    from sklearn.svm import SVC

    machine = SVC(kernel="precomputed", C=penalty).fit(gram[np.ix_(train, train)], labels[train])
    return np.asarray(machine.predict(gram[np.ix_(test, train)]))


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

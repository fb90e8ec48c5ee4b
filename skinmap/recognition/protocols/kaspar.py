"""The first paper's table: four touches, few training samples, histograms against raw values.

Z. Ji, F. Amirabdollahian, D. Polani, K. Dautenhahn, "Histogram based classification of tactile
patterns on periodically distributed skin sensors for a humanoid robot", RO-MAN 2011.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.parallel.run import task_rng
from skinmap.recognition.histograms.intersection import intersection_kernel
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
from skinmap.recognition.protocols.results import AccuracyRow, MarginRow, SweepRow
from skinmap.recognition.protocols.samples import (
    COUNTS,
    LITERAL,
    RECIPES,
    ROTATED,
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

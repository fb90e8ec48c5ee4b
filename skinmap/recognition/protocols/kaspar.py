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
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.neighbours.structures import Structures, assign, find_structures
from skinmap.parallel.run import task_rng
from skinmap.recognition.histograms.intersection import IntersectionSVC, intersection_kernel
from skinmap.recognition.protocols.folds import (
    Fold,
    FoldKind,
    Names,
    averaged,
    make_folds,
    mean_and_spread,
    run_repeats,
    shares,
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
from skinmap.skin.skin import Skin
from skinmap.touch.contacts.skin_geometry import ACTIVE
from skinmap.touch.histograms.codebook import COUNTS, WORDS, Codebook, VoteCounter, learn_codebook
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.gestures import ON_SKIN
from skinmap.touch.simulation.simulator import SUBJECTS, Player, place, prepare
from skinmap.touch.simulation.variety import Places, draw_sensing, draw_subjects

BOOK_TOUCHES = 12  # touches of each gesture that the codebook is learnt from, and nothing else
BOOK_SAMPLES = 240
# Least share of a touch that lies over taxels: the simulator's own, and less where nothing fits.
SHARES = (ON_SKIN, 0.55, 0.4, 0.25)
SAMPLES_A_TOUCH = 34  # in contact, at 50 Hz; fewer than almost any simulated touch has


@dataclass(frozen=True, eq=False, slots=True)
class SampleSet:
    """Samples in contact with their labels, and unlabelled ones of other touches.

    Attributes
    ----------
    pressures : (n, n_taxels) uint8
    labels : (n,) str
    events : (n,) int
        Touch that each sample is of.
    book : (m, n_taxels) uint8
        Samples of touches that are not among `events`: "touches made at random", for codebooks.
    on_skin : float
        Least share of a touch over taxels, of the gesture that fits worst.
    """

    pressures: NDArray[np.uint8]
    labels: Names
    events: IntArray
    book: NDArray[np.uint8]
    on_skin: float

    def take(self, rows: IntArray) -> SampleSet:
        """The same with some of the labelled samples."""
        return SampleSet(
            self.pressures[rows], self.labels[rows], self.events[rows], self.book, self.on_skin
        )


def draw_samples(
    skin: PreparedSkin,
    counts: Mapping[str, int],
    *,
    rng: np.random.Generator,
    places: Places = "anywhere",
    variety: float = 0.0,
) -> SampleSet:
    """Simulate touches until there are so many samples in contact of each gesture.

    Parameters
    ----------
    skin : PreparedSkin
        n_taxels.
    counts : mapping of str to int
        Samples wanted of each gesture.
    rng : numpy.random.Generator
    places : {"anywhere", "habitual"}
    variety : float
        See `simulate`; 0 are pads of fixed sizes, as in the paper's figures.

    Raises
    ------
    InvalidArrayError
        A gesture of which not even a quarter fits the part.
    """
    touches = -(-max(counts.values()) // SAMPLES_A_TOUCH) + BOOK_TOUCHES
    names = np.repeat(list(counts), touches)
    recording, on_skin = _play(skin.skin, names, places, variety, rng)
    seen = dict.fromkeys(counts, 0)
    rows: dict[str, list[IntArray]] = {name: [] for name in counts}
    book: list[IntArray] = []
    touched: BoolArray = np.asarray((recording.pressures > ACTIVE).any(axis=1))
    for label, rows_of_touch in zip(recording.labels, recording.rows(), strict=True):
        own = rows_of_touch[touched[rows_of_touch]]
        seen[label] += 1
        (book if seen[label] <= BOOK_TOUCHES else rows[label]).append(own)
    chosen = [np.concatenate(rows[name])[: counts[name]] for name in counts]
    some = np.concatenate(book)
    some = rng.choice(some, min(BOOK_SAMPLES, len(some)), replace=False)
    index = np.concatenate(chosen)
    labels = np.repeat(list(counts), [len(own) for own in chosen])
    pressures, events = recording.pressures, recording.events
    return SampleSet(pressures[index], labels, events[index], pressures[some], on_skin)


def _play(
    skin: Skin, names: Names, places: Places, variety: float, rng: np.random.Generator
) -> tuple[Recording, float]:
    """So many touches of each gesture; what is larger than the part hangs over its edge.

    The second value is the share that is left over taxels of the gesture that fits worst.
    """
    answers = draw_sensing(variety, rng=rng)
    stage = prepare(skin, rng=rng, sensing=answers, variety=variety)
    people = draw_subjects(SUBJECTS, rng=rng)
    player = Player(stage, rng)
    shares = {name: list(SHARES) for name in np.unique(names)}
    for name in rng.permutation(names):
        subject = people[int(rng.integers(len(people)))]
        placed = None
        while placed is None and shares[name]:
            share = shares[name][0]
            placed = place(stage, name, subject, rng=rng, places=places, on_skin=share)
            if placed is None:
                shares[name].pop(0)
        if placed is None:
            raise InvalidArrayError(
                f"{name} does not fit the {len(skin)} taxels of {skin.part!r}; choose a larger part"
            )
        player.touch([placed])
    return player.recording(), min(left[0] for left in shares.values())


Sampling = Literal["random", "paper"]


def resample(
    labels: Names, percent: float, *, rng: np.random.Generator, sampling: Sampling = "random"
) -> IntArray:
    """Rows of a share of the samples of each label, at least one of each.

    Drawn at random, or as the paper has it: every 50th sample for 2 %, every 10th for 10 %. Two
    samples of one touch are then 1 s and 0.2 s apart.
    """
    chosen = []
    for label in np.unique(labels):
        own = np.flatnonzero(labels == label)
        if sampling == "paper":
            chosen.append(own[:: max(1, round(100.0 / percent))])
            continue
        count = max(1, round(len(own) * percent / 100.0))
        chosen.append(rng.choice(own, count, replace=False))
    return np.sort(np.concatenate(chosen))


class Recipe(NamedTuple):
    """How histograms are made.

    Attributes
    ----------
    name : str
    rotations : int
        Turns that structures may have, 1 or 6.
    literal : bool
        As published: resting codewords count.
    """

    name: str
    rotations: int
    literal: bool = False


ROTATED = Recipe("histogram", 6)
UPRIGHT = Recipe("histogram, no rotation", 1)
LITERAL = Recipe("histogram, literal", 1, literal=True)
RECIPES = (ROTATED, UPRIGHT, LITERAL)


def learn(
    recipe: Recipe, structures: Structures, book: NDArray[np.uint8], *, seed: int, words: int
) -> Codebook:
    """A codebook from unlabelled samples (m, n_taxels) of one skin."""
    pools, rng = [(structures, book / COUNTS)], np.random.default_rng(seed)
    return learn_codebook(pools, rng=rng, words=words, literal=recipe.literal)


def count_votes(
    codebook: Codebook, structures: Structures, pressures: NDArray[np.uint8]
) -> FloatArray:
    """(n, bins) histograms of samples (n, n_taxels)."""
    return VoteCounter(codebook, structures).count(pressures).astype(np.float64)


# Samples of each class at 50 Hz, the shares drawn of them, and the folds.
SAMPLES = {"poke": 1419, "full_finger": 1712, "three_finger": 1697, "whole_hand": 2318}
PERCENTS = (2, 10)
FOLDS = 4
# Swept are radii and codewords a structure; the paper left both open. The rings of the 12-pad
# lattice lie at 5, 5.8, 7.6, 10, 10.4, 13.2, 14.4 and 15 mm. Both extremes of its discussion are
# there: single taxels, and the whole part.
RADII = (0.0001, 0.0055, 0.008, 0.0095, 0.0115, 0.014, 0.03, 1.0)
WORD_COUNTS = (2, 4, 8, 16, 32, 64)
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
    ours, published = (
        {(row.percent, row.folds, row.features, row.classifier): row.mean for row in rows}
        for rows in (table, paper_rows())
    )
    theirs = {
        percent: _lead(published, percent, "plain", "histogram")
        for percent in dict.fromkeys(key[0] for key in published)
    }
    return [
        MarginRow(
            percent=percent,
            folds=kind,
            features=recipe.name,
            points=_lead(ours, percent, kind, recipe.name),
            paper=theirs.get(percent) if kind == "plain" and recipe is LITERAL else None,
        )
        for percent in dict.fromkeys(cast(int, row.percent) for row in table)
        for kind in KINDS
        for recipe in RECIPES
    ]


def _lead(means: Mapping[Any, float], percent: Any, kind: FoldKind, features: str) -> float:
    ahead = means[percent, kind, features, "intersection-svm"]
    return 100.0 * (ahead - means[percent, kind, "raw", "rbf-svm"])


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
        structures = find_structures(skin.hoods, rotations=recipe.rotations)
        book = learn(recipe, structures, drawn.book, seed=seed, words=WORDS)
        votes[recipe.name] = count_votes(book, structures, drawn.pressures)
    return votes


def _row(
    part: SampleSet,
    features: str,
    kernel: Kernel,
    kind: FoldKind,
    folds: Sequence[Fold],
    percent: int,
    seed: int,
) -> AccuracyRow:
    """Accuracy of a kernel: each row is named by the fold that did not train on it.

    Penalty and kernel parameter are chosen anew on the training rows of each fold, with inner
    folds of the same kind.
    """
    named, rng = np.empty_like(part.labels), np.random.default_rng(seed)
    for train, test in folds:
        which, penalty = _choose(kernel, part, train, kind, rng)
        named[test] = _predict(kernel.grams[which], part.labels, train, test, penalty)
    return AccuracyRow(
        percent=percent,
        folds=kind,
        features=features,
        classifier=kernel.name,
        samples=len(part.labels),
        **shares(part.labels, named, tuple(SAMPLES)),
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
    seed: int, *, skin: PreparedSkin, samples: Mapping[str, int], percent: int, variety: float = 0.0
) -> list[SweepRow]:
    """Rows of one seed: the same samples and folds for each radius and number of codewords."""
    rng = task_rng(seed)
    drawn = draw_samples(skin, samples, rng=rng, variety=variety)
    part = drawn.take(resample(drawn.labels, percent, rng=rng))
    folds = make_folds("event", part.labels, part.events, folds=FOLDS, rng=rng)
    learnt = int(rng.integers(2**31))
    rows = []
    for radius in RADII:
        hoods = skin.neighbourhoods(radius=radius)
        structures = find_structures(hoods, rotations=ROTATED.rotations)
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


class Kernel(NamedTuple):
    """A kernel with one Gram matrix for each value of its own parameter.

    Attributes
    ----------
    name : str
    grams : (g, n, n) float
        Over all n rows, training and test.
    """

    name: str
    grams: FloatArray


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


def _choose(
    kernel: Kernel, part: SampleSet, train: IntArray, kind: FoldKind, rng: np.random.Generator
) -> tuple[int, float]:
    """Gram matrix and penalty that name most training rows right; the middle without a choice."""
    labels, events = part.labels, part.events
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


# A patch of which a whole hand covers less than this is touched by something else than a hand.
ENOUGH_ON_SKIN = 0.4


def evaluate_carry_over(
    skins: Mapping[str, PreparedSkin], *, seeds: Sequence[int], percent: int, **how: Any
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
    own = find_structures(skins[source].hoods, rotations=recipe.rotations)
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

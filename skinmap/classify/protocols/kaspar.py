"""The first paper's table: four touches, few training samples, histograms against raw values.

Z. Ji, F. Amirabdollahian, D. Polani, K. Dautenhahn, "Histogram based classification of tactile
patterns on periodically distributed skin sensors for a humanoid robot", RO-MAN 2011.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from skinmap.classify.protocols.folds import FoldKind, make_folds, recalls
from skinmap.classify.protocols.kernels import Kernel, cross_validate, intersection, rbf
from skinmap.classify.protocols.repeats import run_repeats
from skinmap.classify.protocols.samples import (
    COUNTS,
    RECIPES,
    SampleSet,
    count_votes,
    draw_samples,
    learn,
    resample,
    structures_of,
)
from skinmap.parallel.run import task_rng
from skinmap.parallel.workers import ONE, Workers
from skinmap.touch.codebook import WORDS
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.subjects import Places

# Samples of each class at 50 Hz, the shares drawn of them, and the folds.
SAMPLES = {"poke": 1419, "full_finger": 1712, "three_finger": 1697, "whole_hand": 2318}
PERCENTS = (2, 10)
FOLDS = 4
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
    samples: dict[str, int] | None = None,
    percents: Sequence[float] = PERCENTS,
    places: Places = "anywhere",
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[dict[str, Any]]:
    """The table on simulated touches anywhere on a part.

    Parameters
    ----------
    skin : PreparedSkin
    seeds : sequence of int
        One repetition each: new touches, codebook, shares and folds.
    samples : dict of str to int, optional
        Samples of each gesture; the paper's by default.
    percents : sequence of float
        Shares of them that are drawn and cross-validated.
    places : {"anywhere", "habitual"}
        Where people touch.
    workers : Workers
    progress : callable, optional
        Called after each seed.

    Returns
    -------
    list of dict
        `percent`, `folds` (plain or event), `features`, `classifier`, `per_class`, `mean` (of
        the classes), `std` (over the seeds) and `samples`; accuracies 0 to 1.
    """
    skin.hoods  # noqa: B018 - computed here once, then carried to the workers
    wanted = dict(samples or SAMPLES)
    found = run_repeats(
        kaspar_repeat,
        [{"seed": seed} for seed in seeds],
        workers=workers,
        progress=progress,
        skin=skin,
        samples=wanted,
        percents=tuple(percents),
        places=places,
    )
    return [_average([rows[number] for rows in found]) for number in range(len(found[0]))]


def paper_rows() -> list[dict[str, Any]]:
    """The paper's own figures, on recordings of the real robot (4 plain folds)."""
    return [
        {
            "percent": percent,
            "folds": "plain",
            "features": features,
            "classifier": classifier,
            "per_class": {name: value / 100.0 for name, value in zip(SAMPLES, values, strict=True)},
            "mean": float(np.mean(values)) / 100.0,
        }
        for percent, features, classifier, values in PAPER
    ]


def kaspar_repeat(
    seed: int,
    *,
    skin: PreparedSkin,
    samples: dict[str, int],
    percents: tuple[float, ...],
    places: Places,
) -> list[dict[str, Any]]:
    """All rows of the table for one seed."""
    rng = task_rng(seed)
    drawn = draw_samples(skin, samples, rng=rng, places=places)
    votes = _votes(skin, drawn, int(rng.integers(2**31)))
    rows = []
    for percent in percents:
        index = resample(drawn.labels, percent, rng=rng)
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
    percent: float,
    seed: int,
) -> dict[str, Any]:
    named = cross_validate(
        kernel, part.labels, part.events, folds, kind=kind, rng=np.random.default_rng(seed)
    )
    per_class = recalls(part.labels, named, tuple(SAMPLES))
    return {
        "percent": percent,
        "folds": kind,
        "features": features,
        "classifier": kernel.name,
        "per_class": per_class,
        "mean": float(np.mean(list(per_class.values()))),
        "samples": len(part.labels),
    }


def _average(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Mean over the seeds, and the standard deviation of the mean of the classes."""
    means = [row["mean"] for row in rows]
    return {
        **rows[0],
        "per_class": {
            name: float(np.mean([row["per_class"][name] for row in rows]))
            for name in rows[0]["per_class"]
        },
        "mean": float(np.mean(means)),
        "std": float(np.std(means, ddof=1)) if len(means) > 1 else 0.0,
    }

"""The first paper's open question: which radius r and how many codewords k a structure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from skinmap.classify.protocols.folds import Fold, make_folds, recalls
from skinmap.classify.protocols.kaspar import FOLDS, SAMPLES
from skinmap.classify.protocols.kernels import cross_validate, intersection
from skinmap.classify.protocols.repeats import run_repeats
from skinmap.classify.protocols.samples import (
    ROTATED,
    SampleSet,
    count_votes,
    draw_samples,
    learn,
    neighbours_within,
    resample,
    structures_of,
)
from skinmap.parallel.run import task_rng
from skinmap.parallel.workers import ONE, Workers
from skinmap.touch.prepared_skin import PreparedSkin

# Between the rings of the 12-pad lattice (5, 8.7, 10, 13.2 and 15 mm), and the paper's 8 mm.
RADII = (0.0055, 0.008, 0.0095, 0.0115, 0.014)
WORDS = (2, 4, 8, 16, 32)
PERCENT = 10.0


def sweep_radius_and_words(
    skin: PreparedSkin,
    *,
    seeds: Sequence[int],
    radii: Sequence[float] = RADII,
    words: Sequence[int] = WORDS,
    samples: dict[str, int] | None = None,
    percent: float = PERCENT,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[dict[str, Any]]:
    """Accuracy of histograms (rotation, rest dropped) for each radius and number of codewords.

    Folds are grouped by touch event; every cell of a seed sees the same samples and folds.

    Parameters
    ----------
    skin : PreparedSkin
    seeds : sequence of int
    radii : sequence of float
        [m].
    words : sequence of int
        Codewords a structure, rest included.
    samples, percent, workers, progress
        See `evaluate_kaspar`; progress comes once a seed.

    Returns
    -------
    list of dict
        `radius_mm`, `words`, `structures`, `neighbours` (of the most common structure), `bins`,
        `mean`, `std`.
    """
    skin.hoods  # noqa: B018 - computed here once, then carried to the workers
    wanted = dict(samples or SAMPLES)
    found = run_repeats(
        sweep_repeat,
        [{"seed": seed} for seed in seeds],
        workers=workers,
        progress=progress,
        skin=skin,
        radii=tuple(radii),
        words=tuple(words),
        samples=wanted,
        percent=percent,
    )
    rows = []
    for repeats in zip(*found, strict=True):
        means = [row["mean"] for row in repeats]
        std = float(np.std(means, ddof=1)) if len(means) > 1 else 0.0
        rows.append({**repeats[0], "mean": float(np.mean(means)), "std": std})
    return rows


def sweep_repeat(
    seed: int,
    *,
    skin: PreparedSkin,
    radii: tuple[float, ...],
    words: tuple[int, ...],
    samples: dict[str, int],
    percent: float,
) -> list[dict[str, Any]]:
    """Rows of one seed: the same samples and folds for each radius and number of codewords."""
    rng = task_rng(seed)
    drawn = draw_samples(skin, samples, rng=rng)
    part = drawn.take(resample(drawn.labels, percent, rng=rng))
    folds = make_folds("event", part.labels, part.events, folds=FOLDS, rng=rng)
    learnt = int(rng.integers(2**31))
    return [row for radius in radii for row in _of_radius(skin, radius, words, part, folds, learnt)]


def _of_radius(
    skin: PreparedSkin,
    radius: float,
    words: Sequence[int],
    part: SampleSet,
    folds: Sequence[Fold],
    seed: int,
) -> list[dict[str, Any]]:
    structures = structures_of(ROTATED, neighbours_within(skin, radius))
    common = structures.prototypes.filled[0].sum() if len(structures.prototypes) else 0
    rows = []
    for k in words:
        book = learn(ROTATED, structures, part.book, seed=seed, words=k)
        votes = count_votes(book, structures, part.pressures)
        named = cross_validate(
            intersection(votes),
            part.labels,
            part.events,
            folds,
            kind="event",
            rng=np.random.default_rng(seed),
        )
        rows.append(
            {
                "radius_mm": 1e3 * radius,
                "words": k,
                "structures": len(structures.prototypes),
                "neighbours": int(common),
                "bins": votes.shape[1],
                "mean": float(np.mean(list(recalls(part.labels, named, [*SAMPLES]).values()))),
            }
        )
    return rows

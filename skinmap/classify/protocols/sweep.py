"""The first paper's open question: which radius r and how many codewords k a structure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.classify.protocols.folds import make_folds, recalls
from skinmap.classify.protocols.kaspar import FOLDS, SAMPLES
from skinmap.classify.protocols.kernels import cross_validate, intersection
from skinmap.classify.protocols.samples import (
    ROTATED,
    count_votes,
    draw_samples,
    learn,
    neighbours_within,
    resample,
    structures_of,
)
from skinmap.classify.protocols.tasks import ONE, Workers, run_tasks, task_rng
from skinmap.touch.prepared import PreparedSkin

# Between the rings of the 12-pad lattice (5, 8.7, 10, 13.2 and 15 mm), and the paper's 8 mm.
RADII = (0.0055, 0.008, 0.0095, 0.0115, 0.014)
WORDS = (2, 4, 8, 16, 32)
PERCENT = 10.0


@dataclass(frozen=True, eq=False, slots=True)
class Cell:
    """One seed and radius: what a worker needs."""

    skin: PreparedSkin
    seed: int
    radius: float
    words: tuple[int, ...]
    samples: dict[str, int]
    percent: float


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
        See `evaluate_kaspar`; progress comes once a seed and radius.

    Returns
    -------
    list of dict
        `radius_mm`, `words`, `structures`, `neighbours` (of the most common structure), `bins`,
        `mean`, `std`.
    """
    skin.hoods  # noqa: B018 - computed here once, then carried to the workers
    wanted = dict(samples or SAMPLES)
    cells = [
        Cell(skin, seed, radius, tuple(words), wanted, percent)
        for radius in radii
        for seed in seeds
    ]
    found = run_tasks(run_cell, cells, workers=workers, progress=progress)
    rows = []
    for place in range(len(radii)):
        repeats = found[place * len(seeds) : (place + 1) * len(seeds)]
        for number in range(len(words)):
            means = [cells[number].pop("mean") for cells in repeats]
            std = float(np.std(means, ddof=1)) if len(means) > 1 else 0.0
            rows.append({**repeats[0][number], "mean": float(np.mean(means)), "std": std})
    return rows


def run_cell(cell: Cell) -> list[dict[str, Any]]:
    """Rows for one seed and radius, one for each number of codewords."""
    rng = task_rng(cell.seed)
    drawn = draw_samples(cell.skin, cell.samples, rng=rng)
    part = drawn.take(resample(drawn.labels, cell.percent, rng=rng))
    folds = make_folds("event", part.labels, part.events, folds=FOLDS, rng=rng)
    seed = int(rng.integers(2**31))
    hoods = neighbours_within(cell.skin, cell.radius)
    structures = structures_of(ROTATED, hoods)
    common = structures.prototypes.filled[0].sum() if len(structures.prototypes) else 0
    rows = []
    for words in cell.words:
        book = learn(ROTATED, structures, drawn.book, seed=seed, words=words)
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
                "radius_mm": 1e3 * cell.radius,
                "words": words,
                "structures": len(structures.prototypes),
                "neighbours": int(common),
                "bins": votes.shape[1],
                "mean": float(np.mean(list(recalls(part.labels, named, [*SAMPLES]).values()))),
            }
        )
    return rows

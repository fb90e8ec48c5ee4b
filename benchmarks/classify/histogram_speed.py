"""Histograms of 1,128 taxels: ours, the loop of Algorithm 1 and scikit-learn's k-means."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.cluster import KMeans

from benchmarks.harness.timing import medians, ratio_quartiles, spreads, take_turns
from skinmap.neighbours.offsets import neighbourhoods
from skinmap.neighbours.structures import Structures, find_structures
from skinmap.touch.histograms.codebook import Codebook, learn_codebook, patterns
from skinmap.touch.histograms.votes import VoteCounter

# Taxel places in a 12-pad module of side 30 mm, origin at its centre [mm].
PAD_12 = [
    (7.5, -1.443), (10, -5.774), (5, -5.774), (0, -2.887), (-5, -5.774), (-10, -5.774),
    (-7.5, -1.443), (-2.5, 1.443), (-2.5, 7.217), (0, 11.547), (2.5, 7.217), (2.5, 1.443),
]  # fmt: skip
MODULES = 94
BATCH = 200
ONE_RATIOS = {  # of two tasks on one sample
    "numpy_over_literal_loop": ("literal_loop", "numpy"),
    "compiled_over_literal_loop": ("literal_loop", "compiled"),
    "compiled_to_gather": ("compiled", "gather_compiled"),
}
BATCH_RATIOS = {
    "batch_numpy_over_kmeans": ("kmeans_per_structure", "numpy"),
    "batch_compiled_over_kmeans": ("kmeans_per_structure", "compiled"),
}


def tiling() -> np.ndarray:
    """(1128, 3) taxels of a flat tiling of 94 12-pad modules [m]."""
    pad, side = np.array(PAD_12), 30.0
    height = side * np.sqrt(3) / 2
    modules = []
    for i, j in np.ndindex(7, 7):
        corner = np.array([side * (i + 0.5 * j), height * j])
        modules += [pad + corner, -pad + corner + [side / 2, height / 3]]
    flat = np.concatenate(modules[:MODULES]) * 1e-3
    return np.column_stack([flat, np.zeros(len(flat))])


def literal_loop(book: Codebook, structures: Structures, sample: np.ndarray) -> np.ndarray:
    """Algorithm 1 of the first paper: one taxel after another votes for its nearest codeword."""
    votes = np.zeros(book.words.shape[:2], np.int64)
    for taxel, s in enumerate(structures.labels):
        places = structures.neighbours[taxel]
        pattern = np.concatenate([sample[[taxel]], np.where(places >= 0, sample[places], 0.0)])
        distances = np.linalg.norm(book.words[s] - pattern, axis=1)
        votes[s, np.argmin(distances)] += 1
    return votes[:, 1:].ravel()


def draw(points: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Samples (BATCH, n) of 0 to 1 with a share of the taxels active, side by side."""
    samples = rng.random((BATCH, len(points)))
    if share == 1.0:
        return np.maximum(samples, 0.05)
    active = max(1, round(share * len(points)))
    for sample in samples:
        gap = np.linalg.norm(points - points[rng.integers(len(points))], axis=1)
        sample[np.argsort(gap)[active:]] = 0.0
    return samples


def gather_kernel() -> Any:
    """The neighbour gather alone, compiled: what any histogram has to do at least."""
    from numba import njit

    @njit
    def gather(sample: Any, index: Any, out: Any) -> None:
        for a in range(index.shape[0]):
            for i in range(index.shape[1]):
                out[a, i] = sample[index[a, i]]

    return gather


def histogram_row(rotations: int, share: float, rounds: int) -> dict[str, Any]:
    """One sample and a batch, all ways, on the 1,128 taxels of the tiling."""
    rng = np.random.default_rng(0)
    points = tiling()
    up, across = np.tile([0.0, 0, 1], (len(points), 1)), np.tile([0.0, 1, 0], (len(points), 1))
    structures = find_structures(
        neighbourhoods(points, up, across, radius=8e-3), rotations=rotations
    )
    book = learn_codebook([(structures, draw(points, 1.0, rng))], rng=rng)
    samples = draw(points, share, rng)
    plain = VoteCounter(book, structures, compiled=False)
    fast = VoteCounter(book, structures, compiled=True)
    sample, padded = samples[0], np.append(samples[0], 0.0)
    order = plain.index[:-1].T.copy()
    gathered, gather = np.empty(order.shape), gather_kernel()
    machines = [k_means(words) for words in book.words]
    shapes = range(len(book.words))
    width = book.words.shape[2]

    def predict() -> list[np.ndarray]:
        seen = (patterns(structures, s, samples).reshape(-1, width) for s in shapes)
        return [machine.predict(x) for machine, x in zip(machines, seen, strict=True)]

    one_times = take_turns(
        {
            "literal_loop": (lambda: literal_loop(book, structures, sample), 1),
            "numpy": (lambda: plain.count_one(sample), 50),
            "compiled": (lambda: fast.count_one(sample), 200),
            "gather_compiled": (lambda: gather(padded, order, gathered), 200),
        },
        rounds,
    )
    batch_times = take_turns(
        {
            "kmeans_per_structure": (predict, 1),
            "numpy": (lambda: plain.count(samples), 1),
            "compiled": (lambda: fast.count(samples), 2),
        },
        rounds,
    )
    one, batch = medians(one_times, 1e6), medians(batch_times, 1e6 / BATCH)
    ratios = ratio_quartiles(one_times, ONE_RATIOS) | ratio_quartiles(batch_times, BATCH_RATIOS)
    wrong = _different_votes(plain, fast, book, structures, samples)
    return {
        "taxels": len(points),
        "structures": len(book.words),
        "rotations": rotations,
        "active_share": share,
        "one_sample_us": one,
        "batch_us_per_sample": batch,
        "one_sample_quartiles_us": spreads(one_times, 1e6),
        "batch_quartiles_us_per_sample": spreads(batch_times, 1e6 / BATCH),
        "votes_that_differ": wrong,
        "ratio_quartiles": ratios,
        "ratios": {name: middle for name, (_, middle, _) in ratios.items()},
    }


def k_means(words: np.ndarray) -> KMeans:
    """scikit-learn's k-means with given centres."""
    machine = KMeans(len(words), n_init=1, max_iter=1, init=words, random_state=0).fit(words)
    machine.cluster_centers_ = np.ascontiguousarray(words)
    return machine


def _different_votes(
    plain: VoteCounter,
    fast: VoteCounter,
    book: Codebook,
    structures: Structures,
    samples: np.ndarray,
) -> int:
    """Votes in which any of our ways differs from the literal loop, over twenty samples."""
    some = samples[:20]
    loop = np.array([literal_loop(book, structures, sample) for sample in some])
    ways = (plain.count(some), fast.count(some), np.array([plain.count_one(x) for x in some]))
    return int(sum(np.abs(way - loop).sum() for way in ways))

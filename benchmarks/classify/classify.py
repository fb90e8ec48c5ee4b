"""Speed of the classification of touches: `make bench-classify` (ARGS=--quick for a glance).

Every figure is CPU time of one thread, the median of turns that we and the peers take; ratios are
the peer's time over ours. Results go to benchmarks/results/classify.json.

Histograms are of 1,128 taxels: ours, the loop of Algorithm 1 and scikit-learn's k-means.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.cluster import KMeans
from sklearn.svm import SVC

from benchmarks.geometry.structures import structure_rows
from benchmarks.harness.record import command
from benchmarks.harness.timing import medians, ratio_quartiles, spreads, take_turns
from benchmarks.live.live_speed import live_rows
from skinmap.neighbours.offsets import neighbourhoods
from skinmap.neighbours.structures import Structures, find_structures
from skinmap.recognition.histograms.additive import intersection_function
from skinmap.recognition.histograms.intersection import IntersectionSVC, intersection_kernel
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


SHARES = ((1, 1.0), (1, 0.03), (6, 1.0), (6, 0.03))  # rotations, share of the taxels active
ROUNDS = 15
TRAIN, TEST = 2500, 2000
BLOCK = 2**22  # numbers at a time in the plain kernel
RATIOS = {  # of two tasks on all samples
    "numpy": ("scikit_learn", "numpy"),
    "compiled": ("scikit_learn", "compiled"),
}
SINGLE_RATIOS = {  # on one
    "one_sample_numpy": ("scikit_learn", "numpy"),
    "one_sample_compiled": ("scikit_learn", "compiled"),
}


def measure(quick: bool, *, rounds: int = ROUNDS, seeds: int = 5) -> dict[str, Any]:
    """Rows of histograms, SVM, one sample to its labels, and structures.

    Parameters
    ----------
    quick : bool
        Small sizes, few turns, no structures.
    rounds : int
        Turns that we and the peers take.
    seeds : int
        Noises that each structure is found under.
    """
    rounds = 3 if quick else rounds
    return {
        "histogram": [
            histogram_row(rotations, share, rounds)
            for rotations, share in (SHARES[2:] if quick else SHARES)
        ],
        "intersection_svm": [svm_row(real, quick, rounds) for real in (False, True)],
        "sample_to_labels": live_rows(quick),
        "structures": [] if quick else structure_rows(seeds=seeds),
    }


def sum_of_minima(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The kernel as it is written down: what a user of scikit-learn passes it."""
    kernel = np.empty((len(a), len(b)))
    step = max(1, BLOCK // b.size)
    for start in range(0, len(a), step):
        block = a[start : start + step]
        kernel[start : start + step] = np.minimum(block[:, None], b[None]).sum(axis=2)
    return kernel


def svm_row(real: bool, quick: bool, rounds: int) -> dict[str, Any]:
    """Decision values of 2,000 histograms and of one, four classes."""
    rng = np.random.default_rng(1)
    train, test = (500, 200) if quick else (TRAIN, TEST)
    mean = rng.gamma(0.4, 6.0, (4, 64))
    # Classes overlap on purpose: about a thousand support vectors are left.
    mean = 0.845 * mean.mean(axis=0) + 0.155 * mean
    labels = np.arange(train) % 4
    x = rng.poisson(mean[labels]).astype(float)
    z = rng.poisson(mean[np.arange(test) % 4]).astype(float)
    if real:
        x, z = x + rng.random(x.shape) * (x > 0), z + rng.random(z.shape) * (z > 0)
    ours = IntersectionSVC().fit(x, labels)
    gram = intersection_kernel(x, x) / ours.scale_
    svc = SVC(kernel="precomputed", C=ours.C).fit(gram, labels)
    support = x[svc.support_]

    def peer(rows: np.ndarray) -> np.ndarray:
        kernel = np.zeros((len(rows), len(x)))  # only the support columns are ever read
        kernel[:, svc.support_] = sum_of_minima(rows, support) / ours.scale_
        return svc.decision_function(kernel)

    parts = (ours.support_histograms_, ours.coefficients_, ours.intercept_)
    plain, fast = intersection_function(*parts), intersection_function(*parts)
    compiled = fast.compile()
    one = z[:1]
    many_times = take_turns(
        {
            "scikit_learn": (lambda: peer(z), 1),
            "numpy": (lambda: plain(z), 2),
            "compiled": (lambda: fast(z), 5),
        },
        rounds,
    )
    single_times = take_turns(
        {
            "scikit_learn": (lambda: peer(one), 5),
            "numpy": (lambda: plain(one), 100),
            "compiled": (lambda: fast(one), 200),
        },
        rounds,
    )
    many, single = medians(many_times, 1e6), medians(single_times, 1e6)
    ratios = ratio_quartiles(many_times, RATIOS) | ratio_quartiles(single_times, SINGLE_RATIOS)
    gap = np.abs(ours.decision_function(z) - peer(z)).max()
    return {
        "counts": "real" if real else "whole",
        "samples": test,
        "bins": x.shape[1],
        "support_vectors": len(support),
        "compiled": compiled,
        "samples_us": many,
        "one_sample_us": single,
        "samples_quartiles_us": spreads(many_times, 1e6),
        "one_sample_quartiles_us": spreads(single_times, 1e6),
        "largest_difference": float(gap),
        "labels_that_differ": int((ours.predict(z) != _labels(svc, z, support, ours, x)).sum()),
        "ratio_quartiles": ratios,
        "ratios": {name: middle for name, (_, middle, _) in ratios.items()},
    }


def _labels(svc: SVC, z: Any, support: Any, ours: IntersectionSVC, x: Any) -> np.ndarray:
    kernel = np.zeros((len(z), len(x)))
    kernel[:, svc.support_] = intersection_kernel(z, support) / ours.scale_
    return np.asarray(svc.predict(kernel))


if __name__ == "__main__":
    command(measure, __doc__, "classify")

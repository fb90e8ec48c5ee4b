"""Speed of the classification of touches: `make bench-classify` (ARGS=--quick for a glance).

Every figure is CPU time of one thread, the median of turns that we and the peers take; ratios are
the peer's time over ours. Results go to benchmarks/results/classify.json.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.svm import SVC

from benchmarks.classify.histogram_speed import histogram_row
from benchmarks.geometry.structures import structure_rows
from benchmarks.harness.record import command
from benchmarks.harness.timing import medians, ratio_quartiles, spreads, take_turns
from benchmarks.live.live_speed import live_rows
from skinmap.recognition.histograms.additive import intersection_function
from skinmap.recognition.histograms.intersection import IntersectionSVC, intersection_kernel

SHARES = ((1, 1.0), (1, 0.03), (6, 1.0), (6, 0.03))  # rotations, share of the taxels active
ROUNDS = 15
TRAIN, TEST = 2500, 2000
BLOCK = 2**22  # numbers at a time in the plain kernel
RATIOS = {  # of two tasks on all samples
    "numpy": ("scikit_learn", "numpy"),
    "compiled": ("scikit_learn", "compiled"),
}
ONE_RATIOS = {  # on one
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
    ratios = ratio_quartiles(many_times, RATIOS) | ratio_quartiles(single_times, ONE_RATIOS)
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

"""Speed of the classification of touches: `make bench-classify` (ARGS=--quick for a glance).

Every figure is CPU time of one thread, the median of turns that we and the peers take; ratios are
the peer's time over ours. Results go to benchmarks/results/classify.json.
"""

from __future__ import annotations

from typing import Any

from benchmarks.classify.histogram_speed import histogram_row
from benchmarks.classify.svm_speed import svm_row
from benchmarks.geometry.structures import structure_rows
from benchmarks.harness.record import command
from benchmarks.live.live_speed import live_rows

SHARES = ((1, 1.0), (1, 0.03), (6, 1.0), (6, 0.03))  # rotations, share of the taxels active
ROUNDS = 15


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


if __name__ == "__main__":
    command(measure, __doc__, "classify")

"""How fast this machine is at the moment: the CPU time of a fixed piece of work.

CPU time is no constant of a program: other processes on the same cores take the caches, the
sibling thread and the clock, and the same work then costs twice as much. A fixed piece of work
measured beside every run says how much, so that runs at different moments can be compared.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np

CALLS = 3
SIDE = 24  # of the grid whose Laplacian is factorised
WORDS = 4000  # counted one by one, as Python does


def pace_seconds() -> float:
    """CPU time of the fixed piece of work, the least of a few calls."""
    return min(_timed() for _ in range(CALLS))


def _timed() -> float:
    grid, points = _fixed()
    started = time.process_time()
    _work(grid, points)
    return time.process_time() - started


def _work(grid: Any, points: Any) -> float:
    """What the tasks are made of: interpreted loops, small arrays, a sparse factorisation."""
    from scipy.sparse.linalg import splu

    counts: dict[int, int] = {}
    for number in range(WORDS):
        counts[number % 97] = counts.get(number % 97, 0) + number
    found = 0.0
    for start in range(0, len(points) - 400, 100):
        part = points[start : start + 400]
        order = np.argsort(part[:, 0])
        found += float(np.linalg.norm(part[order] - part, axis=1).sum())
    solution = splu(grid).solve(points[: grid.shape[0]])
    return found + float(np.sort(solution, axis=0)[0, 0]) + counts[0]


@cache
def _fixed() -> tuple[Any, Any]:
    """A grid's Laplacian and points, always the same."""
    from scipy.sparse import csc_array, diags_array, eye_array, kron

    line = diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(SIDE, SIDE))
    one = eye_array(SIDE)
    grid = csc_array(kron(line, one) + kron(one, line) + 0.1 * eye_array(SIDE * SIDE))
    points = np.random.default_rng(0).random((4000, 3))
    return grid, points

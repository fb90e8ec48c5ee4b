"""The compiled loop over taxels that votes are counted with, where numba is installed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.touch.codebook import LARGEST

if TYPE_CHECKING:
    from skinmap.touch.votes import VoteCounter

BLOCK = 64  # taxels that are compared together: a vector unit's width, many times over


def vote_kernel(counter: VoteCounter) -> Callable[[FloatArray, IntArray], bool]:
    """A function that adds the votes of samples (t, n) to votes (t, s, k), where it can.

    It says no where a sample holds something whose square is not finite.

    Raises
    ------
    ImportError
        Without numba.
    """
    loop = _compiled(counter.words.shape[2])
    order = counter.index[:-1]
    index = order.astype(np.uint32)
    reverse, position = _reverse(order, counter.n_taxels)
    start, words, rest = counter.start, np.ascontiguousarray(counter.words), counter.rest

    scale = counter.codebook.scale

    def count(samples: FloatArray, votes: IntArray) -> bool:
        done = loop(samples, scale, index, start, words, rest, reverse, position, votes)
        return bool(done)

    return count


def _reverse(index: IntArray, n_taxels: int) -> tuple[IntArray, IntArray]:
    """Which positions read each taxel: those of taxel i are position[start[i] : start[i + 1]]."""
    read = index.ravel()
    where = np.tile(np.arange(index.shape[1]), len(index))[np.argsort(read, kind="stable")]
    count = np.bincount(read, minlength=n_taxels + 1)[:n_taxels]
    return np.concatenate([[0], np.cumsum(count)]), where


@cache
def _compiled(p: int) -> Any:
    """The loop for patterns of p places: a known number, so that the sum unrolls."""
    from numba import njit

    @njit(cache=True, error_model="numpy")
    def loop(samples, scale, index, start, words, rest, reverse, position, votes):  # type: ignore[no-untyped-def]
        n, m = samples.shape[1], index.shape[1]
        sample = np.zeros(n + 1)  # empty places read the zero behind the last taxel
        seen, best = np.empty((p, BLOCK)), np.empty(BLOCK)
        word = np.empty(BLOCK, np.uint32)
        near, todo = np.zeros(m, np.uint8), np.zeros(m, np.int64)
        for t in range(len(samples)):
            touched = fine = 0
            for i in range(n):
                sample[i] = samples[t, i] * scale
                touched += sample[i] != 0.0
                fine += abs(sample[i]) <= LARGEST
            if fine < n:
                return False
            sparse = touched * p < m // 2
            if sparse:
                near[:] = 0
                for i in range(n):
                    if sample[i] != 0.0:
                        for j in range(reverse[i], reverse[i + 1]):
                            near[position[j]] = 1
            for s in range(len(words)):
                first, last = start[s], start[s + 1]
                if sparse:
                    last = first
                    for a in range(start[s], start[s + 1]):
                        todo[last] = a
                        last += near[a]
                    votes[t, s, rest[s]] += start[s + 1] - last
                while first < last:
                    size = min(BLOCK, last - first)
                    for i in range(p):
                        for b in range(size):
                            a = todo[first + b] if sparse else first + b
                            seen[i, b] = sample[index[i, a]]
                    best[:] = np.inf
                    word[:] = 0
                    for j in range(words.shape[1]):
                        for b in range(size):
                            d = 0.0
                            for i in range(p):
                                step = seen[i, b] - words[s, j, i]
                                d += step * step
                            nearer = d < best[b]
                            best[b] = d if nearer else best[b]
                            word[b] = j if nearer else word[b]
                    for b in range(size):
                        votes[t, s, word[b]] += 1
                    first += size
        return True

    return loop

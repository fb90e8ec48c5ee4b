"""Sums of one function a bin: what an intersection-kernel SVM is, and how it is evaluated fast.

The decision value of the SVM is a sum over bins of sum_i c_i min(h_i, x), which is piecewise
linear in x with a bend at each support value h_i. Sorted support values with running sums give
it exactly for any x, and for whole counts so does a table of its values at 0, 1, 2 and so on.

Maji, Berg and Malik, "Classification using Intersection Kernel Support Vector Machines is
Efficient", CVPR 2008.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.compiled import compile_loop
from skinmap.errors import MissingLibraryError

TABLE = 2**23  # numbers in a table at most (64 MB)
COMPILE = 2_000_000  # bins from which compiling pays by itself

logger = logging.getLogger(__name__)


class AdditiveFunction:
    """q sums over d bins of piecewise linear functions that are constant in the end.

    Parameters
    ----------
    bends : sequence of (u_d,) array of float
        Where each bin's function bends, rising, all above 0; functions are 0 at 0.
    slopes : sequence of (u_d, q) array of float
        Slope of each sum up to each bend.
    intercept : (q,) array of float
    """

    def __init__(
        self,
        bends: Sequence[FloatArray],
        slopes: Sequence[FloatArray],
        intercept: FloatArray,
    ) -> None:
        self.intercept = np.asarray(intercept, np.float64)
        self.start = np.concatenate([[0], np.cumsum([len(bend) for bend in bends])])
        self.bends = np.concatenate([np.zeros(0), *bends])
        self._bends = np.append(self.bends, np.inf)  # what a search behind the last one reads
        # f = base + slope x, before each bend and behind the last: one row more than bends.
        self.slope = np.concatenate(
            [np.vstack([slope, np.zeros(len(self.intercept))]) for slope in slopes]
        )
        self.base = np.concatenate([_bases(b, s) for b, s in zip(bends, slopes, strict=True)])
        self.top = int(self.bends.max(initial=0.0))
        self.rows = self._tabulate()
        self._offset = np.arange(len(bends)) * (self.top + 1)
        self._kernel: Any = None

    def __call__(self, x: FloatArray) -> FloatArray:
        """(n, q) values for x (n, d), none below 0."""
        if self._kernel is None and x.size >= COMPILE:
            self.compile()
        if self._kernel is not None:
            return np.asarray(self._kernel(x))
        if self.rows is not None and bool((x == np.floor(x)).all()):
            return _look_up(self.rows, self._offset, self.top, x) + self.intercept
        if len(x) == 1:
            return self._one(x[0])
        total = np.tile(self.intercept, (len(x), 1))
        for place in range(x.shape[1]):
            total += self._piece(place, x[:, place])
        return total

    def compile(self) -> bool:
        """Use compiled code from now on; whether it can be had (numba)."""
        try:
            self._kernel = _additive_kernel(self)
        except MissingLibraryError:
            logger.info("numba is not installed: decision values are computed by numpy")
        return self._kernel is not None

    def _one(self, x: FloatArray) -> FloatArray:
        """(1, q) values for one x (d,): all bins that are not empty searched at once."""
        place = np.flatnonzero(x)
        value, low, high = x[place], self.start[place], self.start[place + 1]
        for _ in range(int(np.diff(self.start).max(initial=0)).bit_length()):
            middle = (low + high) >> 1
            before = (low < high) & (self._bends[middle] < value)
            low, high = np.where(before, middle + 1, low), np.where(before, high, middle)
        row = low + place
        pieces = self.base[row] + self.slope[row] * value[:, None]
        return np.asarray(self.intercept + pieces.sum(axis=0))[None]

    def _piece(self, place: int, x: FloatArray) -> FloatArray:
        """(n, q) value of one bin's function at x (n,)."""
        first, last = self.start[place], self.start[place + 1]
        row = np.searchsorted(self.bends[first:last], x) + first + place
        return np.asarray(self.base[row] + self.slope[row] * x[:, None])

    def _tabulate(self) -> FloatArray | None:
        """(d * (top + 1), q) values at 0, 1, ... top where all bends are whole and few enough."""
        d, q = len(self.start) - 1, len(self.intercept)
        whole = bool((self.bends == np.floor(self.bends)).all())
        if not whole or d * (self.top + 1) * q > TABLE:
            return None
        counts = np.arange(self.top + 1, dtype=np.float64)
        return np.concatenate([self._piece(place, counts) for place in range(d)])


def intersection_function(
    support: FloatArray, coefficients: FloatArray, intercept: FloatArray
) -> AdditiveFunction:
    """The function x -> coefficients (q, m) @ min-kernel(support (m, d), x) + intercept (q,)."""
    bends: list[FloatArray] = []
    slopes: list[FloatArray] = []
    for values in support.T:
        bend, which = np.unique(values, return_inverse=True)
        weight: FloatArray = np.stack(
            [np.bincount(which, c, len(bend)).astype(np.float64) for c in coefficients], 1
        )
        # Up to a bend, all support values from it on grow with x.
        rest = np.cumsum(weight[::-1], axis=0)[::-1]
        bends.append(np.asarray(bend[bend > 0], np.float64))
        slopes.append(np.asarray(rest[bend > 0], np.float64))
    return AdditiveFunction(bends, slopes, intercept)


def _bases(bends: FloatArray, slopes: FloatArray) -> FloatArray:
    """(u + 1, q) what to add to slope times x on each piece, so that the pieces meet."""
    drop = slopes - np.vstack([slopes[1:], np.zeros((min(1, len(slopes)), slopes.shape[1]))])
    steps = np.cumsum(drop * bends[:, None], axis=0)
    return np.vstack([np.zeros((1, slopes.shape[1])), steps])


def _look_up(rows: FloatArray, offset: IntArray, top: int, x: FloatArray) -> FloatArray:
    """(n, q) sums of table rows for whole counts (n, d); empty bins add nothing."""
    if len(x) == 1:
        count = np.minimum(x[0], top).astype(np.int64)
        return rows.take(count + offset, axis=0).sum(axis=0, keepdims=True)
    row, place = np.nonzero(x)
    column = np.minimum(x[row, place], top).astype(np.int64) + offset[place]
    start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(x)))])
    ones = csr_array((np.ones(len(row)), column, start), shape=(len(x), len(rows)))
    return np.asarray(ones @ rows)


def _additive_kernel(function: AdditiveFunction) -> Callable[[FloatArray], FloatArray]:
    """A function that gives the values (n, q) of x (n, d).

    Raises
    ------
    MissingLibraryError
        Without numba.
    """
    loop = _compiled(len(function.intercept))
    none = np.zeros((0, len(function.intercept)))
    rows = none if function.rows is None else function.rows
    tables = (function.start, function.bends, function.base, function.slope, rows)
    top, intercept = function.top, function.intercept

    def values(x: FloatArray) -> FloatArray:
        return np.asarray(loop(x, *tables, top, intercept))

    return values


@cache
def _compiled(q: int) -> Any:
    """The loop for q sums: a known number, so that the innermost loops unroll."""

    def loop(x, start, bends, base, slope, rows, top, intercept):  # type: ignore[no-untyped-def]
        total = np.empty((x.shape[0], q))
        for t in range(x.shape[0]):
            for i in range(q):
                total[t, i] = intercept[i]
            for place in range(x.shape[1]):
                value = x[t, place]
                if value == 0.0:
                    continue
                if len(rows) and value == np.floor(value):
                    row = place * (top + 1) + int(min(value, float(top)))
                    for i in range(q):
                        total[t, i] += rows[row, i]
                    continue
                low, high = start[place], start[place + 1]
                while low < high:
                    middle = (low + high) // 2
                    if bends[middle] < value:
                        low = middle + 1
                    else:
                        high = middle
                for i in range(q):
                    total[t, i] += base[low + place, i] + slope[low + place, i] * value
        return total

    return compile_loop(loop, error_model="numpy")

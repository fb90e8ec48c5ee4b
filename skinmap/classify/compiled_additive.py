"""The compiled loop over bins that decision values are summed with, where numba is installed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from skinmap.arrays import FloatArray

if TYPE_CHECKING:
    from skinmap.classify.additive import AdditiveFunction


def additive_kernel(function: AdditiveFunction) -> Callable[[FloatArray], FloatArray]:
    """A function that gives the values (n, q) of x (n, d).

    Raises
    ------
    ImportError
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
    from numba import njit

    @njit(cache=True, error_model="numpy")
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

    return loop

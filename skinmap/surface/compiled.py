"""The two hot loops of meshing as they are compiled."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.numba_loops import Loop, pays
from skinmap.numba_loops import compiled as compiled_loop

PAYS = 100_000  # taxels: below, the import of numba (over 1 s) costs more than it saves


def star_kernel(n: int, compiled: bool | None = None) -> Loop | None:
    """Compiled stars for a chunk of n points; None for the plain ones, by default by what pays."""
    return compiled_loop(_stars) if (pays(n, PAYS) if compiled is None else compiled) else None


def take_kernel(n: int, compiled: bool | None = None) -> Loop | None:
    """Compiled `take_in_turn` for n points; None for the plain one, by default by what pays."""
    return compiled_loop(_take) if (pays(n, PAYS) if compiled is None else compiled) else None


def _take(numbers: IntArray) -> BoolArray:
    """(t,) whether each triangle is taken, first come first served by its edges (t, 3)."""
    free = np.ones(numbers.max() + 1 if numbers.size else 0, np.bool_)
    taken = np.zeros(len(numbers), np.bool_)
    for row in range(len(numbers)):
        a, b, c = numbers[row]
        if free[a] and free[b] and free[c]:
            free[a] = free[b] = free[c] = False
            taken[row] = True
    return taken


def _stars(
    points: FloatArray,
    first: FloatArray,
    second: FloatArray,
    rows: IntArray,
    index: IntArray,
    distance: FloatArray,
    limit: FloatArray,
) -> IntArray:
    """Votes (t, 3) of points rows (r,) with tangent axes (r, 3) and neighbours (r, k)."""
    k = index.shape[1]
    x, y, who = np.zeros(k), np.zeros(k), np.zeros(k, np.int64)
    votes = np.empty((rows.size * k, 3), np.int64)
    count = 0
    for row in range(rows.size):
        centre = points[rows[row]]
        size = 0.0
        near = 0
        for i in range(k):
            far = distance[row, i]
            if far == np.inf or far == 0.0:
                continue
            u, v = 0.0, 0.0
            for axis in range(3):
                offset = points[index[row, i], axis] - centre[axis]
                u += offset * first[row, axis]
                v += offset * second[row, axis]
            shadow = np.sqrt(u * u + v * v)
            stretch = 1.0 / (far * shadow) if shadow > 0.0 else 0.0
            x[near], y[near] = u * stretch, v * stretch
            size = max(size, abs(x[near]), abs(y[near]))
            who[near] = index[row, i]
            near += 1
        tiny = 1e-12 * size * size
        for i in range(near):
            best, step = -np.inf, -1
            for j in range(near):
                turn = x[i] * y[j] - y[i] * x[j]
                if turn > tiny:
                    along = (x[i] * x[j] + y[i] * y[j] - (x[i] * x[i] + y[i] * y[i])) / turn
                    if along > best:
                        best, step = along, j
            if step < 0:
                continue
            dx, dy = x[step] - x[i], y[step] - y[i]
            level = dx * y[i] - dy * x[i] - tiny
            inside = level <= 0.0
            for j in range(near):
                if dx * y[j] - dy * x[j] < level:
                    inside = False
                    break
            if not inside:
                continue
            chord = 0.0
            for axis in range(3):
                chord += (points[who[i], axis] - points[who[step], axis]) ** 2
            if chord <= min(limit[who[i]], limit[who[step]]) ** 2:
                votes[count, 0] = rows[row]
                votes[count, 1] = who[i]
                votes[count, 2] = who[step]
                count += 1
    return votes[:count].copy()

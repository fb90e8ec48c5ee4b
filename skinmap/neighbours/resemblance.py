"""How much neighbourhoods resemble prototypes where none of them matches within the tolerance.

The distance of a neighbourhood from a prototype is the mean, over the points of both, of the
distance to the nearest point of the other, cut off at twice the tolerance (under half a pitch,
where another taxel's place begins). It says something at any noise and any radius.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.rigid import plane_turns
from skinmap.neighbours.matching import Prototypes, as_prototypes
from skinmap.neighbours.offsets import Neighbourhoods

CUT = 2.0  # in tolerances: distances beyond are all the same
ALIKE = 4.0 / 3.0  # in tolerances: neighbourhoods of one structure; 2 mm, where noise of 1 to 2 mm
# kept the most accuracy on the hand of `kaspar` (1.5 to 2.25 mm were tried)
NEAREST = 24  # neighbours that are compared: all of them at the usual radius
ROWS = 4096  # neighbourhoods compared at a time
CANDIDATES, COLUMNS = 96, 512  # neighbourhoods that may become shapes at a time, and that count


def most_alike(
    hoods: Neighbourhoods, rows: IntArray, shapes: Prototypes
) -> tuple[IntArray, IntArray, IntArray]:
    """Nearest prototype of some taxels, its rotation (r,), and neighbours in its places (r, k).

    A place holds the nearest neighbour within the cut, or -1.
    """
    best = np.full(len(rows), np.inf)
    label, turn = np.zeros(len(rows), np.int64), np.zeros(len(rows), np.int64)
    for s, step, apart in _apart(hoods, rows, shapes):
        better = apart < best
        best[better], label[better], turn[better] = apart[better], s, step
    neighbours = np.full((len(rows), shapes.offsets.shape[1]), -1)
    own, index, filled = _nearest(hoods.offsets[rows], hoods.filled[rows], hoods.index[rows])
    for s, step in np.unique(np.column_stack([label, turn]), axis=0):
        at = np.flatnonzero((label == s) & (turn == step))
        places = _turned(shapes, s, step)
        for some in _portions(at, len(places)):
            gap = _gaps(own[some], filled[some], places)
            nearest = gap.argmin(axis=2)
            close = gap.min(axis=2) <= (CUT * shapes.tolerance) ** 2
            taken = np.take_along_axis(index[some], nearest, 1)
            columns = np.flatnonzero(shapes.filled[s])
            neighbours[np.ix_(some, columns)] = np.where(close, taken, -1)
    return label, turn, neighbours


def cover_resembling(
    hoods: Neighbourhoods, rows: IntArray, none: Prototypes, *, most: int
) -> Prototypes:
    """At most so many prototypes that all of some taxels resemble: those that most do, first."""
    shapes, left = none, rows
    while len(left) and len(shapes) < most:
        candidates = left[_spread(len(left), CANDIDATES)]
        pool = as_prototypes(hoods, candidates, tolerance=none.tolerance, rotations=none.rotations)
        columns = np.union1d(left[_spread(len(left), COLUMNS)], candidates)
        apart = np.full((len(columns), len(pool)), np.inf)
        for s, _, distance in _apart(hoods, columns, pool):
            apart[:, s] = np.minimum(apart[:, s], distance)
        alike, free = apart <= ALIKE * none.tolerance, np.ones(len(columns))
        chosen: list[int] = []
        while free.any() and len(shapes) + len(chosen) < most:
            gain = free @ alike
            if gain.max() == 0:
                break
            chosen.append(int(gain.argmax()))
            free[alike[:, chosen[-1]]] = 0.0
        new = pool.take(np.array(chosen))
        shapes = shapes.joined(new)
        lowest = np.full(len(left), np.inf)
        for _, _, distance in _apart(hoods, left, new):
            lowest = np.minimum(lowest, distance)
        left = left[lowest > ALIKE * none.tolerance]
    return shapes


def _apart(
    hoods: Neighbourhoods, rows: IntArray, shapes: Prototypes
) -> Iterator[tuple[int, int, FloatArray]]:
    """Distance (r,) [m] of some taxels from each prototype in each of its rotations."""
    offsets, _, filled = _nearest(hoods.offsets[rows], hoods.filled[rows], hoods.index[rows])
    limit = CUT * shapes.tolerance
    for s in range(len(shapes)):
        for step in range(shapes.rotations):
            places = _turned(shapes, s, step)
            if len(places) > NEAREST:
                places = places[np.sort(np.argsort((places**2).sum(axis=1))[:NEAREST])]
            apart = np.zeros(len(rows))
            for some in _portions(np.arange(len(rows)), len(places)):
                gap = _gaps(offsets[some], filled[some], places)
                forth = np.minimum(np.sqrt(gap.min(axis=2, initial=np.inf)), limit)
                back = np.minimum(np.sqrt(gap.min(axis=1, initial=np.inf)), limit) * filled[some]
                number = len(places) + filled[some].sum(axis=1)
                apart[some] = (forth.sum(axis=1) + back.sum(axis=1)) / np.maximum(number, 1)
            yield s, step, apart


def _gaps(offsets: FloatArray, filled: BoolArray, places: FloatArray) -> FloatArray:
    """(r, p, k) squared distances of neighbours (r, k) from places (p, 2); inf for none."""
    across = offsets[:, None, :, 0] - places[None, :, None, 0]
    along = offsets[:, None, :, 1] - places[None, :, None, 1]
    return np.where(filled[:, None], across**2 + along**2, np.inf)


def _turned(shapes: Prototypes, s: int, step: int) -> FloatArray:
    """Places (p, 2) of a prototype in one of its rotations."""
    turn = plane_turns(2.0 * np.pi * step / shapes.rotations)
    return np.asarray((shapes.offsets[s] @ turn.T)[shapes.filled[s]])


def _nearest(
    offsets: FloatArray, filled: BoolArray, index: IntArray
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Offsets, taxels and what is filled of the nearest points of neighbourhoods (r, k)."""
    if offsets.shape[1] <= NEAREST:
        return offsets, index, filled
    length = np.where(filled, (offsets**2).sum(axis=2), np.inf)
    order = np.sort(np.argsort(length, axis=1, kind="stable")[:, :NEAREST], axis=1)
    near = np.take_along_axis(offsets, order[..., None], 1)
    return near, np.take_along_axis(index, order, 1), np.take_along_axis(filled, order, 1)


def _portions(rows: IntArray, places: int) -> Iterator[IntArray]:
    """Rows, so many at a time that their distances from places stay small."""
    step = max(1, ROWS * NEAREST // max(places, 1))
    for start in range(0, len(rows), step):
        yield rows[start : start + step]


def _spread(n: int, most: int) -> IntArray:
    """At most so many of n rows, evenly taken."""
    return np.arange(n) if n <= most else (np.arange(most) * n) // most

"""Taxels whose neighbourhood matches no learnt structure: the nearest structure there is."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.tangents import plane_turns
from skinmap.neighbours.offsets import Neighbourhoods
from skinmap.neighbours.structures import Prototypes, Structures


def adopt_nearest(hoods: Neighbourhoods, found: Structures) -> Structures:
    """Structures in which taxels of none (-1) take the nearest prototype.

    The distance of a neighbourhood from a prototype is the mean, over the points of both, of
    the distance to the nearest point of the other, cut off at twice the tolerance (under half
    a pitch, where another taxel's place begins). Places without a neighbour within that read
    as rest. Taxels without neighbours stay without structure.
    """
    shapes = found.prototypes
    strangers = np.flatnonzero((found.labels < 0) & hoods.filled.any(axis=1))
    if len(strangers) == 0 or len(shapes) == 0:
        return found
    limit = 2.0 * shapes.tolerance
    best = np.full(len(strangers), np.inf)
    labels, rotation = found.labels.copy(), found.rotation.copy()
    neighbours = found.neighbours.copy()
    for s in range(len(shapes)):
        for step in range(shapes.rotations):
            cost, places = _distance(hoods, strangers, shapes, s, step, limit)
            better = cost < best
            chosen = strangers[better]
            best[better], labels[chosen], rotation[chosen] = cost[better], s, step
            neighbours[chosen] = places[better]
    return Structures(shapes, labels, neighbours, rotation)


def _distance(
    hoods: Neighbourhoods, rows: IntArray, shapes: Prototypes, s: int, step: int, limit: float
) -> tuple[FloatArray, IntArray]:
    """Distance (r,) of some taxels from a turned prototype, and the neighbour in each place."""
    turn = plane_turns(2.0 * np.pi * step / shapes.rotations)
    turned, filled = shapes.offsets[s] @ turn.T, shapes.filled[s]
    holds = hoods.filled[rows]
    gap = np.linalg.norm(hoods.offsets[rows][:, None] - turned[None, :, None], axis=3)
    gap = np.where(holds[:, None] & filled[None, :, None], gap, np.inf)
    forth, back = np.minimum(gap.min(axis=2), limit), np.minimum(gap.min(axis=1), limit)
    total = (forth * filled).sum(axis=1) + (back * holds).sum(axis=1)
    nearest = gap.argmin(axis=2)
    close = np.take_along_axis(gap, nearest[..., None], 2)[..., 0] < limit
    index = np.take_along_axis(hoods.index[rows], nearest, 1)
    return total / (filled.sum() + holds.sum(axis=1)), np.where(close, index, -1)

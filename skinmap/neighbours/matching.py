"""Matching of neighbourhoods with prototypes: which place each neighbour takes, at what cost.

A neighbour takes the place that it is nearest to if that place is nearest to it too and both lie
within a reach: a matching is one-to-one by construction, whatever the reach.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.geometry.rigid import plane_turns
from skinmap.neighbours.offsets import Neighbourhoods, ramp
from skinmap.numba_loops import compiled as compiled_loop
from skinmap.numba_loops import pays

ARRAYS = ("offsets", "filled", "required")  # of prototypes


@dataclass(frozen=True, eq=False, slots=True)
class Prototypes(Frozen):
    """The shapes of s structures, padded to k places.

    Attributes
    ----------
    offsets : (s, k, 2) float
        Clockwise from twelve o'clock [m].
    filled, required : (s, k) bool
        Which places hold a point (the first ones), and which of those every member must have.
    tolerance : float
        [m].
    rotations : int
        Rotations that a member may have: 1 or the symmetry of the lattice.
    """

    offsets: FloatArray
    filled: BoolArray
    required: BoolArray
    tolerance: float
    rotations: int

    def __len__(self) -> int:
        return len(self.offsets)

    def take(self, chosen: IntArray) -> Prototypes:
        """Some of the prototypes, in the order asked for."""
        arrays: dict[str, Any] = {name: getattr(self, name)[chosen] for name in ARRAYS}
        return replace(self, **arrays)

    def joined(self, other: Prototypes) -> Prototypes:
        """These and others of the same tolerance, rotations and number of places."""
        both: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in ARRAYS
        }
        return replace(self, **both)


def as_prototypes(
    hoods: Neighbourhoods, rows: IntArray, *, tolerance: float, rotations: int
) -> Prototypes:
    """Some neighbourhoods as prototypes, their points clockwise from twelve o'clock."""
    offsets, filled, required = hoods.offsets[rows], hoods.filled[rows], hoods.required[rows]
    return Prototypes(*clockwise(offsets, filled, required), tolerance, rotations)


def clockwise(
    offsets: FloatArray, filled: BoolArray, required: BoolArray
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Places (s, k, 2) with their flags (s, k), clockwise from twelve o'clock, empty ones last."""
    angle = np.mod(np.arctan2(offsets[..., 0], offsets[..., 1]), 2.0 * np.pi)
    order = np.argsort(np.where(filled, angle, np.inf), axis=1, kind="stable")
    filled, required = (np.take_along_axis(one, order, 1) for one in (filled, required))
    return np.take_along_axis(offsets, order[..., None], 1), filled, required


PAYS = 20_000_000  # combinations; below, the import of numba costs more than it saves
TYPICAL = 32  # neighbours; more of them cost far more
LOOKS = 8  # places of wide neighbourhoods that are looked at before all are
CELLS = 13  # cells of the coarse raster along one axis: all of them fit into three words
WORDS = -(-CELLS * CELLS // 64)
TRIPLES = 16384  # neighbourhood, prototype and rotation that are matched at a time
MARGIN = 1e-9  # a cost must be lower by this to count as lower: ties do not hang on rounding


class View:
    """Neighbourhoods made ready to be matched, once for many prototypes.

    Parameters
    ----------
    hoods : Neighbourhoods
    compiled : bool, optional
        Whether numba matches; by default where it is installed and worth its import.

    Attributes
    ----------
    filled : (n, k) bool
    held, needed : (n,) int
        How many neighbours there are, and how many of them must have a place.
    weight : (n, k) float
        What a neighbour without a place costs.
    raster : (n, w) uint64
        A bit for each cell of a coarse raster that holds a neighbour.
    """

    def __init__(self, hoods: Neighbourhoods, compiled: bool | None = None) -> None:
        self.compiled = compiled
        self.hoods, self.filled, self.weight = hoods, hoods.filled, hoods.weight
        self.held, self.needed = self.filled.sum(axis=1), hoods.required.sum(axis=1)
        self.raster = _occupancy(hoods, self.filled)


class Matcher:
    """Prototypes made ready to be matched with neighbourhoods of one radius.

    Parameters
    ----------
    shapes : Prototypes
    hoods : Neighbourhoods
        Of that radius.
    reach : float
        Between points that match [m].

    Attributes
    ----------
    offsets : (s, t, k, 2) float
        Places of each prototype in each of its rotations [m].
    count, needed : (s,) int
        How many places hold a point, and how many of them every member must have.
    required : (s, k) bool
    weight : (s, k) float
        What a place that stays empty costs.
    masks : (s, t, k, w) uint64
        Cells of the raster that a neighbour within reach of a place may lie in.
    """

    def __init__(self, shapes: Prototypes, hoods: Neighbourhoods, *, reach: float) -> None:
        turns = np.arange(shapes.rotations, dtype=np.float64) * (2.0 * np.pi / shapes.rotations)
        turned = np.einsum("ski,tji->stkj", shapes.offsets, plane_turns(turns))
        self.offsets = np.ascontiguousarray(turned)
        self.required = shapes.required & shapes.filled
        self.count, self.needed = shapes.filled.sum(axis=1), self.required.sum(axis=1)
        length = np.linalg.norm(shapes.offsets, axis=2)
        weight = np.where(shapes.filled, ramp(length, hoods.radius, hoods.band), 0.0)
        self.weight = np.where(shapes.required, 1.0, weight)
        self.masks, self.reach = _masks(turned, hoods.radius + hoods.band, reach), reach


def match_costs(
    seen: View, rows: IntArray, ready: Matcher
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Cost, mean squared stray and best rotation (r, s) of some neighbourhoods by prototype.

    The cost is the mean squared distance of matched points in reaches, plus the weight of each
    point left alone; inf where a required point has no partner. The stray is in m2.

    Parameters
    ----------
    seen : View
    rows : (r,) int
        Neighbourhoods to match.
    ready : Matcher
    """
    shape = (len(rows), len(ready.count))
    cost, stray = np.full(shape, np.inf), np.full(shape, np.inf)
    turn = np.zeros(shape, np.int64)
    if 0 in shape:
        return cost, stray, turn
    combinations = len(rows) * len(ready.count) * ready.offsets.shape[1]
    combinations *= max(1, seen.filled.shape[1] // TYPICAL) ** 3
    compiled = pays(combinations, PAYS) if seen.compiled is None else seen.compiled
    kernel = compiled_loop(_match) if compiled else None
    if kernel is not None:
        kernel(
            rows, seen.hoods.offsets, seen.held, seen.needed, seen.hoods.required,
            seen.weight, seen.raster, ready.offsets, ready.count, ready.needed, ready.required,
            ready.weight, ready.masks, ready.reach**2, MARGIN, cost, stray, turn,
        )  # fmt: skip
        return cost, stray, turn
    for local, s, t in _passing(seen, rows, ready):
        total, mean, _ = pairing(seen, rows[local], ready, s, t)
        for step in range(ready.offsets.shape[1]):  # one after the other: ties keep the first
            now = np.flatnonzero(t == step)
            better = now[total[now] < cost[local[now], s[now]] - MARGIN]
            at = local[better], s[better]
            cost[at], stray[at], turn[at] = total[better], mean[better], step
    return cost, stray, turn


def pairing(
    seen: View, rows: IntArray, ready: Matcher, s: IntArray, t: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Cost (r,), mean squared stray (r,) and place of a neighbour in each place (r, k), or -1."""
    filled, must = seen.filled[rows], seen.hoods.required[rows]
    places = np.arange(ready.offsets.shape[2]) < ready.count[s][:, None]
    gap = ((seen.hoods.offsets[rows][:, None] - ready.offsets[s, t][:, :, None]) ** 2).sum(axis=3)
    gap = np.where(filled[:, None] & places[:, :, None], gap, np.inf)
    partner, place = gap.argmin(axis=2), gap.argmin(axis=1)
    distance = np.take_along_axis(gap, partner[..., None], 2)[..., 0]
    mutual = np.take_along_axis(place, partner, 1) == np.arange(gap.shape[1])
    found = mutual & (distance <= ready.reach**2)
    row, at = np.nonzero(found)
    taken = np.zeros(filled.shape, bool)
    taken[row, partner[row, at]] = True
    fits = (found | ~ready.required[s]).all(axis=1) & (taken | ~must).all(axis=1)
    number = found.sum(axis=1)
    mean = np.where(found, distance, 0.0).sum(axis=1) / np.maximum(number, 1)
    alone = np.where(places & ~found, ready.weight[s], 0.0).sum(axis=1)
    alone = alone + np.where(filled & ~taken, seen.weight[rows], 0.0).sum(axis=1)
    cost = np.where(fits, mean / ready.reach**2 + alone, np.inf)
    return cost, np.where(fits, mean, np.inf), np.where(found, partner, -1)


def _occupancy(hoods: Neighbourhoods, filled: BoolArray) -> np.ndarray:
    size = _cell(hoods.radius + hoods.band)
    cell = np.floor(hoods.offsets / size + 0.5 * CELLS).astype(np.int64)
    bit = np.clip(cell[..., 0], 0, CELLS - 1) * CELLS + np.clip(cell[..., 1], 0, CELLS - 1)
    raster = np.zeros((len(hoods), WORDS), np.uint64)
    row, place = np.nonzero(filled)
    bit = bit[row, place]
    np.bitwise_or.at(raster, (row, bit // 64), np.uint64(1) << (bit % 64).astype(np.uint64))
    return raster


def _cell(extent: float) -> float:
    return 2.0 * extent / CELLS * 1.0001  # a neighbour at the very rim lies inside


def _masks(turned: FloatArray, extent: float, reach: float) -> np.ndarray:
    """(s, t, k, w) uint64 cells that points within reach of each place may lie in."""
    size = _cell(extent)
    low = (np.arange(CELLS) - 0.5 * CELLS) * size
    near = np.clip(turned[..., None], low, low + size)  # the nearest point of each strip of cells
    squared = (near - turned[..., None]) ** 2
    # Outermost cells hold whatever lies beyond the raster.
    inside = squared[..., 0, :, None] + squared[..., 1, None, :] <= (reach * 1.0001) ** 2
    bits = inside.reshape(*turned.shape[:3], CELLS * CELLS)
    pad = np.zeros((*turned.shape[:3], WORDS * 64 - CELLS * CELLS), bool)
    grouped = np.concatenate([bits, pad], axis=-1).reshape(*turned.shape[:3], WORDS, 64)
    powers = np.uint64(1) << np.arange(64, dtype=np.uint64)
    return np.where(grouped, powers, np.uint64(0)).sum(axis=-1, dtype=np.uint64)


Triples = tuple[IntArray, IntArray, IntArray]


def _passing(seen: View, rows: IntArray, ready: Matcher) -> Iterator[Triples]:
    """Batches of (row, prototype, rotation) of which the raster does not exclude a match."""
    held, must = seen.held[rows], seen.needed[rows]
    words = np.ascontiguousarray(seen.raster[rows].T)
    batch: list[tuple[IntArray, int, int]] = []
    width, size = seen.filled.shape[1], 0
    # Pairings of wide neighbourhoods cost much, so a few places are looked at before.
    wide, most = width > 2 * TYPICAL, max(1, TRIPLES * TYPICAL**2 // max(width, TYPICAL) ** 2)
    for s in range(len(ready.count)):
        able = np.flatnonzero((must <= ready.count[s]) & (held >= ready.needed[s]))
        for t in range(ready.offsets.shape[1]):
            left = able
            for place in np.flatnonzero(ready.required[s]):
                if len(left) == 0:
                    break
                mask = ready.masks[s, t, place]
                hit = words[0][left] & mask[0]
                for word in range(1, WORDS):
                    hit |= words[word][left] & mask[word]
                left = left[hit != 0]
            for place in np.flatnonzero(ready.required[s])[:: width // LOOKS] if wide else ():
                step = seen.hoods.offsets[rows[left]] - ready.offsets[s, t, place]
                gap = step[..., 0] ** 2 + step[..., 1] ** 2
                near = np.where(seen.filled[rows[left]], gap, np.inf).min(axis=1, initial=np.inf)
                left = left[near <= ready.reach**2]
                if len(left) == 0:
                    break
            if len(left):
                batch.append((left, s, t))
                size += len(left)
            if size >= most:
                yield _joined(batch)
                batch, size = [], 0
    if batch:
        yield _joined(batch)


def _joined(batch: list[tuple[IntArray, int, int]]) -> Triples:
    lengths = [len(rows) for rows, _, _ in batch]
    return (
        np.concatenate([rows for rows, _, _ in batch]),
        np.repeat([s for _, s, _ in batch], lengths),
        np.repeat([t for _, _, t in batch], lengths),
    )


def _match(
    rows: Any, offsets: Any, held: Any, musts: Any, must: Any, alone: Any, raster: Any,
    places: Any, count: Any, needed: Any, required: Any, weight: Any, masks: Any,
    reach2: float, margin: float, cost: Any, stray: Any, turn: Any,
) -> None:  # fmt: skip
    """Fill cost, stray and turn (r, s); the same steps as `pairing`, one by one."""
    width, depth = offsets.shape[1], places.shape[2]
    partner, gap = np.empty(depth, np.int64), np.empty(depth)
    place, near = np.empty(width, np.int64), np.empty(width)
    for line in range(len(rows)):
        r = rows[line]
        for s in range(places.shape[0]):
            if musts[r] > count[s] or held[r] < needed[s]:
                continue
            for t in range(places.shape[1]):
                fits = True
                for p in range(count[s]):
                    if required[s, p]:
                        hit = False
                        for w in range(raster.shape[1]):
                            if raster[r, w] & masks[s, t, p, w]:
                                hit = True
                        if not hit:
                            fits = False
                            break
                if not fits:
                    continue
                for j in range(held[r]):
                    near[j] = np.inf
                    place[j] = 0
                for p in range(count[s]):
                    gap[p] = np.inf
                    partner[p] = 0
                    for j in range(held[r]):
                        x = offsets[r, j, 0] - places[s, t, p, 0]
                        y = offsets[r, j, 1] - places[s, t, p, 1]
                        d = x * x + y * y
                        if d < gap[p]:
                            gap[p], partner[p] = d, j
                        if d < near[j]:
                            near[j], place[j] = d, p
                    if required[s, p] and gap[p] > reach2:
                        fits = False
                        break
                if not fits:
                    continue
                total, lone, number = 0.0, 0.0, 0
                for p in range(count[s]):
                    if gap[p] <= reach2 and place[partner[p]] == p:
                        total += gap[p]
                        number += 1
                    elif required[s, p]:
                        fits = False
                        break
                    else:
                        lone += weight[s, p]
                if not fits:
                    continue
                for j in range(held[r]):
                    p = place[j]
                    if not (near[j] <= reach2 and count[s] > 0 and partner[p] == j):
                        if must[r, j]:
                            fits = False
                            break
                        lone += alone[r, j]
                if not fits:
                    continue
                mean = total / max(number, 1)
                value = mean / reach2 + lone
                if value < cost[line, s] - margin:
                    cost[line, s], stray[line, s], turn[line, s] = value, mean, t

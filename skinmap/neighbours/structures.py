"""Periodic structures: neighbourhood shapes that repeat over a skin.

Two taxels have the same structure when their neighbour offsets agree within a tolerance,
up to a rotation by a multiple of 2 pi / rotations where that is asked for. Neighbours in a
soft band around the radius are optional, so that noise at the radius makes no new structures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray, freeze
from skinmap.errors import InvalidArrayError
from skinmap.neighbours.offsets import Neighbourhoods

TOLERANCE = 1.5e-3  # [m]; under half a pitch, so that matching points are one-to-one
RADIUS = 8.0e-3  # [m]; between the first and the second ring of the known modules


@dataclass(frozen=True, eq=False, slots=True)
class Prototypes:
    """The shapes of s structures, padded to k places.

    Attributes
    ----------
    offsets : (s, k, 2) float
        Clockwise from twelve o'clock [m].
    filled, required : (s, k) bool
        Which places hold a point, and which of those every member must have.
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

    def __post_init__(self) -> None:
        freeze(self, offsets=self.offsets, filled=self.filled, required=self.required)

    def __len__(self) -> int:
        return len(self.offsets)


@dataclass(frozen=True, eq=False, slots=True)
class Structures:
    """Which structure each of n taxels has, and which neighbour fills which place.

    Attributes
    ----------
    prototypes : Prototypes
    labels : (n,) int
        Structure of each taxel, the most common first; -1 for none.
    neighbours : (n, k) int
        Taxel in each place of the taxel's prototype, so in its order; -1 for none.
    rotation : (n,) int
        How many steps of 2 pi / rotations the taxel is turned against its prototype.
    """

    prototypes: Prototypes
    labels: IntArray
    neighbours: IntArray
    rotation: IntArray

    def __post_init__(self) -> None:
        freeze(self, labels=self.labels, neighbours=self.neighbours, rotation=self.rotation)

    @property
    def counts(self) -> IntArray:
        """(s,) members of each structure."""
        known = self.labels[self.labels >= 0]
        return np.bincount(known, minlength=len(self.prototypes)).astype(np.int64)


def find_structures(
    hoods: Neighbourhoods, *, tolerance: float = TOLERANCE, rotations: int = 1
) -> Structures:
    """Cover all taxels with as few neighbourhood shapes as a greedy choice finds.

    Leaders are neighbourhoods that stand for all others within half the tolerance. The leader
    that matches most uncovered ones, counted with their followers, becomes a prototype, until
    all are covered; the points of each prototype move to the mean of its members'; each taxel
    takes the prototype that it matches best.

    Parameters
    ----------
    hoods : Neighbourhoods
    tolerance : float
        How far a neighbour may lie from its place [m].
    rotations : int
        1, or 6 to let structures turn by multiples of pi / 3.

    Raises
    ------
    InvalidArrayError
        A tolerance or a number of rotations that is not positive.
    """
    if tolerance <= 0 or rotations < 1:
        raise InvalidArrayError(
            f"tolerance must be above 0 and rotations at least 1, got {tolerance} and {rotations}"
        )
    leaders, followers = _leaders(hoods, 0.5 * tolerance, rotations)
    among = _rows(hoods, leaders)
    shapes = _take(among, np.arange(len(leaders)), tolerance, rotations)
    matches = np.stack([np.isfinite(_match(among, shapes, s)[0]) for s in range(len(shapes))])
    uncovered = np.ones(len(leaders), bool)
    chosen = []
    while uncovered.any():
        chosen.append(int(np.argmax((matches & uncovered) @ followers)))
        uncovered &= ~matches[chosen[-1]]
    prototypes = _refine(hoods, _take(hoods, leaders[chosen], tolerance, rotations))
    found = assign(hoods, prototypes)
    leftover = np.flatnonzero(found.labels < 0)
    if len(leftover):
        # Followers are within 1.5 tolerances of what covers their leader, and a mean can move
        # away from a member: what is left over gets shapes of its own.
        rest = _rows(hoods, leftover)
        own = _take(rest, _leaders(rest, tolerance, rotations)[0], tolerance, rotations)
        found = assign(hoods, _join(prototypes, own))
    return _by_frequency(found)


def assign(hoods: Neighbourhoods, prototypes: Prototypes) -> Structures:
    """Give each taxel the prototype that it matches best; -1 where it matches none."""
    n, width = len(hoods), prototypes.offsets.shape[1]
    best = np.full(n, np.inf)
    labels, rotation = np.full(n, -1), np.zeros(n, np.int64)
    neighbours = np.full((n, width), -1)
    for s in range(len(prototypes)):
        cost, turn, places = _match(hoods, prototypes, s)
        better = cost < best
        best[better], labels[better], rotation[better] = cost[better], s, turn[better]
        neighbours[better] = places[better]
    return Structures(prototypes, labels, neighbours, rotation)


def _match(
    hoods: Neighbourhoods, prototypes: Prototypes, s: int
) -> tuple[FloatArray, IntArray, IntArray]:
    """Cost (n,) of each taxel against one prototype, its rotation and its neighbour order.

    The cost is the mean distance of matched points in tolerances, plus one for each optional
    point left alone; infinite where a required point has no partner.
    """
    n = len(hoods)
    cost, turn = np.full(n, np.inf), np.zeros(n, np.int64)
    places = np.full((n, prototypes.offsets.shape[1]), -1)
    filled, must = prototypes.filled[s], prototypes.required[s]
    able = (hoods.required.sum(axis=1) <= filled.sum()) & (hoods.filled.sum(axis=1) >= must.sum())
    able = np.flatnonzero(able)
    for step in range(prototypes.rotations):
        turned = prototypes.offsets[s] @ _rotation(2.0 * np.pi * step / prototypes.rotations)
        rows = able
        for place in np.flatnonzero(must):  # most taxels fall out after a point or two
            gap = ((hoods.offsets[rows] - turned[place]) ** 2).sum(axis=2)
            near = (gap <= prototypes.tolerance**2) & hoods.filled[rows]
            rows = rows[near.any(axis=1)]
        total, order = _pairing(hoods, rows, turned, filled, must, prototypes.tolerance)
        better = total < cost[rows]
        chosen = rows[better]
        cost[chosen], turn[chosen], places[chosen] = total[better], step, order[better]
    return cost, turn, places


def _pairing(
    hoods: Neighbourhoods,
    rows: IntArray,
    turned: FloatArray,
    filled: BoolArray,
    must: BoolArray,
    tolerance: float,
) -> tuple[FloatArray, IntArray]:
    """Cost (r,) and neighbour order (r, k) of some taxels against one turned prototype."""
    holds, needs = hoods.filled[rows], hoods.required[rows]
    gap = np.linalg.norm(hoods.offsets[rows][:, None] - turned[None, :, None], axis=3) / tolerance
    gap = np.where(holds[:, None] & filled[None, :, None], gap, np.inf)
    nearest = gap.argmin(axis=2)
    distance = np.take_along_axis(gap, nearest[..., None], 2)[..., 0]
    found = distance <= 1.0
    partnered = np.zeros(holds.shape, bool)
    row, place = np.nonzero(found)
    partnered[row, nearest[row, place]] = True
    fits = (found | ~must).all(axis=1) & (partnered | ~needs).all(axis=1)
    alone = (filled & ~found).sum(axis=1) + (holds & ~partnered).sum(axis=1)
    mean = np.where(found, distance, 0.0).sum(axis=1) / np.maximum(found.sum(axis=1), 1)
    index = np.take_along_axis(hoods.index[rows], nearest, 1)
    return np.where(fits, mean + alone, np.inf), np.where(found, index, -1)


def _rotation(angle: float) -> FloatArray:
    """(2, 2) matrix that turns row vectors counter-clockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]])


def _leaders(hoods: Neighbourhoods, tolerance: float, rotations: int) -> tuple[IntArray, IntArray]:
    """Taxels such that every taxel matches one of them within a tolerance, and how many do.

    Taxels with many neighbours lead first: borders follow the inside, not the other way round.
    """
    order = np.argsort(-hoods.filled.sum(axis=1), kind="stable")
    leaders, followers = [], []
    while len(order):
        shape = _take(hoods, order[:1], tolerance, rotations)
        close = np.isfinite(_match(_rows(hoods, order), shape, 0)[0])
        close[0] = True
        leaders.append(order[0])
        followers.append(np.count_nonzero(close))
        order = order[~close]
    return np.array(leaders, np.int64), np.array(followers, np.int64)


def _refine(hoods: Neighbourhoods, prototypes: Prototypes) -> Prototypes:
    """Prototypes with each point at the mean of its members', required if most require it."""
    found = assign(hoods, prototypes)
    offsets, required = prototypes.offsets.copy(), prototypes.required.copy()
    for s in range(len(prototypes)):
        members = np.flatnonzero(found.labels == s)
        if len(members) == 0:
            continue
        angle = -2.0 * np.pi * found.rotation[members] / prototypes.rotations
        c, d = np.cos(angle), np.sin(angle)
        back = np.stack([np.stack([c, d], 1), np.stack([-d, c], 1)], 1)
        local = np.einsum("nki,nij->nkj", hoods.offsets[members], back)
        for place in np.flatnonzero(prototypes.filled[s]):
            same = hoods.index[members] == found.neighbours[members, place][:, None]
            same &= hoods.filled[members]
            if same.any():
                offsets[s, place] = local[same].mean(axis=0)
                required[s, place] = hoods.required[members][same].mean() > 0.5
    return Prototypes(
        offsets, prototypes.filled, required, prototypes.tolerance, prototypes.rotations
    )


def _by_frequency(found: Structures) -> Structures:
    """The same without prototypes that have no members, numbered from the most common."""
    shapes = found.prototypes
    order = np.argsort(-found.counts, kind="stable")
    order = order[found.counts[order] > 0]
    kept = Prototypes(
        shapes.offsets[order],
        shapes.filled[order],
        shapes.required[order],
        shapes.tolerance,
        shapes.rotations,
    )
    rank = np.full(len(shapes) + 1, -1)  # the last place answers for label -1
    rank[order] = np.arange(len(order))
    return Structures(kept, rank[found.labels], found.neighbours, found.rotation)


def _take(hoods: Neighbourhoods, rows: IntArray, tolerance: float, rotations: int) -> Prototypes:
    """Neighbourhoods as prototypes, their points clockwise from twelve o'clock."""
    offsets, filled, required = hoods.offsets[rows], hoods.filled[rows], hoods.required[rows]
    angle = np.mod(np.arctan2(offsets[..., 0], offsets[..., 1]), 2.0 * np.pi)
    order = np.argsort(np.where(filled, angle, np.inf), axis=1)
    return Prototypes(
        np.take_along_axis(offsets, order[..., None], 1),
        np.take_along_axis(filled, order, 1),
        np.take_along_axis(required, order, 1),
        tolerance,
        rotations,
    )


def _rows(hoods: Neighbourhoods, rows: IntArray) -> Neighbourhoods:
    return Neighbourhoods(hoods.index[rows], hoods.offsets[rows], hoods.required[rows])


def _join(a: Prototypes, b: Prototypes) -> Prototypes:
    return Prototypes(
        np.concatenate([a.offsets, b.offsets]),
        np.concatenate([a.filled, b.filled]),
        np.concatenate([a.required, b.required]),
        a.tolerance,
        a.rotations,
    )

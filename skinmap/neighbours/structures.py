"""Periodic structures: neighbourhood shapes that repeat over a skin.

Two taxels have the same structure when their neighbour offsets agree within a tolerance,
up to a rotation by a multiple of 2 pi / rotations where that is asked for. Neighbours in a
soft band around the radius are optional, so that noise at the radius makes no new structures.

How much neighbourhoods resemble prototypes where none of them matches within the tolerance.

The distance of a neighbourhood from a prototype is the mean, over the points of both, of the
distance to the nearest point of the other, cut off at twice the tolerance (under half a pitch,
where another taxel's place begins). It says something at any noise and any radius.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import plane_turns
from skinmap.neighbours.matching import (
    MARGIN,
    Matcher,
    Prototypes,
    View,
    as_prototypes,
    clockwise,
    match_costs,
    pairing,
)
from skinmap.neighbours.offsets import (
    LATTICE,
    WIDEST,
    Neighbourhoods,
    auto_radius,
    flat_map_directions,
    neighbourhoods,
    ramp,
)
from skinmap.summary import Summary, listed

CUT = 2.0  # in tolerances: distances beyond are all the same
ALIKE = 4.0 / 3.0  # in tolerances: neighbourhoods of one structure; 2 mm, where noise of 1 to 2 mm
# kept the most accuracy on the hand of `kaspar` (1.5 to 2.25 mm were tried)
NEAREST = 24  # neighbours that are compared: all of them at the usual radius
ROWS = 4096  # neighbourhoods compared at a time


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
        candidates = _sampled(left, CANDIDATES)
        pool = as_prototypes(hoods, candidates, tolerance=none.tolerance, rotations=none.rotations)
        columns = np.union1d(_sampled(left, COLUMNS), candidates)
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


__all__ = [
    "RADIUS",
    "TOLERANCE",
    "Prototypes",
    "Structures",
    "assign",
    "find_structures",
    "usual_radius",
    "usual_tolerance",
]

CLOSE = 0.4  # pitches that a neighbour may stray on a fine lattice
TOLERANCE = 1.5e-3  # [m]; under half a pitch, so that matching points are one-to-one
RADIUS = 8.0e-3  # [m]; between the first and the second ring of the known modules
PITCHES = 4.0e-3, 8.1e-3  # of taxels that it is for [m]
RING = 1.2  # pitches: between the first and the second ring of other skins
STRAY = 1.5  # in tolerances: how far a point may lie where all together lie 1.5 times closer
CANDIDATES = 96  # shapes that are compared at a time, and
COLUMNS = 512  # neighbourhoods that they are counted on: sampled evenly from what is uncovered
POOLS = 16  # rounds of candidates
REFINED = 3  # times that a prototype moves to the mean of its members
MAX_PROTOTYPES = 512  # prototypes: what is left beyond them takes the one that it resembles most
RARELY = 0.25  # a place that holds less of a neighbour than this, on average, is none
PAIRS = 1 << 23  # of neighbours and places that are compared at a time
NOISY = 0.5  # share of the taxels: where so many match no other's shape, noise is to blame, unless
WIDE = 32  # neighbours or more make shapes that differ wherever a patch ends
AVERAGED = 2  # times that shapes move to the mean of what resembles them


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Structures(Frozen, Summary):
    """Which structure each of n taxels has, and which neighbour fills which place.

    Attributes
    ----------
    prototypes : Prototypes
    labels : (n,) int
        Structure of each taxel, the most common first; -1 for none, which only `assign` gives.
    neighbours : (n, k) int
        Taxel in each place of the taxel's prototype, so in its order; -1 for none.
    rotation : (n,) int
        How many steps of 2 pi / rotations the taxel is turned against its prototype.
    """

    prototypes: Prototypes
    labels: IntArray
    neighbours: IntArray
    rotation: IntArray

    @property
    def counts(self) -> IntArray:
        """(s,) members of each structure."""
        known = self.labels[self.labels >= 0]
        return np.bincount(known, minlength=len(self.prototypes)).astype(np.int64)

    @property
    def leftovers(self) -> IntArray:
        """(l,) taxels that share their structure with no other one, or that have none."""
        alone = np.append(self.counts == 1, True)  # the last place answers for label -1
        return np.flatnonzero(alone[self.labels])

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "taxels": len(self.labels),
            "structures": len(self.prototypes),
            "members": listed(self.counts.tolist()),
            "leftovers": len(self.leftovers),
        }


def find_structures(
    skin: FlatMap | Neighbourhoods,
    *,
    radius: float | None = None,
    tolerance: float | None = None,
    rotations: int = LATTICE,
    compiled: bool | None = None,
) -> Structures:
    """Cover all taxels with as few neighbourhood shapes as a greedy choice finds.

    Of a sample of uncovered neighbourhoods the one that matches most others becomes a prototype;
    it moves to the mean of its members before the next is chosen, so that its own noise does not
    count. What no prototype covers may join one that it strays from a little (see `assign`); what
    is still left gets shapes of its own. Where positions are so noisy that most would be left,
    neighbourhoods need only resemble each other: every taxel has a structure.

    Parameters
    ----------
    skin : FlatMap or Neighbourhoods
        The flat map gives each taxel a direction; with neighbourhoods they are known already.
    radius : float, optional
        How far neighbours of a taxel lie [m]; by default between two rings of the lattice, near
        8 mm. Only with a flat map.
    tolerance : float, optional
        How far a neighbour may lie from its place [m]; by default 1.5 mm, or 0.4 pitches of a
        finer lattice.
    rotations : int
        The symmetry of the lattice: 6 lets structures turn by multiples of pi / 3, 4 by quarters
        (square grids), 1 not at all.
    compiled : bool, optional
        Whether numba does the matching; by default where it is installed and worth its import.

    Returns
    -------
    Structures
        A label for each taxel, the most common structure first.

    Raises
    ------
    InvalidArrayError
        A radius or a tolerance that is not positive, or rotations other than 1, 4 and 6.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("left_hand")
    >>> structures = skinmap.find_structures(skinmap.flatten(skinmap.build_surface(skin)))
    >>> len(structures.labels) == len(skin)
    True
    """
    hoods = skin if isinstance(skin, Neighbourhoods) else _flat_neighbourhoods(skin, radius)
    tolerance = usual_tolerance(hoods) if tolerance is None else tolerance
    if not tolerance > 0 or rotations not in (1, 4, LATTICE):
        raise InvalidArrayError(
            f"tolerance must be above 0 and rotations 1, 4 or 6, got {tolerance} and {rotations}"
        )
    order, seen = _canonical_order(hoods), View(hoods, compiled)
    none = as_prototypes(hoods, order[:0], tolerance=tolerance, rotations=rotations)
    shapes, left = _cover(seen, order, none)
    if len(shapes):
        shapes = _settled(seen, shapes)
        left = _unmatched(seen, shapes, order)
    if len(left) > NOISY * len(hoods) and hoods.index.shape[1] <= WIDE:
        return _resembling(hoods, order, none)
    if len(left):
        shapes = shapes.joined(_cover(seen, left, none, fewest=1)[0])
        left = _unmatched(seen, shapes, order)[: max(MAX_PROTOTYPES - len(shapes), 0)]
        own = as_prototypes(hoods, left, tolerance=tolerance, rotations=rotations)
        shapes = shapes.joined(own)
    return _by_frequency(adopt_nearest(hoods, _assigned(seen, shapes)))


def _unmatched(seen: View, shapes: Prototypes, rows: IntArray) -> IntArray:
    """Those of some rows that match no shape."""
    return rows[_assigned(seen, shapes).labels[rows] < 0]


def _resembling(hoods: Neighbourhoods, rows: IntArray, none: Prototypes) -> Structures:
    """Structures of neighbourhoods that resemble each other, each moved to its members' mean."""
    shapes = cover_resembling(hoods, rows, none, most=MAX_PROTOTYPES)
    found = _by_frequency(adopt_nearest(hoods, _nowhere(len(hoods), shapes)))
    for _ in range(AVERAGED):
        moved = none
        for s in range(len(found.prototypes)):
            moved = moved.joined(_mean(hoods, found, s, np.flatnonzero(found.labels == s)))
        found = _by_frequency(adopt_nearest(hoods, _nowhere(len(hoods), moved)))
    return found


def _nowhere(n: int, shapes: Prototypes) -> Structures:
    """Structures of n taxels before any of them has one."""
    empty = np.full((n, shapes.offsets.shape[1]), -1)
    return Structures(shapes, np.full(n, -1), empty, np.zeros(n, np.int64))


def adopt_nearest(hoods: Neighbourhoods, found: Structures) -> Structures:
    """Structures in which taxels of none (-1) take the prototype that they resemble most.

    Places without a neighbour within twice the tolerance read as rest. Where there is no
    prototype at all, labels stay -1.
    """
    strangers = np.flatnonzero(found.labels < 0)
    if len(strangers) == 0 or len(found.prototypes) == 0:
        return found
    labels, rotation = found.labels.copy(), found.rotation.copy()
    neighbours = found.neighbours.copy()
    labels[strangers], rotation[strangers], neighbours[strangers] = most_alike(
        hoods, strangers, found.prototypes
    )
    return Structures(found.prototypes, labels, neighbours, rotation)


def usual_radius(skins: Sequence[FloatArray]) -> float:
    """`RADIUS`, or as many pitches on skins that are coarser or finer than the known ones [m].

    Parameters
    ----------
    skins : sequence of (n, 3) array of float
        Positions of the taxels of each part [m].
    """
    several = [np.unique(one, axis=0) for one in skins]
    pitches = [median_spacing(one) for one in several if len(one) > 1]
    pitch = float(np.median(pitches)) if pitches else RADIUS
    return RADIUS if PITCHES[0] <= pitch <= PITCHES[1] else RING * pitch


def usual_tolerance(hoods: Neighbourhoods) -> float:
    """`TOLERANCE`, or less where a neighbour that strays so far would reach another's place [m]."""
    nearest = np.where(hoods.filled, np.linalg.norm(hoods.offsets, axis=2), np.inf).min(
        axis=1, initial=np.inf
    )
    known = nearest[np.isfinite(nearest) & (nearest > 0)]
    return min(TOLERANCE, CLOSE * float(np.median(known))) if len(known) else TOLERANCE


def _flat_neighbourhoods(flat: FlatMap, radius: float | None) -> Neighbourhoods:
    if radius is None:
        skins = [flat.mesh.skin.positions]
        radius = auto_radius(skins, near=usual_radius(skins))
    if not 0.0 < radius <= WIDEST:
        hint = "; is it in millimetres?" if radius > WIDEST else ""
        raise InvalidArrayError(f"radius must be above 0 m and at most 1 m, got {radius}{hint}")
    skin, directions = flat.mesh.skin, flat_map_directions(flat)
    return neighbourhoods(skin.positions, skin.normals, directions, radius=radius)


def assign(
    hoods: Neighbourhoods, prototypes: Prototypes, *, compiled: bool | None = None
) -> Structures:
    """Give each taxel the prototype that it matches best; -1 where it matches none.

    First come matches of which every point lies within the tolerance, then those of which a point
    or two strays by up to 1.5 tolerances, if the root mean square is below 1 / 1.5 of it.

    Parameters
    ----------
    hoods : Neighbourhoods
    Of n taxels.
    prototypes : Prototypes
    Structures found before, perhaps on another skin.
    compiled : bool, optional
    Whether to use numba; where it is installed by default.

    Returns
    -------
    Structures
    Of the n taxels.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.neighbours import assign
    >>> from skinmap.touch.prepared_skin import PreparedSkin
    >>> skin = PreparedSkin(skinmap.load_robot("kaspar").skin("right_hand"))
    >>> found = skinmap.find_structures(skin.hoods)
    >>> bool((assign(skin.hoods, found.prototypes).labels == found.labels).mean() > 0.9)
    True
    """
    return _assigned(View(hoods, compiled), prototypes)


def _assigned(seen: View, prototypes: Prototypes) -> Structures:
    hoods, n = seen.hoods, len(seen.hoods)
    labels, turn = np.full(n, -1), np.zeros(n, np.int64)
    neighbours = np.full((n, prototypes.offsets.shape[1]), -1)
    step = max(1, PAIRS // neighbours[:1].size // max(hoods.index.shape[1], 1))
    tolerance = prototypes.tolerance
    for reach, rms in ((tolerance, tolerance), (STRAY * tolerance, tolerance / STRAY)):
        ready = Matcher(prototypes, hoods, reach=reach)
        waiting = np.flatnonzero(labels < 0)
        for start in range(0, len(waiting), step):
            rows = waiting[start : start + step]
            cost, stray, turns = match_costs(seen, rows, ready)
            cost[stray > rms**2] = np.inf
            best, lowest = _lowest(cost)
            hit = np.flatnonzero(np.isfinite(lowest))
            s, t = best[hit], turns[hit, best[hit]]
            partner = pairing(seen, rows[hit], ready, s, t)[2]
            at = rows[hit]
            labels[at], turn[at] = s, t
            taken = np.take_along_axis(hoods.index[at], np.maximum(partner, 0), 1)
            neighbours[at] = np.where(partner >= 0, taken, -1)
    return Structures(prototypes, labels, neighbours, turn)


def _lowest(cost: FloatArray) -> tuple[IntArray, FloatArray]:
    """Column (r,) of the lowest cost of each row and that cost; the first of near-equal ones."""
    if cost.shape[1] == 0:
        return np.zeros(len(cost), np.int64), np.full(len(cost), np.inf)
    lowest = cost.min(axis=1)
    best = (cost <= (lowest + MARGIN)[:, None]).argmax(axis=1)
    return best, np.take_along_axis(cost, best[:, None], 1)[:, 0]


def _canonical_order(hoods: Neighbourhoods) -> IntArray:
    """Rows by their own shape, most neighbours first: the same however taxels are numbered."""
    weight = hoods.weight
    spread = (weight * (hoods.offsets**2).sum(axis=2)).sum(axis=1)
    centre = (weight[..., None] * hoods.offsets).sum(axis=1)
    key = (centre[:, 1], centre[:, 0], spread, -hoods.required.sum(axis=1))
    scale = 1e-6 * (hoods.radius + hoods.band)  # far below noise, far above rounding
    rounded = [
        np.round(values / unit)
        for values, unit in zip(key, (scale, scale, scale**2 * 1e6, 1.0), strict=True)
    ]
    return np.lexsort(rounded)


def _cover(
    seen: View, rows: IntArray, none: Prototypes, *, fewest: int = 2
) -> tuple[Prototypes, IntArray]:
    """Prototypes of at least `fewest` members that cover some rows, and the rows left over."""
    hoods, shapes, uncovered = seen.hoods, none, rows
    tolerance, rotations = none.tolerance, none.rotations
    for _ in range(POOLS):
        if len(uncovered) == 0 or len(shapes) >= MAX_PROTOTYPES:
            break
        candidates, columns = _sampled(uncovered, CANDIDATES), _sampled(uncovered, COLUMNS)
        pool = as_prototypes(hoods, candidates, tolerance=tolerance, rotations=rotations)
        ready = Matcher(pool, hoods, reach=tolerance)
        cost, _, _ = match_costs(seen, columns, ready)
        matches = np.isfinite(cost).astype(np.int64)
        free = np.ones(len(columns), np.int64)
        every = len(candidates) == len(uncovered)
        floor = fewest if every else max(fewest, 2)
        while len(shapes) < MAX_PROTOTYPES:
            gain = free @ matches
            best = int(np.argmax(gain))
            if gain[best] < floor:
                break
            shape = pool.take(np.array([best]))
            for _ in range(REFINED):
                shape = _refined(hoods, shape, *_members(seen, uncovered, shape))
            members, *_ = _members(seen, uncovered, shape)
            covered = np.union1d(members, columns[matches[:, best] > 0])
            uncovered = uncovered[~np.isin(uncovered, covered)]
            free[np.isin(columns, covered)] = 0
            shapes = shapes.joined(shape)
        if every:
            break
    return shapes, uncovered


def _sampled(rows: IntArray, most: int) -> IntArray:
    """At most so many rows, evenly taken."""
    if len(rows) <= most:
        return rows
    return rows[(np.arange(most) * len(rows)) // most]


def _members(seen: View, rows: IntArray, shape: Prototypes) -> tuple[IntArray, IntArray, IntArray]:
    """Rows that match a single prototype, with their rotation (m,) and partners (m, k)."""
    ready = Matcher(shape, seen.hoods, reach=shape.tolerance)
    cost, _, turn = match_costs(seen, rows, ready)
    hit = np.flatnonzero(np.isfinite(cost[:, 0]))
    turns = turn[hit, 0]
    partner = pairing(seen, rows[hit], ready, np.zeros_like(turns), turns)[2]
    return rows[hit], turns, partner


def _refined(
    hoods: Neighbourhoods, shape: Prototypes, members: IntArray, turns: IntArray, partner: IntArray
) -> Prototypes:
    """One prototype with each point at the mean of its members', required if most require it."""
    if len(members) == 0:
        return shape
    back = plane_turns(2.0 * np.pi * turns / shape.rotations)
    local = np.einsum("nki,nij->nkj", hoods.offsets[members], back)
    there = partner >= 0
    at = np.maximum(partner, 0)
    points = np.where(there[..., None], np.take_along_axis(local, at[..., None], 1), 0.0)
    sure = there & np.take_along_axis(hoods.required[members], at, 1)
    number = there.sum(axis=0)
    mean = points.sum(axis=0) / np.maximum(number, 1)[:, None]
    length = np.linalg.norm(points, axis=2)
    present = (ramp(length, hoods.radius, hoods.band) * there).mean(axis=0)
    # A neighbour that noise let in for a few members would drag others in with it.
    filled = (shape.filled[0] & (present >= RARELY))[None]
    required = (2 * sure.sum(axis=0) > np.maximum(number, 1))[None] & filled
    offsets = np.where(filled[..., None], mean, 0.0)
    return Prototypes(*clockwise(offsets, filled, required), shape.tolerance, shape.rotations)


def _settled(seen: View, shapes: Prototypes) -> Prototypes:
    """Prototypes moved to the mean of all taxels that match them best.

    Those without members are left out, and so are those that match one with more members: noise
    had split them.
    """
    hoods, found = seen.hoods, _by_frequency(_assigned(seen, shapes))
    order = np.argsort(found.labels, kind="stable")
    kept = found.prototypes.take(np.zeros(0, np.int64))
    ends = np.searchsorted(found.labels[order], np.arange(len(found.prototypes) + 1))
    for s in range(len(found.prototypes)):
        shape = _mean(hoods, found, s, order[ends[s] : ends[s + 1]])
        if not _matches_any(shape, kept, hoods):
            kept = kept.joined(shape)
    return kept


def _mean(hoods: Neighbourhoods, found: Structures, s: int, members: IntArray) -> Prototypes:
    """One prototype moved to the mean of its members."""
    same = hoods.index[members][:, None, :] == found.neighbours[members][:, :, None]
    same &= found.neighbours[members][:, :, None] >= 0
    partner = np.where(same.any(axis=2), same.argmax(axis=2), -1)
    shape = found.prototypes.take(np.array([s]))
    return _refined(hoods, shape, members, found.rotation[members], partner)


def _matches_any(shape: Prototypes, others: Prototypes, hoods: Neighbourhoods) -> bool:
    """Whether one prototype lies within the tolerance of any of some others."""
    index = np.where(shape.filled, np.arange(shape.filled.shape[1]), -1)
    alike = Neighbourhoods(index, shape.offsets, shape.required, hoods.radius, hoods.band)
    ready = Matcher(others, alike, reach=shape.tolerance)
    return bool(np.isfinite(match_costs(View(alike), np.zeros(1, np.int64), ready)[0]).any())


def _by_frequency(found: Structures) -> Structures:
    """The same without prototypes that have no members, numbered from the most common."""
    order = np.argsort(-found.counts, kind="stable")
    order = order[found.counts[order] > 0]
    rank = np.full(len(found.prototypes) + 1, -1)  # the last place answers for label -1
    rank[order] = np.arange(len(order))
    return Structures(
        found.prototypes.take(order), rank[found.labels], found.neighbours, found.rotation
    )

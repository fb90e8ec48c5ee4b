"""Contacts of one sample on the surface mesh: which taxels hang together, and their measures.

And a contact that is followed: its number, its taxels and its measures, and what is cut off for
it. Several contacts may claim one connected component; which of its taxels are whose is told here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.point_surface import SurfaceWalker
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts.rest import LOW
from skinmap.touch.contacts.skin_geometry import ACTIVE, least_areas
from skinmap.touch.prepared_skin import PreparedSkin

SPIKE = 0.5  # of its pressure: a single active taxel is a spike unless some beside it read as much
WITNESSES = 3  # as many, or all that there are


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """Measures of the c contacts of one sample.

    Attributes
    ----------
    centre : (c, 3) float
        Centre of pressure, projected to the surface [m].
    face : (c,) int
        Triangle that it lies in (`JoinedSkin.faces`).
    normal : (c, 3) float
        Mean outward direction, weighted by pressure, unit length.
    area, area_least : (c,) float
        Sum of the taxels' areas, and the least of it that is covered [m2].
    load, peak : (c,) float
        Sum and largest of the pressures [counts].
    """

    centre: FloatArray
    face: IntArray
    normal: FloatArray
    area: FloatArray
    area_least: FloatArray
    load: FloatArray
    peak: FloatArray


class Components:
    """Connected active taxels by mesh adjacency."""

    def __init__(self, skin: JoinedSkin) -> None:
        self._neighbours = skin.neighbours
        self._place = np.full(len(skin) + 1, -1, np.int64)
        self._gathered = np.zeros(0, np.int64), skin.neighbours[:0]
        self._active = np.zeros(len(skin) + 1, np.bool_)
        self._degree = (skin.neighbours < len(skin)).sum(axis=1)

    def accompanied(self, index: IntArray, pressures: FloatArray) -> IntArray:
        """(j,) the active taxels `index` (k,) without specks, by the pressures (N,) of all.

        Noise makes spikes of single taxels; a touch is felt all round its strongest one. A taxel
        in no triangle is believed alone.
        """
        if np.array_equal(index, self._gathered[0]):
            return self._gathered[0]
        beside = self._neighbours[index]
        self._active[index] = True
        kept = np.asarray(self._active[beside].any(axis=1))
        self._active[index] = False
        if kept.all():
            self._gathered = index, beside  # most often asked for next
            return index
        single = np.flatnonzero(~kept)
        own = index[single]
        padded = np.append(pressures, 0.0)
        level = np.maximum(LOW, SPIKE * pressures[own])
        witnesses = (padded[beside[single]] > level[:, None]).sum(axis=1)
        kept[single] = witnesses >= np.minimum(WITNESSES, self._degree[own])
        return index[kept]

    def local(self, index: IntArray) -> IntArray:
        """(k, d) which of the taxels `index` (k,) stand beside each; itself where none does."""
        self._place[index] = np.arange(len(index))
        known, beside = self._gathered
        beside = self._place[beside if known is index else self._neighbours[index]]
        self._place[index] = -1
        return np.where(beside >= 0, beside, np.arange(len(index))[:, None])

    def label(self, index: IntArray) -> IntArray:
        """(k,) component of each of the taxels `index` (k,), 0 first.

        Every taxel takes the least label beside it, then its label's label, until all rest.
        """
        beside = self.local(index)
        label = np.arange(len(index))
        while True:
            new = label[beside].min(axis=1)
            new = np.minimum(new, label)
            new = new[new]
            if (new == label).all():
                break
            label = new
        roots = label == np.arange(len(index))
        return np.asarray((np.cumsum(roots) - 1)[label])


def basins(beside: IntArray, pressures: NDArray[Any]) -> IntArray:
    """(k,) the summit that each taxel climbs to, its row: uphill from neighbour to neighbour.

    Parameters
    ----------
    beside : (k, d) int
        From `Components.local`.
    pressures : (k,) float
    """
    rows = np.arange(len(beside))
    # Of equals the first in the list is the higher: a plateau has one summit.
    order = np.empty(len(rows), np.int64)
    order[np.argsort(-pressures, kind="stable")] = rows
    around = np.column_stack([rows, beside])
    up = around[rows, order[around].argmin(axis=1)]
    while True:
        further = up[up]
        if (further == up).all():
            return np.asarray(up)
        up = further


def measure(
    skin: JoinedSkin, index: IntArray, label: IntArray, count: int, pressures: FloatArray
) -> Measured:
    """Measures of `count` contacts.

    Parameters
    ----------
    skin : JoinedSkin
    index : (k,) int
        Active taxels.
    label : (k,) int
        Contact of each, 0 to count - 1; every contact has a taxel.
    pressures : (k,) float
        Of these taxels, above 0 [counts].
    """
    points = skin.positions[index]
    load = _sums(label, pressures, count)
    share = pressures / load[label]
    mean_point, normal = np.empty((count, 3)), np.empty((count, 3))
    directions = skin.normals[index]
    for axis in range(3):
        mean_point[:, axis] = _sums(label, share * points[:, axis], count)
        normal[:, axis] = _sums(label, share * directions[:, axis], count)
    length = np.sqrt(np.einsum("ij,ij->i", normal, normal))
    normal /= np.maximum(length, 1e-12)[:, None]
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(count))
    peak = np.maximum.reduceat(pressures[order], starts)
    away = points - mean_point[label]
    near = np.lexsort((np.einsum("ij,ij->i", away, away), label))[starts]
    face, centre = closest_on_faces(
        mean_point, skin.positions, skin.faces, skin.around[index[near]]
    )
    least = least_areas(index, pressures, peak[label], skin.neighbours, skin.areas)
    return Measured(
        centre,
        face,
        normal,
        _sums(label, skin.areas[index], count),
        _sums(label, least, count),
        load,
        peak,
    )


def _sums(label: IntArray, values: FloatArray, count: int) -> FloatArray:
    return np.asarray(np.bincount(label, values, minlength=count), np.float64)


def closest_on_faces(
    points: FloatArray, vertices: FloatArray, faces: IntArray, candidates: IntArray
) -> tuple[IntArray, FloatArray]:
    """Nearest of some triangles (c, f) to each point (c, 3), and the nearest point there (c, 3).

    The nearest point is the foot of the perpendicular where it falls inside, else the nearest of
    the three edges; a triangle of no size is its corner.
    """
    corners = vertices[faces[candidates]]
    a = corners[:, :, 0]
    ab, ac = corners[:, :, 1] - a, corners[:, :, 2] - a
    ap = points[:, None] - a
    d00, d01, d11 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    d20, d21 = _dot(ap, ab), _dot(ap, ac)
    scale = d00 * d11 - d01 * d01
    safe = np.where(scale > 0, scale, 1.0)
    v = (d11 * d20 - d01 * d21) / safe
    w = (d00 * d21 - d01 * d20) / safe
    inside = (scale > 0) & (v >= 0) & (w >= 0) & (v + w <= 1)
    # Feet on the edges ab, ac and bc, by (v, w).
    along = np.array([d20, d21, d21 - d20 + d00 - d01])
    long = np.array([d00, d11, d00 - 2.0 * d01 + d11])
    feet = np.minimum(np.maximum(along / np.where(long > 0, long, 1.0), 0.0), 1.0)
    on_ab, on_ac, on_bc = feet
    zero = np.zeros_like(v)
    vs = np.array([np.where(inside, v, on_ab), on_ab, zero, 1.0 - on_bc])
    ws = np.array([np.where(inside, w, zero), zero, on_ac, on_bc])
    # |p - (a + v ab + w ac)|^2 without |ap|^2, which the three share, plus that.
    gap = vs * vs * d00 + 2 * vs * ws * d01 + ws * ws * d11 - 2 * (vs * d20 + ws * d21)
    own = (gap.min(axis=0) + _dot(ap, ap)).argmin(axis=1)
    row = np.arange(len(points))
    which = gap[:, row, own].argmin(axis=0)
    v, w = vs[which, row, own], ws[which, row, own]
    foot = a[row, own] + v[:, None] * ab[row, own] + w[:, None] * ac[row, own]
    return candidates[row, own], foot


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("cfi,cfi->cf", one, other))


def centre_of_pressure(skin: PreparedSkin, pressures: FloatArray) -> FloatArray:
    """Centre (3,) [m] of all active taxels of one part's pressures (n,), on the surface."""
    index = np.flatnonzero(pressures > ACTIVE)
    one = np.zeros(len(index), np.int64)
    joined = JoinedSkin({skin.skin.part: skin})
    return measure(joined, index, one, 1, np.asarray(pressures[index], np.float64)).centre[0]


SETTLED = 0.1  # contacts that join or part do so in earnest after this time [s]
DRAWING = 0.25  # of its largest load: a contact that leaves draws no way
STEP = 2e-3  # the noise of a resting finger moves its centre by less than this [m]
POINTS = 512  # of a way kept; a longer one forgets its beginning, not its length
VALLEY = 0.7  # of the lower summit: contacts with less pressure than this between them are two
PARTED = 0.25  # a contact with a saddle below this share of the lower summit is two
ISLANDS = 0.05  # the same of the islands of one palm, which gains part
GRIP = 0.5  # while a hand closes its islands land [s]
PALM = 1.5e-3  # more than five fingers press: a contact of this size is of a hand [m2]
SPAN = 0.2  # of a hand [m]
CLOSE = 0.015  # a fingertip's width: what lies further apart is two while both have a summit [m]
PRINT = 1.67e-4  # less than the print of a light fingertip: three taxels 8 mm apart [m2]
HIDDEN = 0.5  # a contact without a summit is kept so long [s]


@dataclass(eq=False, slots=True)
class Track:
    """A contact that is followed.

    Attributes
    ----------
    identity, part : int
        Its number, and its part's row.
    began, seen : float
        First sample, and the last one in which it was felt [s].
    taxels : (k,) int
        In the numbering of `JoinedSkin`.
    centre, normal : (3,) float
    area, area_least, load, peak : float
        As measured last.
    stroke : Stroke
    heaviest : float
        Its load at its largest.
    touch : int
        Number of the touch that it is part of.
    apart : float
        Since when a piece of it lies apart [s]; NaN where none does.
    flat : float
        Since when it has had no summit of its own [s]; NaN where it has one.
    looked : float
        When it was last looked for a saddle that parts it [s].
    saddle : bool
        Whether there was one then.
    into : int
        That took its place without a valley between, -1 else.
    """

    identity: int
    part: int
    began: float
    seen: float
    taxels: IntArray
    centre: FloatArray
    normal: FloatArray
    area: float = 0.0
    area_least: float = 0.0
    load: float = 0.0
    peak: float = 0.0
    stroke: Stroke | None = None
    heaviest: float = 0.0
    touch: int = -1
    apart: float = float("nan")
    flat: float = float("nan")
    looked: float = float("-inf")
    saddle: bool = False
    into: int = -1

    def note(self, found: Measured, place: int, time: float, walker: SurfaceWalker) -> bool:
        """Keep what was measured of it at `place`; whether its stroke has grown."""
        self.seen, self.into = time, -1
        self.centre, self.normal = found.centre[place], found.normal[place]
        for name in ("area", "area_least", "load", "peak"):
            setattr(self, name, float(getattr(found, name)[place]))
        face = int(found.face[place])
        grown = False
        if self.stroke is None or time - self.began < SETTLED:
            # While it lands the centre goes with what lands next, not with the hand.
            self.stroke = Stroke(walker, self.centre, face)
        elif self.load >= DRAWING * self.heaviest:
            grown = self.stroke.add(self.centre, face)
        self.heaviest = max(self.heaviest, self.load)
        return grown


class Stroke:
    """A way along the surface, a point whenever the centre is a step from the last one.

    Parameters
    ----------
    walker : SurfaceWalker
    start : (3,) float
        [m].
    face : int
        Triangle of the start.
    """

    def __init__(self, walker: SurfaceWalker, start: FloatArray, face: int) -> None:
        self._walker = walker
        self._place = np.array(start)
        self._face = face
        self._points = [self._place]
        self.length = 0.0

    def add(self, centre: FloatArray, face: int) -> bool:
        """Follow the centre (3,) [m]; whether it was far enough."""
        x, y, z = (centre - self._place).tolist()
        if x * x + y * y + z * z < STEP * STEP:
            return False
        way = self._walker.path(self._place, self._face, centre, face)
        self.length += float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
        self._points.extend(way[1:])
        del self._points[:-POINTS]
        self._place, self._face = np.array(centre), face
        return True

    @property
    def points(self) -> FloatArray:
        """(p, 3) oldest first [m]."""
        return np.array(self._points)


@dataclass(eq=False, slots=True)
class Pieces:
    """The k active taxels of a sample at a time [s]: pressures, component and contact of each.

    `row` is -1 where a taxel is nobody's yet.
    """

    time: float
    index: IntArray
    pressures: FloatArray
    component: IntArray
    row: IntArray

    def only(self, some: IntArray) -> Pieces:
        """Some of the taxels."""
        own = (self.index[some], self.pressures[some], self.component[some], self.row[some])
        return Pieces(self.time, *own)


class Cutter:
    """Cuts a component that several contacts claim, along the valleys between them."""

    def __init__(self, skin: JoinedSkin, components: Components) -> None:
        self._positions, self._normals, self._areas = skin.positions, skin.normals, skin.areas
        self._sheets = skin.patch_of
        self._components = components
        self.settled = SETTLED
        self._meeting: dict[tuple[int, int], float] = {}

    def forget(self, ended: set[int] | None = None) -> None:
        """Forget since when contacts that are over, or all, have met."""
        self._meeting = {
            pair: since
            for pair, since in self._meeting.items()
            if ended is not None and not ended & set(pair)
        }

    def cut(self, own: Pieces, claimants: Mapping[int, Track], owner: IntArray) -> IntArray:
        """(k,) track of each taxel of a component that several tracks claim.

        Every summit goes to the track that had it, or to the nearest. Two tracks without a valley
        between them become one: the older goes on.

        Parameters
        ----------
        own : Pieces
            The component.
        claimants : mapping of int to Track
            The tracks that claim it, by their rows.
        owner : (k,) int
            Track that each taxel was part of, -1 for none.
        """
        beside = self._components.local(own.index)
        summit = basins(beside, own.pressures)
        tops, numbers = np.unique(summit), np.array(list(claimants))
        centres = np.stack([track.centre for track in claimants.values()])
        away = self._positions[own.index[tops], None] - centres
        nearest = np.einsum("tcj,tcj->tc", away, away).argmin(axis=1)
        owned = owner[tops]
        goes = np.where(np.isin(owned, numbers), owned, numbers[nearest])
        own.row = goes[np.searchsorted(tops, summit)]
        self._keep_flat(own, claimants, centres)
        for younger, older in self._joined(own, beside, claimants):
            own.row[own.row == younger] = older
            claimants[younger].into = claimants[older].identity
        return own.row

    def fingers(self, index: IntArray, pressures: FloatArray, depth: float) -> IntArray:
        """(k,) which contact each taxel of one component is part of, 0 where it is a single one.

        Maxima of the pressure by their persistence: regions grow downhill from their summits and,
        where two meet, are one unless the saddle lies below `depth` of the lower summit, the
        summits are a fingertip apart along the skin and each region is as large as a print.
        """
        one = np.zeros(len(index), np.int64)
        areas = self._areas[index]
        total = float(areas.sum())
        if not 2.0 * PRINT <= total <= PALM:
            return one
        beside = self._components.local(index)
        highest = index[int(pressures.argmax())]
        summit = index[pressures >= pressures[beside].max(axis=1)]
        if not (self._along_skin(summit, highest) >= CLOSE).any():
            return one
        tops, region = np.unique(basins(beside, pressures), return_inverse=True)
        size = np.bincount(region, areas).tolist()
        height = pressures[tops].tolist()
        root = list(range(len(tops)))
        sheet = self._sheets[index]

        def top(one: int) -> int:
            while root[one] != one:
                one = root[one]
            return one

        for saddle, a, b in _saddles(beside, pressures, region):
            # No taxel feels what lies over the joint of two shells: a saddle there must be deeper.
            joint = sheet[tops[a]] != sheet[tops[b]]
            a, b = top(a), top(b)
            if a == b:
                continue
            high, low = (a, b) if height[a] >= height[b] else (b, a)
            limit = min(depth, PARTED) if joint else depth
            deep = saddle <= limit * height[low] and min(size[a], size[b]) >= PRINT
            if not deep or self._along_skin(index[tops[[a]]], index[tops[b]])[0] < CLOSE:
                root[low] = high
                size[high] += size[low]
        joined = np.array([top(one) for one in range(len(root))])
        return np.asarray(np.unique(joined[region], return_inverse=True)[1])

    def _along_skin(self, some: IntArray, one: int) -> FloatArray:
        """(k,) ways along the skin from some taxels (k,) to one of the same sheet [m].

        Each is the arc of a circle whose ends have their normals: exact on balls and round limbs,
        and as long as the straight line where the skin is flat.
        """
        straight = np.linalg.norm(self._positions[some] - self._positions[one], axis=1)
        half = 0.5 * np.arccos(np.clip(self._normals[some] @ self._normals[one], -1.0, 1.0))
        return np.asarray(straight / np.sinc(half / np.pi))

    def _keep_flat(self, own: Pieces, claimants: Mapping[int, Track], centres: FloatArray) -> None:
        """Let contacts live on for a while whose summit is hidden by the gains of the taxels.

        They keep what lies nearest to their centre; not those that landed just now, nor those
        within a finger's width of another.
        """
        for place, (number, track) in enumerate(claimants.items()):
            if (own.row == number).any():
                track.flat = np.nan
                continue
            track.flat = own.time if np.isnan(track.flat) else track.flat
            gaps = np.linalg.norm(np.delete(centres, place, axis=0) - centres[place], axis=1)
            landing = own.time - track.began < self.settled
            if gaps.min() < CLOSE or landing or own.time - track.flat >= HIDDEN:
                continue
            away = self._positions[own.index][:, None] - centres
            own.row[np.einsum("tcj,tcj->tc", away, away).argmin(axis=1) == place] = number

    def _joined(
        self, own: Pieces, beside: IntArray, claimants: Mapping[int, Track]
    ) -> list[tuple[int, int]]:
        """Pairs (younger, older) of tracks in one component that are one contact from now on."""
        time, row, pressures = own.time, own.row, own.pressures
        other = row[beside]
        border = other != row[:, None]
        pass_height = np.minimum(pressures[:, None], pressures[beside])
        joined = []
        by_age = sorted(claimants, key=lambda one: claimants[one].identity)
        palm = float(self._areas[own.index].sum()) > PALM
        for older, younger in combinations(by_age, 2):
            elder, child = claimants[older], claimants[younger]
            if not (row == younger).any() or not (row == older).any():
                joined.append((younger, older))  # no summit is left of one of them
                continue
            between = border & (row[:, None] == older) & (other == younger)
            if not between.any():
                continue
            hand = palm and child.began - elder.began <= GRIP
            valley, reach = (ISLANDS, SPAN) if hand else (VALLEY, CLOSE)
            lower = min(pressures[row == older].max(), pressures[row == younger].max())
            pair = (elder.identity, child.identity)
            if pass_height[between].max() <= valley * lower:
                self._meeting.pop(pair, None)
                continue
            since = self._meeting.setdefault(pair, time)
            gap = child.centre - elder.centre
            close = float(gap @ gap) < reach * reach and time - since >= self.settled
            if close or time - child.began < self.settled:
                joined.append((younger, older))
        return joined


def _saddles(
    beside: IntArray, pressures: FloatArray, region: IntArray
) -> list[tuple[float, int, int]]:
    """Passes between neighbouring regions, (pressure, region, region), the highest first."""
    other = region[beside]
    taxel, place = np.nonzero(other > region[:, None])
    height = np.minimum(pressures[taxel], pressures[beside[taxel, place]])
    order = np.argsort(-height, kind="stable")
    taxel, place = taxel[order], place[order]
    a, b = region[taxel].tolist(), other[taxel, place].tolist()
    return list(zip(height[order].tolist(), a, b, strict=True))

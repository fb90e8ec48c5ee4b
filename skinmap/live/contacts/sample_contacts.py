"""Contacts of one sample on the surface mesh: which taxels hang together, and their measures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts.rest import LOW
from skinmap.touch.contacts.skin_geometry import ACTIVE, least_areas
from skinmap.touch.prepared_skin import PreparedSkin

SPIKE = 0.5  # of its pressure: a single active taxel is a spike unless some beside it read as much
WITNESSES = 3  # as many, or all that there are
RELEASE = 0.75 * ACTIVE  # a taxel that was active stays so down to here [counts]


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
    skin: JoinedSkin,
    index: IntArray,
    label: IntArray,
    count: int,
    pressures: FloatArray,
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
    on_ab = np.clip(d20 / np.where(d00 > 0, d00, 1.0), 0.0, 1.0)
    on_ac = np.clip(d21 / np.where(d11 > 0, d11, 1.0), 0.0, 1.0)
    long = d00 - 2.0 * d01 + d11
    on_bc = np.clip((d21 - d20 + d00 - d01) / np.where(long > 0, long, 1.0), 0.0, 1.0)
    zero = np.zeros_like(v)
    vs = np.stack([np.where(inside, v, on_ab), on_ab, zero, 1.0 - on_bc])
    ws = np.stack([np.where(inside, w, zero), zero, on_ac, on_bc])
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

"""Which places of two skins met in an event of self-touch.

An event names the active taxels of both sides, a patch of them on each. Two bodies pressed
together share the middle of their contact far better than they share any single taxel: the closest
two of many lie close under almost any mount. So connected active taxels are joined to one
place, their middle, and the places of both sides that lie closest are the pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from calibration.mount.chains import Chain, TouchRecording
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.proximity import median_spacing

LINK = 2.2  # times the spacing of the taxels: reaches over one silent taxel, not to another contact


@dataclass(frozen=True, eq=False, slots=True)
class Side:
    """Places where one chain may have been touched.

    Attributes
    ----------
    places : (m, c, 3) float
        In the frame of the patch [m].
    filled : (m, c) bool
        False where an event has fewer places.
    outward : (m, c, 3) float
        Way that a place goes for each metre that two sides stand apart: half the mean normal of
        its taxels where both sides have normals, all of it where one has, else nothing.
    """

    places: FloatArray
    filled: BoolArray
    outward: FloatArray

    def at(self, standoff: float) -> FloatArray:
        """Places (m, c, 3) where the two sides stand apart by so much [m]."""
        return self.places + standoff * self.outward

    def scaled(self, share: float) -> Side:
        """The same side with its part of what two sides stand apart."""
        return Side(self.places, self.filled, share * self.outward)


def side_of(chain: Chain, touched: Sequence[IntArray] | None, m: int) -> Side:
    """Middles of the connected active taxels of m events; a probe has its origin alone."""
    if touched is None:
        return Side(np.zeros((m, 1, 3)), np.ones((m, 1), np.bool_), np.zeros((m, 1, 3)))
    event = np.repeat(np.arange(m), [len(ids) for ids in touched])
    ids = np.concatenate([np.asarray(ids, np.int64) for ids in touched])
    known = np.isfinite(chain.taxels[ids]).all(axis=1)
    event, ids = event[known], ids[known]
    group = _connected(event, ids, chain.taxels)
    _, first, group = np.unique(group, return_index=True, return_inverse=True)
    size = np.bincount(group)
    middle = _sums(chain.taxels[ids], group) / size[:, None]
    normal = np.zeros_like(middle)
    if len(chain.normals):
        normal = _sums(np.nan_to_num(chain.normals[ids]), group)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    owner = event[first]
    order = np.argsort(owner, kind="stable")
    owner, middle, normal = owner[order], middle[order], normal[order]
    rank = np.arange(len(owner)) - np.searchsorted(owner, owner)
    places, outward = np.zeros((2, m, int(rank.max(initial=0)) + 1, 3))
    filled = np.zeros(places.shape[:2], np.bool_)
    places[owner, rank], outward[owner, rank] = middle, normal
    filled[owner, rank] = True
    return Side(places, filled, outward)


def _sums(values: FloatArray, group: IntArray) -> FloatArray:
    """Sum of the rows (k, 3) of each group."""
    return np.stack([np.bincount(group, axis) for axis in values.T], axis=1)


def _connected(event: IntArray, ids: IntArray, taxels: FloatArray) -> IntArray:
    """Number of the connected patch of each active taxel, over all events at once."""
    used, local = np.unique(ids, return_inverse=True)
    spacing = median_spacing(taxels[np.isfinite(taxels).all(axis=1)])
    near = KDTree(taxels[used]).sparse_distance_matrix(
        KDTree(taxels[used]), LINK * spacing, output_type="coo_matrix"
    )
    width = len(used)
    touching = np.zeros((width, width), np.bool_)
    touching[near.row, near.col] = True
    rows, cols = [], []
    start = np.searchsorted(event, np.arange(event.max(initial=-1) + 2))
    for low, high in pairwise(start.tolist()):
        own = local[low:high]
        i, j = np.nonzero(touching[own[:, None], own])
        rows.append(i + low)
        cols.append(j + low)
    i, j = np.concatenate(rows), np.concatenate(cols)
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(len(ids), len(ids)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


@dataclass(frozen=True, eq=False, slots=True)
class Pairs:
    """Places (m, 3) of both sides that met, in their patches, and their ways `outward` (m, 3)."""

    places: tuple[FloatArray, FloatArray]
    outward: tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False, slots=True)
class Contacts:
    """A recording ready to be fitted to."""

    recording: TouchRecording
    sides: tuple[Side, Side]

    def __len__(self) -> int:
        return len(self.recording)

    @property
    def stands_apart(self) -> bool:
        """Whether it is known which way the two sides stand apart."""
        return any(side.outward.any() for side in self.sides)

    def choose(self, T: Sequence[FloatArray], standoff: float) -> Pairs:
        """The places of both sides that lie closest, moved apart by `standoff` [m].

        `T` holds T_base_patch (m, 4, 4) of both sides.
        """
        here, there = self.sides
        both = [side.at(standoff) for side in self.sides]
        first, second = (_carry(pose, own) for pose, own in zip(T, both, strict=True))
        apart = np.sum((first[:, :, None] - second[:, None]) ** 2, axis=3)
        apart[~(here.filled[:, :, None] & there.filled[:, None])] = np.inf
        one, other = np.divmod(apart.reshape(len(apart), -1).argmin(axis=1), apart.shape[2])
        row = np.arange(len(apart))
        return Pairs(
            (both[0][row, one], both[1][row, other]),
            (here.outward[row, one], there.outward[row, other]),
        )

    def reordered(self, order: IntArray) -> Contacts:
        """The same touches with the poses of others."""
        angles = self.recording.angles[order]
        return Contacts(replace(self.recording, angles=angles), self.sides)

    def subset(self, mask: BoolArray) -> Contacts:
        """Some of the events."""
        here, there = (
            Side(side.places[mask], side.filled[mask], side.outward[mask]) for side in self.sides
        )
        return Contacts(self.recording.subset(mask), (here, there))


def _carry(T: FloatArray, places: FloatArray) -> FloatArray:
    """Places (m, c, 3) through T (m, 4, 4)."""
    return np.asarray(places @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3])


def contacts_of(recording: TouchRecording, first: Chain, second: Chain) -> Contacts:
    """Join the active taxels of every event to places."""
    m = len(recording)
    one, other = recording.touched
    sides = side_of(first, one, m), side_of(second, other, m)
    # One metre apart is half a metre for each of two sides, all of it where only one has normals.
    share = 1.0 / max(sum(side.outward.any() for side in sides), 1)
    return Contacts(recording, (sides[0].scaled(share), sides[1].scaled(share)))

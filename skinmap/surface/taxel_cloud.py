"""The taxels as meshing sees them: distinct, centred, of size one, in an order of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_points, freeze
from skinmap.errors import InvalidMeshError

MERGE = 1e-2  # in spacings: closer taxels are one vertex
AWAY = -0.5  # cosine between the normals of two taxels: 120 degrees
COPIES = 8  # taxels that may share a place and yet let the spacing be seen
COARSE = 1.25  # in spacings: taxels further apart have a spacing of their own
ALIKE = 3  # coarse taxels about one that are as far apart: fewer are strays beside a patch
ABOUT = 2.5  # in spacings of their own: so near they are
BESIDE = 1.5  # in coarse spacings: taxels so near a coarse area belong to it, too


@dataclass(frozen=True, eq=False, slots=True)
class Cloud:
    """Distinct points in lexicographic order, so that no result hangs on how taxels are numbered.

    Attributes
    ----------
    points : (k, 3) float
        Centred and scaled by a power of two to size one.
    normals : (k, 3) float
    vertices : (k,) int
        The taxel of each point.
    representative : (n,) int
        The taxel that stands for each taxel.
    centre : (3,) float
        Where the origin of `points` is [m].
    unit : float
        Length of one unit of `points` [m].
    spacing : float
        Median distance to the nearest other point, in units.
    spacings : (k,) float
        The same about each point: more in an area coarser than the median.
    """

    points: FloatArray
    normals: FloatArray
    vertices: IntArray
    representative: IntArray
    centre: FloatArray
    unit: float
    spacing: float
    spacings: FloatArray

    def __post_init__(self) -> None:
        freeze(self)

    def to_units(self, positions: FloatArray) -> FloatArray:
        """Other positions (m, 3) [m] beside the points."""
        return (positions - self.centre) / self.unit


def make_cloud(positions: FloatArray, normals: FloatArray, merge: float | None = None) -> Cloud:
    """The cloud of taxels at positions (n, 3) [m]; nearer ones than `merge` [m] are one point.

    Raises
    ------
    InvalidMeshError
        Fewer than three distinct taxels.
    """
    scaled, centre, unit = to_unit(check_points(positions, "positions"))
    tolerance = None if merge is None else merge / unit
    normals = check_finite(normals, "normals", (len(positions), 3))
    representative, vertices, near = _distinct(scaled, normals, tolerance)
    if len(vertices) < 3:
        raise InvalidMeshError(f"{len(vertices)} distinct taxels make no surface: at least 3")
    order = np.lexsort(scaled[vertices].T[::-1])
    vertices, near, spacing = vertices[order], near[order], float(np.median(near))
    points, normals = scaled[vertices], normals[vertices]
    spacings = local_spacings(points, normals, near, spacing)
    return Cloud(points, normals, vertices, representative, centre, unit, spacing, spacings)


def local_spacings(
    points: FloatArray, normals: FloatArray, near: FloatArray, spacing: float
) -> FloatArray:
    """(n,) the spacing about each of some points (n, 3): the median one, more in a coarser area.

    Taxels whose nearest other (n,) is further away make such an area where several of them are
    about as far apart; those that stand beside it belong to it, too. A stray taxel is none.
    """
    found = np.full(len(points), spacing)
    coarse = np.flatnonzero((near > COARSE * spacing) & (near < np.inf))
    if len(coarse) <= ALIKE:
        return found
    tree, count = cKDTree(points[coarse]), np.arange(1, min(COPIES, len(coarse) - 1) + 2)
    distance, index = tree.query(points[coarse], k=count[1:])
    alike = (distance <= ABOUT * near[coarse, None]) & ~faces_away(normals, coarse, coarse[index])
    others = np.sort(np.where(alike, near[coarse[index]], spacing), axis=1)
    own = np.maximum(np.minimum(near[coarse], others[:, -ALIKE]), spacing)
    distance, index = tree.query(points, k=count)
    beside = distance <= BESIDE * own[index]
    beside &= ~faces_away(normals, np.arange(len(points)), coarse[index])
    return np.maximum(found, np.where(beside, own[index], spacing).max(axis=1))


def to_unit(points: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Points (n, 3) centred and divided by a power of two, which rounds nothing; centre; power."""
    if len(points) == 0:
        return points, np.zeros(3), 1.0
    # Down first: the sum of the largest numbers, and a square of them, overflow.
    shift = int(np.frexp(np.abs(points).max())[1])
    small = np.ldexp(points, -shift)
    centre = small.mean(axis=0)
    small = small - centre
    again = int(np.frexp(np.abs(small).max())[1])
    return np.ldexp(small, -again), np.ldexp(centre, shift), float(np.ldexp(1.0, shift + again))


def _distinct(
    points: FloatArray, normals: FloatArray, tolerance: float | None
) -> tuple[IntArray, IntArray, FloatArray]:
    """Representative (n,), distinct points (k,) and how far the nearest other is from each (k,).

    Where taxels stand in near-coincident groups the nearest other says nothing of the spacing:
    what is nearer than a hundredth of the distance to the eighth is merged first. Taxels that
    look the other way are on the far side of a thin part and no neighbours.
    """
    _, first, same = np.unique(points, axis=0, return_index=True, return_inverse=True)
    representative = first[same.ravel()]
    vertices = np.sort(first)
    while len(vertices) > 1:
        distance, index = _nearest_on_its_side(points[vertices], normals[vertices])
        near, far = distance[:, 0], distance[:, -1]
        spacing, wide = float(np.median(near)), float(np.median(far))
        crowded = spacing <= MERGE * wide < np.inf
        limit = (MERGE * (wide if crowded else spacing)) if tolerance is None else tolerance
        row, column = np.nonzero(distance <= limit)
        if len(row) == 0:
            return representative, vertices, near
        pairs = coo_array(
            (np.ones(len(row)), (row, index[row, column])), shape=(len(vertices),) * 2
        )
        _, label = connected_components(pairs, directed=False)
        lowest = np.full(label.max() + 1, len(points))
        np.minimum.at(lowest, label, vertices)
        stand_in = np.arange(len(points))
        stand_in[vertices] = lowest[label]
        representative = stand_in[representative]
        vertices = np.unique(representative)
    return representative, vertices, np.zeros(len(vertices))


def gaps_on_one_side(points: FloatArray, normals: FloatArray) -> FloatArray:
    """(m,) distance of each distinct place (n, 3) to the nearest other that looks its way [m].

    Without the places that have none among the nearest; all zero (1,) where there is one place.
    """
    distinct, first = np.unique(points, axis=0, return_index=True)
    if len(distinct) < 2:
        return np.zeros(1)
    gap = _nearest_on_its_side(distinct, normals[first])[0][:, 0]
    return gap[gap < np.inf]


def _nearest_on_its_side(points: FloatArray, normals: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distances (k, c) and indices (k, c) of the nearest, infinitely far those that face away.

    As many columns as are finite in most rows, so that the last one tells of a wider ring.
    """
    count = min(COPIES, len(points) - 1)
    distance, index = cKDTree(points).query(points, k=np.arange(2, count + 2))
    across = faces_away(normals, np.arange(len(points)), index)
    if not across.any() or np.median(across.all(axis=1)) > 0:
        return distance, index  # one side only, or normals that say nothing
    distance = np.where(across, np.inf, distance)
    order = np.argsort(distance, axis=1, kind="stable")
    distance = np.take_along_axis(distance, order, 1)
    kept = max(1, int((np.median(distance, axis=0) < np.inf).sum()))
    return distance[:, :kept], np.take_along_axis(index, order, 1)[:, :kept]


def faces_away(normals: FloatArray, rows: IntArray, index: IntArray) -> BoolArray:
    """(r, k) whether neighbours of rows (r,) look the other way: on the far side, or a fold's."""
    x, y, z = (normals[rows, axis, None] * normals[:, axis][index] for axis in range(3))
    return np.asarray(x + y + z < AWAY)

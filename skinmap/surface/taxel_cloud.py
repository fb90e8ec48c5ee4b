"""The taxels as meshing sees them: distinct, centred, of size one, in an order of their own.

Their Delaunay stars in tangent planes: which triangles each taxel would have around itself.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_points
from skinmap.errors import InvalidMeshError
from skinmap.geometry.proximity import nearest_of
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.topology import components

MERGE = 1e-2  # in spacings: closer taxels are one vertex
AWAY = -0.5  # cosine between the normals of two taxels: 120 degrees
COPIES = 8  # taxels that may share a place and yet let the spacing be seen
COARSE = 1.25  # in spacings: taxels further apart have a spacing of their own
ALIKE = 3  # coarse taxels about one that are as far apart: fewer are strays beside a patch
ABOUT = 2.5  # in spacings of their own: so near they are
BESIDE = 1.5  # in coarse spacings: taxels so near a coarse area belong to it, too


class Cloud:
    """Distinct points in lexicographic order, so that no result hangs on how taxels are numbered.

    Parameters
    ----------
    positions : (n, 3) array of float
        Of the taxels [m].
    normals : (n, 3) array of float
    merge : float, optional
        Taxels nearer than this are one point [m].

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
    nearest : (c, k) int
        The nearest other points of each.
    reach : (k,) float
        All others are at least as far away, in units.

    Raises
    ------
    InvalidMeshError
        Fewer than three distinct taxels.
    """

    def __init__(
        self, positions: FloatArray, normals: FloatArray, merge: float | None = None
    ) -> None:
        scaled, self.centre, self.unit = to_unit(check_points(positions, "positions"))
        tolerance = None if merge is None else merge / self.unit
        normals = check_finite(normals, "normals", (len(positions), 3))
        self.representative, self.vertices, near, (distance, index) = _distinct(
            scaled, normals, tolerance
        )
        self.nearest = index[:FIRST]
        self.reach = distance[FIRST] if len(index) > FIRST else np.full(index.shape[1], np.inf)
        self.points, self.normals = scaled[self.vertices], normals[self.vertices]
        self.spacing = float(np.median(near))
        self.spacings = local_spacings(self.points, self.normals, near, self.spacing)

    def to_units(self, positions: FloatArray) -> FloatArray:
        """Other positions (m, 3) [m] beside the points."""
        return (positions - self.centre) / self.unit


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
    away = faces_away(normals, coarse[:, None], coarse[index])
    alike = (distance <= ABOUT * near[coarse, None]) & ~away
    others = np.sort(np.where(alike, near[coarse[index]], spacing), axis=1)
    own = np.maximum(np.minimum(near[coarse], others[:, -ALIKE]), spacing)
    distance, index = tree.query(points, k=count)
    beside = distance <= BESIDE * own[index]
    beside &= ~faces_away(normals, np.arange(len(points))[:, None], coarse[index])
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
) -> tuple[IntArray, IntArray, FloatArray, tuple[FloatArray, IntArray]]:
    """Representative (n,), distinct points (k,) and how far the nearest other is from each (k,).

    And the nearest others on either side. The distinct points are in lexicographic order.

    Where taxels stand in near-coincident groups the nearest other says nothing of the spacing:
    what is nearer than a hundredth of the distance to the eighth is merged first. Taxels that
    look the other way are on the far side of a thin part and no neighbours.
    """
    order = np.argsort(points[:, 0])
    if (np.diff(points[order, 0]) == 0.0).any():
        order = np.lexsort(points.T[::-1])
    fresh = (np.diff(points[order], axis=0, prepend=np.nan) != 0).any(axis=1)
    vertices, representative = order[fresh], np.empty(len(points), np.int64)
    representative[order] = vertices[np.cumsum(fresh) - 1]
    while len(vertices) > 2:
        either = _nearest(points[vertices], FIRST + 1)
        distance, index = _on_its_side(normals[vertices], *either)
        near, far = distance[0], distance[-1]
        spacing, wide = float(np.median(near)), float(np.median(far))
        crowded = spacing <= MERGE * wide < np.inf
        limit = (MERGE * (wide if crowded else spacing)) if tolerance is None else tolerance
        row, column = np.nonzero(distance <= limit)
        if len(row) == 0:
            return representative, vertices, near, either
        label = components(index[row, column], column, len(vertices))
        lowest = np.full(label.max() + 1, len(points))
        np.minimum.at(lowest, label, vertices)
        stand_in = np.arange(len(points))
        stand_in[vertices] = lowest[label]
        representative = stand_in[representative]
        vertices = order[representative[order] == order]
    raise InvalidMeshError(f"{len(vertices)} distinct taxels make no surface: at least 3")


def gaps_on_one_side(points: FloatArray, normals: FloatArray) -> FloatArray:
    """(m,) distance of each distinct place (n, 3) to the nearest other that looks its way [m].

    Without the places that have none among the nearest; all zero (1,) where there is one place.
    """
    distinct, first = np.unique(points, axis=0, return_index=True)
    if len(distinct) < 2:
        return np.zeros(1)
    gap = _on_its_side(normals[first], *_nearest(distinct, COPIES))[0][0]
    return gap[gap < np.inf]


def _nearest(points: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """Distances (c, k) and indices (c, k) of the nearest others of distinct points (k, 3)."""
    tree = cKDTree(points, compact_nodes=False, balanced_tree=False)
    distance, index = tree.query(points, k=np.arange(2, min(count, len(points) - 1) + 2))
    return np.ascontiguousarray(distance.T), np.ascontiguousarray(index.T)


def _on_its_side(
    normals: FloatArray, distance: FloatArray, index: IntArray
) -> tuple[FloatArray, IntArray]:
    """Distances (c, k) and indices (c, k) of the nearest, infinitely far those that face away.

    As many as are finite in most columns, so that the last one tells of a wider ring.
    """
    distance, index = distance[:COPIES], index[:COPIES]
    across = faces_away(normals, np.arange(index.shape[1]), index)
    if not across.any() or np.median(across.all(axis=0)) > 0:
        return distance, index  # one side only, or normals that say nothing
    distance = np.where(across, np.inf, distance)
    order = np.argsort(distance, axis=0, kind="stable")
    distance = np.take_along_axis(distance, order, 0)
    kept = max(1, int((np.median(distance, axis=1) < np.inf).sum()))
    return distance[:kept], np.take_along_axis(index, order, 0)[:kept]


def faces_away(normals: FloatArray, rows: IntArray, index: IntArray) -> BoolArray:
    """Whether neighbours of rows look the other way: on the far side, or a fold's."""
    x, y, z = (along.take(rows) * along.take(index) for along in normals.T)
    return np.asarray(x + y + z < AWAY)


NEIGHBOURS = 20  # more than two rings of a hexagonal lattice; a star needs one
FEW = 12  # close most stars too; at borders a little less is seen
JITTER = 1e-4  # in spacings: the least that breaks the ties of a square grid bent in space
FIRST = 8  # nearest to begin with: they settle most stars
FLAT = 1e-12  # of the inverted size squared: less is a rounding error
CHUNK = 2048  # taxels at a time: the numbers of their stars stay in the processor's cache
MARGIN = 1e-9  # relative: for the rounding of a circle's diameter


def delaunay_stars(
    cloud: Cloud,
    limit: FloatArray,
    *,
    neighbours: int = NEIGHBOURS,
    allowed: csr_array | None = None,
) -> IntArray:
    """Triangles (t, 3) that each point's own tangent-plane Delaunay diagram has around it.

    The first column is the point that votes; the order is counter-clockwise about its normal.
    The neighbours of a point in a Delaunay diagram are the corners of the convex hull of its
    neighbourhood inverted in the unit circle: the nearest is one, and from each the hull goes on
    to the one that turns least.

    A few neighbours are enough for a star that is closed and whose triangles have circles too
    small for any point further away to lie in.

    Parameters
    ----------
    cloud : Cloud
    limit : (n,) array of float
        Longest edge allowed at each point, in units; of those at its two ends the shorter one.
    neighbours : int
        Nearest others that a star is made of.
    allowed : (n, n) sparse array, optional
        Its entries are the pairs that may be neighbours; all by default.

    References
    ----------
    K. Q. Brown, "Voronoi diagrams from convex hulls", Information Processing Letters 9, 1979.
    """
    # Symbolic perturbation: the same for every run, so that co-circular taxels agree on one
    # diagonal. It is no source of randomness that a caller would want to choose.
    jitter = np.random.default_rng(0).normal(scale=JITTER * cloud.spacing, size=cloud.points.shape)
    shaken = cloud.points + jitter
    points = np.ascontiguousarray(shaken.T)
    reach = cloud.reach - 2.0 * np.linalg.norm(jitter, axis=1).max()
    found, left = [np.zeros((3, 0), np.int64)], []

    def vote(rows: IntArray, index: IntArray, path: IntArray, taken: BoolArray) -> None:
        who = index.take(path)
        chord = np.diff(points.take(who, axis=1), axis=1)
        most = limit.take(who)
        short = np.sqrt(np.einsum("akr,akr->kr", chord, chord)) <= np.minimum(most[:-1], most[1:])
        taken = taken & short
        found.append(np.stack([rows[np.nonzero(taken)[1]], who[:-1][taken], who[1:][taken]]))

    for rows in np.split(np.arange(len(shaken)), range(CHUNK, len(shaken), CHUNK)):
        index = cloud.nearest[:, rows]
        x, y = _inverted(points, cloud.normals, limit, rows, index, allowed)
        path, taken, settled = _hull_paths(x, y)
        fromx, fromy = x.take(path), y.take(path)
        diameter = np.sqrt(np.diff(fromx, axis=0) ** 2 + np.diff(fromy, axis=0) ** 2)
        turn = np.where(taken, fromx[:-1] * fromy[1:] - fromy[:-1] * fromx[1:], 1.0)
        settled &= ~(taken & (turn * reach[rows] <= (1.0 + MARGIN) * diameter)).any(axis=0)
        vote(rows, index, path, taken & settled)
        left.append(rows[~settled])
    rest = np.concatenate(left)
    tree = cKDTree(shaken, compact_nodes=False, balanced_tree=False)
    for rows in np.split(rest, range(CHUNK, len(rest), CHUNK)):
        index = np.ascontiguousarray(nearest_of(tree, rows, neighbours)[1].T)
        x, y = _inverted(points, cloud.normals, limit, rows, index, allowed)
        path, taken, closed = _hull_paths(x, y)
        vote(rows, index, path, taken)
        path, taken, _ = _hull_paths(x, -y)  # a star at a border ends both ways
        vote(rows, index, path[::-1], (taken & ~closed)[::-1])
    return np.concatenate(found, axis=1).T


def contains(pairs: csr_array, first: IntArray, second: IntArray) -> BoolArray:
    """(k,) whether a sparse array has entries at first, second (k,)."""
    n = pairs.shape[1]
    row, column = pairs.tocoo().coords
    return np.isin(first * n + second, row.astype(np.int64) * n + column)


def _inverted(
    points: FloatArray,
    normals: FloatArray,
    limit: FloatArray,
    rows: IntArray,
    index: IntArray,
    allowed: csr_array | None,
) -> tuple[FloatArray, FloatArray]:
    """(k, r) x and y of points (3, n) about rows (r,), inverted in the unit circle.

    Zero for those that are no neighbours: further away than the limit, on the other side, or not
    allowed. Neighbours are laid into the tangent plane at their full length, not at that of their
    shadow: strongly bent neighbourhoods stay near-isometric.
    """
    offset = points.take(index, axis=1) - points[:, None, rows]
    distance = np.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
    near = (distance > 0) & (distance <= np.minimum(limit[rows], limit.take(index)))
    near &= ~faces_away(normals, rows, index)
    if allowed is not None:
        own = np.tile(np.arange(len(rows)), len(index))
        near &= contains(allowed[rows], own, index.ravel()).reshape(index.shape)
    axes = np.ascontiguousarray(np.moveaxis(tangent_frames(normals[rows]), 0, 2))[:, :, None]
    x, y = axes[:, 0] * offset[0] + axes[:, 1] * offset[1] + axes[:, 2] * offset[2]
    shadow = np.sqrt(x * x + y * y)
    stretch = np.zeros_like(x)
    np.divide(1.0, distance * shadow, out=stretch, where=near & (shadow > 0))
    return x * stretch, y * stretch


def _hull_paths(x: FloatArray, y: FloatArray) -> tuple[IntArray, BoolArray, BoolArray]:
    """Ways round the hulls of inverted neighbours x, y (k, r): counter-clockwise from the nearest.

    Places (s + 1, r) in x and y on the way, one behind the other; which steps (s, r) are taken;
    whether each hull (r,) closes.
    """
    column, square = np.arange(x.shape[1]), x * x + y * y
    here = square.argmax(axis=0) * len(column) + column
    tiny = FLAT * square.max(axis=0)
    path, taken, going = [here], [], np.ones(len(column), np.bool_)
    for _ in range(len(x)):
        fromx, fromy = x.take(here), y.take(here)
        # The one that turns least from the way out of the origin through this one.
        turn = fromx * y - fromy * x
        along = fromx * x + fromy * y - square.take(here)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(turn > tiny, along / turn, -np.inf)
        here = ratio.argmax(axis=0) * len(column) + column
        taken.append(going & (ratio.take(here) > -np.inf))
        path.append(here)
        going = taken[-1] & (here != path[0])
        if not going.any():
            break
    steps, places = np.array(taken), np.array(path)
    return places, steps, (steps & (places[1:] == places[0])).any(axis=0)

"""The taxels as meshing sees them: distinct, centred, of size one, in an order of their own.

Their Delaunay stars in tangent planes: which triangles each taxel would have around itself.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_points
from skinmap.errors import InvalidMeshError
from skinmap.geometry.proximity import nearest_of
from skinmap.geometry.rigid import tangent_frames

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
        self.representative, self.vertices, near = _distinct(scaled, normals, tolerance)
        count = len(self.vertices)
        if count < 3:
            raise InvalidMeshError(f"{count} distinct taxels make no surface: at least 3")
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

    The distinct points are in lexicographic order.

    Where taxels stand in near-coincident groups the nearest other says nothing of the spacing:
    what is nearer than a hundredth of the distance to the eighth is merged first. Taxels that
    look the other way are on the far side of a thin part and no neighbours.
    """
    order = np.lexsort(points.T[::-1])
    fresh = (np.diff(points[order], axis=0, prepend=np.nan) != 0).any(axis=1)
    vertices, representative = order[fresh], np.empty(len(points), np.int64)
    representative[order] = vertices[np.cumsum(fresh) - 1]
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
        vertices = order[representative[order] == order]
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


NEIGHBOURS = 20  # more than two rings of a hexagonal lattice; a star needs one
FEW = 12  # close most stars too; at borders a little less is seen
JITTER = 1e-4  # in spacings: the least that breaks the ties of a square grid bent in space
FIRST = 9  # nearest to begin with: they settle most stars
FLAT = 1e-12  # of the inverted size squared: less is a rounding error
CHUNK = 256  # taxels at a time: the k^2 numbers of a star stay in the processor's cache
MANY = 65_536  # bounds the memory of the neighbour table
MARGIN = 1e-9  # relative: for the rounding of a circle's diameter


def delaunay_stars(
    points: FloatArray,
    normals: FloatArray,
    spacing: float,
    limit: float | FloatArray,
    *,
    neighbours: int = NEIGHBOURS,
    allowed: csr_array | None = None,
) -> IntArray:
    """Triangles (t, 3) that each point's own tangent-plane Delaunay diagram has around it.

    The first column is the point that votes; the order is counter-clockwise about its normal.
    The neighbours of a point in a Delaunay diagram are the corners of the convex hull of its
    neighbourhood inverted in the unit circle: from each neighbour the hull can only go on to the
    one that turns least, and it does if all others lie to the left of that step.

    Parameters
    ----------
    points : (n, 3) array of float
        [m].
    normals : (n, 3) array of float
        Unit, consistent.
    spacing : float
        Typical distance of neighbours [m].
    limit : float or (n,) array of float
        Longest edge allowed [m]; of those at its two ends the shorter one.
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
    jitter = np.random.default_rng(0).normal(scale=JITTER * spacing, size=points.shape)
    shaken = points + jitter
    tree = cKDTree(shaken)
    limit = np.broadcast_to(np.asarray(limit, np.float64), len(points)).copy()
    found = [np.zeros((0, 3), np.int64)]

    def near(rows: IntArray, count: int) -> tuple[FloatArray, IntArray, FloatArray]:
        distance, index = nearest_of(tree, rows, count)
        reach = distance[:, -1] if index.shape[1] < len(points) - 1 else np.full(len(rows), np.inf)
        out = faces_away(normals, rows, index) | (distance == 0)
        out |= distance > np.minimum(limit[rows, None], limit[index])
        if allowed is not None:
            own = np.repeat(np.arange(len(rows)), index.shape[1])
            out |= ~contains(allowed[rows], own, index.ravel()).reshape(index.shape)
        return np.where(out, np.inf, distance), index, reach

    left = []
    for start in range(0, len(points), MANY):
        rows = np.arange(start, min(start + MANY, len(points)))
        votes, settled = _settled_stars(shaken, normals, rows, *near(rows, FIRST), limit)
        found.append(votes)
        left.append(rows[~settled])
    rest = np.concatenate(left)
    for start in range(0, len(rest), CHUNK):
        rows = rest[start : start + CHUNK]
        distance, index, _ = near(rows, neighbours)
        x, y = _inverted(shaken, normals, rows, distance, index)
        finite = np.isfinite(distance)
        tiny = FLAT * np.maximum(np.abs(x), np.abs(y)).max(axis=1, initial=0.0)[:, None] ** 2
        step = _hull_steps(x, y, tiny)
        row, begin = np.nonzero((step >= 0) & finite)
        end = step[row, begin]
        triangles = np.column_stack([rows[row], index[row, begin], index[row, end]])
        kept = finite[row, end] & _short_chords(shaken, triangles, limit)
        found.append(triangles[kept])
    return np.concatenate(found)


def contains(pairs: csr_array, first: IntArray, second: IntArray) -> BoolArray:
    """(k,) whether a sparse array has entries at first, second (k,)."""
    n = pairs.shape[1]
    row, column = pairs.tocoo().coords
    return np.isin(first * n + second, row.astype(np.int64) * n + column)


def _settled_stars(
    points: FloatArray,
    normals: FloatArray,
    rows: IntArray,
    distance: FloatArray,
    index: IntArray,
    reach: FloatArray,
    limit: FloatArray,
) -> tuple[IntArray, BoolArray]:
    """Triangles (t, 3) of the stars that no taxel further away than reach (r,) can change.

    And which rows (r,) these are. All others lie outside the circles round the triangles of such
    a star, whose diameters are shorter. In order of angle, neighbours drop out that lie within
    the triangle of the origin and the two beside them, until the hull is left.
    """
    x, y = _inverted(points, normals, rows, distance, index)
    angle = np.where(np.isfinite(distance), np.arctan2(y, x), np.inf)
    order = np.argsort(angle, axis=1)
    place = (order + np.arange(len(rows))[:, None] * order.shape[1])[
        np.arange(order.shape[1]) < np.isfinite(distance).sum(axis=1)[:, None]
    ]
    row, x, y = place // order.shape[1], x.ravel()[place], y.ravel()[place]
    settled = np.bincount(row, minlength=len(rows)) >= 3
    tiny = FLAT * np.bincount(row, x * x + y * y, minlength=len(rows))
    while True:
        after = _next_of(row)
        before = np.empty_like(after)
        before[after] = np.arange(len(row))
        stepx, stepy = x[after] - x, y[after] - y
        bend = stepx[before] * stepy - stepy[before] * stepx
        turn = x * y[after] - y * x[after]
        # A gap of half a turn or more is a border; a rounding error decides nothing.
        settled[row[(turn <= tiny[row]) | (np.abs(bend) <= tiny[row])]] = False
        keep = settled[row] & (bend > 0)
        if keep.all():
            break
        row, x, y, place = row[keep], x[keep], y[keep], place[keep]
    far = turn * reach[row] <= (1.0 + MARGIN) * np.hypot(stepx, stepy)
    settled[row[far]] = False
    who = index.ravel()[place]
    triangles = np.column_stack([rows[row], who, who[after]])[settled[row]]
    return triangles[_short_chords(points, triangles, limit)], settled


def _short_chords(points: FloatArray, triangles: IntArray, limit: FloatArray) -> BoolArray:
    """(t,) whether the edge beyond the first corner of triangles (t, 3) is within both limits."""
    one, other = triangles[:, 1], triangles[:, 2]
    chord = np.linalg.norm(points[one] - points[other], axis=1)
    return np.asarray(chord <= np.minimum(limit[one], limit[other]))


def _next_of(row: IntArray) -> IntArray:
    """(k,) the next entry of the same row, round and round; rows (k,) are in order."""
    after = np.arange(1, len(row) + 1)
    last = np.flatnonzero(np.diff(row, append=-1))
    after[last] = np.concatenate([[0], last[:-1] + 1])[: len(last)]
    return after


def _inverted(
    points: FloatArray,
    normals: FloatArray,
    rows: IntArray,
    distance: FloatArray,
    index: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """(r, k) x and y of neighbours inverted in the unit circle; 0 for those infinitely far.

    Neighbours are laid into the tangent plane at their full length, not at that of their shadow:
    strongly bent neighbourhoods stay near-isometric.
    """
    x, y = np.zeros(index.shape), np.zeros(index.shape)
    first, second = tangent_frames(normals[rows]).swapaxes(0, 1)
    for axis in range(3):  # axes apart: sums over three columns are slow
        offset = points[:, axis][index] - points[rows, axis][:, None]
        x += offset * first[:, axis, None]
        y += offset * second[:, axis, None]
    shadow = np.hypot(x, y)
    near = np.isfinite(distance) & (shadow > 0)
    length = np.multiply(distance, shadow, out=np.ones_like(x), where=near)
    stretch = np.divide(1.0, length, out=np.zeros_like(x), where=near)
    return x * stretch, y * stretch


def _hull_steps(x: FloatArray, y: FloatArray, tiny: FloatArray) -> IntArray:
    """(r, k) where the hull of inverted neighbours x, y (r, k) goes on to from each; else -1."""
    # Of the steps i > j with the origin to the left, that is counter-clockwise about the point,
    # the one that turns least from the way out of the origin through i.
    turn = x[:, :, None] * y[:, None, :] - y[:, :, None] * x[:, None, :]
    along = x[:, :, None] * x[:, None, :] + y[:, :, None] * y[:, None, :]
    along -= (x * x + y * y)[:, :, None]
    forward = turn > tiny[..., None]
    ratio = np.full_like(turn, -np.inf)
    np.divide(along, turn, out=ratio, where=forward)
    step = ratio.argmax(axis=2)
    dx = np.take_along_axis(x, step, 1) - x
    dy = np.take_along_axis(y, step, 1) - y
    side = dx[..., None] * y[:, None, :]
    side -= dy[..., None] * x[:, None, :]
    hull = side.min(axis=2, initial=np.inf) - (dx * y - dy * x) >= -tiny
    return np.where(hull & forward.any(axis=2), step, -1)

"""The charts of a part as they lie on the body: upright, neighbours side by side, gaps as there.

Up is along the limb, the same for every pose and numbering.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import plane_turns
from skinmap.geometry.topology import edges, loops_by_length
from skinmap.geometry.triangles import cross_2d, cross_products, pair_lengths

MAX_ARRANGED = 48  # charts: more are no skin of one limb, they go in shelves
SAMPLES = 24  # vertices a chart that neighbours are laid out by
STEPS = 30  # of the layout of a pair: it converges to a thousandth of a gap within 20
NEAREST = 12  # vertices round the closest one that tell a chart's directions
TOUCHING = 0.5  # in edges: charts of patches that touch on the body are still kept apart
ALIKE = 0.15  # in gaps: places this much further apart are as close, boards are laid by hand
TURNS = np.radians([0, 15, -15, 30, -30, 50, -50, 75, -75, 105, -105, 140, -140, 180])
MAX_CORNERS = 96  # of an outline that is compared with others; finer ones are coarsened
LENGTH_SHARE = 0.2  # how much the spread counts against the normals: enough for flat plates
PLANE, SQUARE = 0.95, 0.01  # of normals and spreads: a plate without a length has edges at least
ROUNDING = 1e-6  # of an angle [rad]
SURE = 0.3  # cosine: an axis further than 73 degrees from the upward direction says nothing
STEEP = 0.35  # slope: flatter charts lie across the limb, another direction has to tell


def limb_frame(vertices: FloatArray, faces: IntArray, up: FloatArray | None = None) -> FloatArray:
    """Directions (3, 3) in rows: along the limb, then the way most of its surface looks.

    The surface of a limb looks away from its axis, so the axis is the direction that normals
    contain least of; a plate has two such, and its length decides.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m].
    faces : (m, 3) array of int
    up : (3,) array of float, optional
        Upward direction. Where there is none, or the limb lies across it, the narrow end hangs
        down: area reaches further below its centre than above.

    Returns
    -------
    (3, 3) array of float
        Unit vectors, orthogonal. They turn with the body, mirror with it, and do not depend on
        the order of vertices or faces.
    """
    cross = cross_products(vertices, faces)
    double = np.linalg.norm(cross, axis=1)
    weight = double / double.sum()
    normals = cross / np.where(double > 0, double, 1.0)[:, None]
    looks = (normals * weight[:, None]).T @ normals
    corners, share = vertices[faces].reshape(-1, 3), np.repeat(weight / 3.0, 3)
    centred = corners - share @ corners
    spread = (centred * share[:, None]).T @ centred
    contained, directions = np.linalg.eigh(looks - LENGTH_SHARE * spread / np.trace(spread))
    if contained[2] > PLANE and contained[1] - contained[0] < SQUARE:
        outward = weight @ normals @ np.cross(directions[:, 0], directions[:, 1])
        directions[:, 1] *= np.sign(outward) or 1.0
        directions = directions @ _edges(centred @ directions[:, :2])
    axis = _signed(directions[:, 0], centred, share, up)
    facing = weight @ normals - (weight @ normals @ axis) * axis
    if np.linalg.norm(facing) < 1e-6:  # looks everywhere alike: a tube, a ball
        facing = _signed(directions[:, 1], centred, share, None)
    facing = facing / np.linalg.norm(facing)
    return np.stack([axis, facing, np.cross(axis, facing)])


def _edges(flat: FloatArray) -> FloatArray:
    """(3, 3) least turn of a plane's axes along the smallest rectangle around its points (n, 2).

    Of two that are as good it is always the same one, whatever rounding says.
    """
    corners = flat[ConvexHull(flat).vertices]
    step = np.roll(corners, -1, axis=0) - corners
    half = np.pi / 4.0 + ROUNDING
    angle = np.mod(np.arctan2(step[:, 1], step[:, 0]) + half, np.pi / 2.0) - half
    turns = plane_turns(angle)
    area = np.ptp(corners @ turns, axis=1).prod(axis=1)
    turn = np.eye(3)
    turn[:2, :2] = turns[np.lexsort((angle.round(6), (area / area.min()).round(6)))[0]]
    return turn


def _signed(
    axis: FloatArray, centred: FloatArray, weight: FloatArray, up: FloatArray | None
) -> FloatArray:
    if up is not None and abs(axis @ up) > SURE * np.linalg.norm(up):
        return np.asarray(axis * np.sign(axis @ up))
    height = centred @ axis
    skew = weight @ height**3 / (weight @ height**2) ** 1.5
    if abs(skew) > 1e-6:  # rounding on a body with two like ends stays below this
        return np.asarray(-axis * np.sign(skew))
    return np.asarray(axis * np.sign(axis[np.argmax(np.abs(axis).round(6))]))


def upright(uv: FloatArray, height: FloatArray) -> FloatArray:
    """Coordinates (n, 2) turned so that the values `height` (n,) [m] grow upwards on average."""
    gradient = _slope(uv, height)
    centred = uv - uv.mean(axis=0)
    length = float(np.linalg.norm(gradient))
    if length == 0.0:
        return np.asarray(centred)
    c, s = gradient[1] / length, gradient[0] / length
    return np.asarray(centred @ np.array([[c, s], [-s, c]]))


def turn_upright(uv: FloatArray, vertices: FloatArray, frame: FloatArray) -> FloatArray:
    """A chart (n, 2) of vertices (n, 3) [m] turned so that the limb's axis points up.

    On a chart that lies across the limb, such as the cap at its end, the way that the limb's
    surface looks points down: the cap continues below it.
    """
    for direction in (frame[0], -frame[1], frame[2]):
        height = vertices @ direction
        if np.linalg.norm(_slope(uv, height)) > STEEP:
            return upright(uv, height)
    return upright(uv, vertices @ frame[0])


def _slope(uv: FloatArray, height: FloatArray) -> FloatArray:
    gradient, *_ = np.linalg.lstsq(uv - uv.mean(axis=0), height - height.mean(), rcond=None)
    return np.asarray(gradient)


@dataclass(frozen=True, eq=False, slots=True)
class Laid:
    """One chart to place: vertices (n, 3) [m], faces (m, 3), uv (n, 2) [m] turned upright."""

    vertices: FloatArray
    faces: IntArray
    uv: FloatArray


def arrange(charts: Sequence[Laid], *, side: float = 1.0) -> list[FloatArray]:
    """Coordinates (n, 2) [m] of charts placed as their patches lie on the body.

    Charts keep their size and direction. Each is laid beside its nearest neighbour on the body so
    that distances across the gap are as on the body, the gap being as wide as there. Where
    a third chart is in the way the gap is wider: no two charts ever come closer to each other
    than their patches do. Moving, mirroring and renumbering the body changes nothing but, for
    a mirror image, the side.

    Parameters
    ----------
    charts : sequence of Laid
    side : float
        Where a neighbour on the far side of the limb is as near to the right as to the left it is
        laid to the right for 1, to the left for -1: so that left and right parts are mirrored.
    """
    if not charts:
        return []
    if len(charts) > MAX_ARRANGED:
        gap = float(np.median([_edge(chart) for chart in charts]))
        return pack([chart.uv for chart in charts], gap)
    gaps = _gaps(charts)
    outlines = [outline(chart.faces, chart.uv) for chart in charts]
    place: dict[int, FloatArray] = {_middle(charts): np.zeros(2)}
    while len(place) < len(charts):
        rest = [k for k in range(len(charts)) if k not in place]
        links = [(float(gaps[i, k]), i, k) for i in place for k in rest]
        _, parent, new = min(links)
        one, other, gap = charts[parent], charts[new], float(gaps[parent, new])
        wanted = place[parent] + _beside(one, other, gap, side)
        others = [(outlines[i], place[i], float(gaps[i, new])) for i in place]
        place[new] = _nearest_free(outlines[new], wanted, list(place).index(parent), others)
    moved = [chart.uv + place[k] for k, chart in enumerate(charts)]
    everything = np.concatenate(moved)
    centre = (everything.min(axis=0) + everything.max(axis=0)) / 2.0
    return [uv - centre for uv in moved]


def _gaps(charts: Sequence[Laid]) -> FloatArray:
    """(c, c) shortest straight way between the vertices of two patches [m]."""
    trees = [cKDTree(chart.vertices) for chart in charts]
    gaps = np.full((len(charts),) * 2, np.inf)
    for i, one in enumerate(charts):
        for j in range(i):
            distance, _ = trees[j].query(one.vertices)
            floor = TOUCHING * min(_edge(one), _edge(charts[j]))
            gaps[i, j] = gaps[j, i] = max(float(distance.min()), floor)
    return gaps


def _edge(chart: Laid) -> float:
    return float(np.median(pair_lengths(chart.uv, edges(chart.faces))))


def _middle(charts: Sequence[Laid]) -> int:
    """The chart that the others are least far from: errors of a long chain stay small."""
    centres = np.array([chart.vertices.mean(axis=0) for chart in charts])
    return int(np.linalg.norm(centres[:, None] - centres[None], axis=2).sum(axis=1).argmin())


def _beside(one: Laid, other: Laid, gap: float, side: float) -> FloatArray:
    """Shift (2,) of `other` that keeps distances to `one` as on the body, near ones above all.

    Majorisation (SMACOF) of the stress over pairs of vertices, for a shift alone.
    """
    p, q, shift = _first_shift(one, other, gap, side)
    a, b = _around(one, p), _around(other, q)
    distance = np.linalg.norm(one.vertices[a][:, None] - other.vertices[b][None], axis=2)
    distance = np.maximum(distance, 1e-3 * gap)
    # Straight lines are as long as ways on the skin only where they are short.
    weight = (distance / distance.min()) ** -4
    weight /= weight.sum()
    start = one.uv[a][:, None] - other.uv[b][None]
    for _ in range(STEPS):
        way = shift - start
        length = np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-12 * gap)
        aim = start + distance[:, :, None] * way / length
        shift = (weight[:, :, None] * aim).sum(axis=(0, 1))
    return np.asarray(shift)


def _around(chart: Laid, vertex: int) -> IntArray:
    """Vertices evenly taken from the half of a chart that is nearer to one of them."""
    distance = np.linalg.norm(chart.uv - chart.uv[vertex], axis=1)
    order = np.argsort(distance, kind="stable")[: max(SAMPLES, len(distance) // 2)]
    return np.asarray(order[:: max(1, len(order) // SAMPLES)])


def _first_shift(one: Laid, other: Laid, gap: float, side: float) -> tuple[int, int, FloatArray]:
    """The closest vertices of two patches, and the shift (2,) that lays them a gap apart.

    The way across the gap goes on as it leaves the skin. Of places that are about as close the
    one on the wanted side counts.
    """
    distance, index = cKDTree(other.vertices).query(one.vertices)
    middle = other.uv.mean(axis=0) - one.uv.mean(axis=0)
    found = []
    for p in np.flatnonzero(distance <= distance.min() + ALIKE * gap).tolist():
        q = int(index[p])
        way = other.vertices[q] - one.vertices[p]
        direction = _carried(one, p, way) - _carried(other, q, -way)
        length = float(np.linalg.norm(direction))
        direction = direction / length if length > 0 else np.array([side, 0.0])
        shift = one.uv[p] - other.uv[q] + gap * direction
        found.append((side * float((shift + middle)[0]), p, q, shift))
    _, p, q, shift = max(found, key=lambda place: place[0])
    return p, q, shift


def _carried(chart: Laid, vertex: int, way: FloatArray) -> FloatArray:
    """Direction (2,) in the chart of a direction (3,) on the body at a vertex."""
    _, near = cKDTree(chart.uv).query(chart.uv[vertex], k=min(NEAREST, len(chart.uv)))
    flat = chart.uv[near] - chart.uv[near].mean(axis=0)
    body = chart.vertices[near] - chart.vertices[near].mean(axis=0)
    tangents, *_ = np.linalg.lstsq(flat, body, rcond=None)  # rows: d body / du and / dv
    return np.asarray(tangents @ way)


def _nearest_free(
    shape: Outline, wanted: FloatArray, parent: int, others: list[tuple[Outline, FloatArray, float]]
) -> FloatArray:
    """The shift nearest to a requested one at which an outline has its gap to all that are placed.

    The chart comes from outside towards its neighbour, from the side where it is wanted, until
    it would come too close to any; other sides are tried where a third chart stops it early.
    """
    centre, at, _ = others[parent]
    away = (shape.middle + wanted) - (centre.middle + at)
    length = float(np.linalg.norm(away))
    away = away / length if length > 0 else np.array([1.0, 0.0])
    best, least = wanted, np.inf
    for turn in TURNS:
        direction = plane_turns(turn) @ away
        line = centre.middle + at + length * direction - shape.middle
        stops = [clearance(shape, line, direction, other, spot, gap) for other, spot, gap in others]
        stop = max(stops)
        shift = line + (stop if np.isfinite(stop) else 0.0) * direction
        missed = float(np.linalg.norm(shift - wanted))
        if missed < least:
            best, least = shift, missed
        if np.argmax(stops) == parent:
            break
    return best


@dataclass(frozen=True, eq=False, slots=True)
class Outline:
    """A closed line round a chart.

    Attributes
    ----------
    corners : (c, 2) float
        [m].
    slack : float
        How far the chart's border strays from it [m].
    middle : (2,) float
        Mean of the chart's coordinates [m].
    """

    corners: FloatArray
    slack: float
    middle: FloatArray


def outline(faces: IntArray, uv: FloatArray) -> Outline:
    """The longest border of a chart with faces (m, 3) over coordinates (n, 2) [m]."""
    loop = loops_by_length(uv, faces)[0]
    border = uv[loop]
    keep = np.unique(np.linspace(0, len(loop), MAX_CORNERS, endpoint=False).astype(np.int64))
    if len(keep) == len(loop):
        return Outline(border, 0.0, uv.mean(axis=0))
    ends = np.append(keep, len(loop))
    part = np.searchsorted(ends, np.arange(len(loop)), side="right") - 1
    start, end = border[ends[part]], border[ends[part + 1] % len(loop)]
    slack = float(_to_segments(border, start, end).max())
    return Outline(border[keep], slack, uv.mean(axis=0))


def clearance(
    moving: Outline,
    line: FloatArray,
    direction: FloatArray,
    fixed: Outline,
    at: FloatArray,
    gap: float,
) -> float:
    """How far along a unit direction (2,) a chart at `line` has to go to be clear of another.

    Parameters
    ----------
    moving, fixed : Outline
    line, at : (2,) array of float
        Shifts of the two [m].
    direction : (2,) array of float
        Unit.
    gap : float
        Smallest distance kept between the two [m].

    Returns
    -------
    float
        Smallest t such that at `line + s direction` for every s >= t the two are at least the
        gap apart [m]; negative where there is room, -inf where they never meet.
    """
    room = gap + moving.slack + fixed.slack
    one, other = moving.corners + line, fixed.corners + at
    # A corner of one against the sides of the other, and the other way round.
    return max(
        _last_contact(one, other, direction, room), _last_contact(other, one, -direction, room)
    )


def _last_contact(points: FloatArray, loop: FloatArray, d: FloatArray, room: float) -> float:
    """Largest t at which a point + t d lies within `room` of a side of the loop."""
    a, b = loop[None], np.roll(loop, -1, axis=0)[None]
    p = points[:, None]
    # Round the corners: |p + t d - a| = room.
    along = ((a - p) * d).sum(axis=2)
    across = cross_2d(d, a - p)
    inside = room**2 - across**2
    latest = np.where(inside >= 0, along + np.sqrt(np.maximum(inside, 0.0)), -np.inf).max()
    # Beside the sides: the distance to the line through a and b is room, the foot lies between.
    length = np.linalg.norm(b - a, axis=2)
    side = (b - a) / np.where(length > 0, length, 1.0)[:, :, None]
    speed = cross_2d(side, np.broadcast_to(d, side.shape))
    start = cross_2d(side, p - a)
    for sign in (room, -room):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (sign - start) / speed
            foot = ((p - a) * side).sum(axis=2) + t * (side * d).sum(axis=2)
        hit = np.isfinite(t) & (foot >= 0) & (foot <= length)
        latest = max(latest, np.where(hit, t, -np.inf).max())
    return float(latest)


def _to_segments(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """(n,) distance of each point to its own segment [m]."""
    way = end - start
    square = np.maximum((way**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(((points - start) * way).sum(axis=1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[:, None] * way, axis=1))


def pack(charts: Sequence[FloatArray], gap: float) -> list[FloatArray]:
    """Charts in shelves of about equal width, the tallest first, `gap` [m] between them."""
    sizes = [np.ptp(chart, axis=0) for chart in charts]
    area = sum((size[0] + gap) * (size[1] + gap) for size in sizes)
    width = max(1.3 * np.sqrt(area), max(size[0] for size in sizes))
    placed: list[FloatArray] = [np.zeros((0, 2))] * len(charts)
    x, top, shelf = 0.0, 0.0, 0.0
    for i in sorted(range(len(charts)), key=lambda k: (-sizes[k][1], k)):
        if x > 0 and x + sizes[i][0] > width:
            x, top, shelf = 0.0, top - shelf - gap, 0.0
        corner = charts[i].min(axis=0) + np.array([0.0, sizes[i][1]])
        placed[i] = charts[i] - corner + np.array([x, top])
        x, shelf = x + sizes[i][0] + gap, max(shelf, float(sizes[i][1]))
    return placed

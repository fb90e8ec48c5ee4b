"""The charts of a part as they lie on the body: neighbours side by side, gaps as on the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.outlines import Outline, clearance, outline
from skinmap.flat.packing import pack
from skinmap.geometry.topology import edges

MAX_ARRANGED = 48  # charts: more are no skin of one limb, they go in shelves
SAMPLES = 24  # vertices a chart that neighbours are laid out by
STEPS = 30  # of the layout of a pair: it converges to a thousandth of a gap within 20
NEAREST = 12  # vertices round the closest one that tell a chart's directions
TOUCHING = 0.5  # in edges: charts of patches that touch on the body are still kept apart
ALIKE = 0.15  # in gaps: places this much further apart are as close, boards are laid by hand
TURNS = np.radians([0, 15, -15, 30, -30, 50, -50, 75, -75, 105, -105, 140, -140, 180])


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
        wish = place[parent] + _beside(one, other, gap, side)
        others = [(outlines[i], place[i], float(gaps[i, new])) for i in place]
        place[new] = _nearest_free(outlines[new], wish, list(place).index(parent), others)
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
    pairs = edges(chart.faces)
    ends = chart.uv[pairs]
    return float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)))


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
    shape: Outline, wish: FloatArray, parent: int, others: list[tuple[Outline, FloatArray, float]]
) -> FloatArray:
    """The shift nearest to a requested one at which an outline has its gap to all that are placed.

    The chart comes from outside towards its neighbour, from the side where the wish has it, until
    it would come too close to any; other sides are tried where a third chart stops it early.
    """
    centre, at, _ = others[parent]
    away = (shape.middle + wish) - (centre.middle + at)
    length = float(np.linalg.norm(away))
    away = away / length if length > 0 else np.array([1.0, 0.0])
    best, least = wish, np.inf
    for turn in TURNS:
        c, s = np.cos(turn), np.sin(turn)
        direction = away @ np.array([[c, s], [-s, c]])
        line = centre.middle + at + length * direction - shape.middle
        stops = [clearance(shape, line, direction, other, spot, gap) for other, spot, gap in others]
        stop = max(stops)
        shift = line + (stop if np.isfinite(stop) else 0.0) * direction
        missed = float(np.linalg.norm(shift - wish))
        if missed < least:
            best, least = shift, missed
        if np.argmax(stops) == parent:
            break
    return best

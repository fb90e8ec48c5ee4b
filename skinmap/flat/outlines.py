"""Outer borders of charts, and how far one may slide towards another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.topology import boundary_loops, loop_length
from skinmap.geometry.triangles import cross_2d

MAX_CORNERS = 96  # of an outline that is compared with others; finer ones are coarsened


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
    loop = max(boundary_loops(faces), key=lambda loop: loop_length(uv, loop))
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

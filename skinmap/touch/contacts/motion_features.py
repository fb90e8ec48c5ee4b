"""How a touch goes on in time: way, turns, presses, rhythm, twist and grip, alike on any robot.

All are lengths along the skin, times, angles, counts and shares, so they mean the same on any
lattice, part or robot, and at any rate of samples. docs/motion.md has the formulas.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import cross, unit
from skinmap.touch.contacts.skin_geometry import ACTIVE, SkinGeometry

MM, MS = 1e3, 1e3
RISES, FALLS = 0.35, 0.2  # shares of the largest load at which a press begins and is over
BLINK = 0.03  # a shorter gap is none [s]
FAINT = 0.8 * ACTIVE  # what a pressure must exceed to pull the centre: it comes in gradually
STEP = 3e-3  # the way is followed in steps of this length: noise makes none [m]
TURN = 6e-3  # a reversal goes back by this at least, [m]
TURN_SHARE = 0.3  # and by this share of the reach
SHAPES = 24  # samples of which the shape is measured at most
TOGETHER = 2  # on either side of each, whose shapes say together which way they lie
LONG = 1.25  # a shape longer than wide by this has a direction
OPPOSED = -0.3  # cosine of normals that face away from each other
# What only touches do that go on in time: [mm], [deg], [ms], [ms], [%].
MOVES, TURNS, LASTS, BRIEF, GRIPS = 15.0, 30.0, 1800.0, 250.0, 20.0
MOTION_FEATURES = (
    "contact_ms",
    "longest_press_ms",
    "presses",
    "period_ms",
    "pause_ms",
    "rise_ms",
    "way_mm",
    "reach_mm",
    "across_mm",
    "net_mm",
    "straight_share",
    "speed_mm_s",
    "reversals",
    "turned_deg",
    "opposed_share",
    "normals_spread",
    "area_now_mm2",
    "length_now_mm",
    "width_now_mm",
    "swept_ratio",
    "ripple",
    "ahead_mm",
    "abreast_mm",
    "peak_now",
)


def middle(values: NDArray[Any]) -> float:
    """The median of some values (k,), k > 0; of a few, numpy takes six times as long."""
    half = len(values) // 2
    ranked = np.partition(values, (half - 1, half) if half else 0)
    return float(ranked[half]) if len(values) % 2 else 0.5 * float(ranked[half - 1] + ranked[half])


def in_time(rows: FloatArray) -> BoolArray:
    """(m,) which touches, rows (m, d) of `MOTION_FEATURES`, do more than press and let go once."""
    column = {name: rows[:, k] for k, name in enumerate(MOTION_FEATURES)}
    moves = column["reach_mm"] > MOVES
    return np.asarray(
        moves
        | (column["presses"] > 1)
        | (column["turned_deg"] > TURNS)
        | (column["contact_ms"] > LASTS)
        | (column["contact_ms"] < BRIEF)
        | (column["opposed_share"] > GRIPS)
    )


def presses(load: FloatArray, rate: float) -> list[tuple[int, int]]:
    """First sample of each press in loads (k,), and the one after its last.

    A press begins above `RISES` of the largest load and is over below `FALLS` of it; shorter gaps
    than `BLINK` are none.
    """
    top = float(load.max(initial=0.0))
    if top <= 0:
        return []
    high, low = load >= RISES * top, load >= FALLS * top
    edge = np.flatnonzero(np.diff(np.concatenate([[False], low, [False]]).astype(np.int8)))
    found: list[tuple[int, int]] = []
    for first, last in edge.reshape(-1, 2).tolist():
        if not high[first:last].any():
            continue
        if found and first - found[-1][1] < BLINK * rate:
            found[-1] = (found[-1][0], last)
        else:
            found.append((first, last))
    return found


def motion_features(geometry: SkinGeometry, samples: NDArray[np.uint8], rate: float) -> FloatArray:
    """The numbers named in `MOTION_FEATURES` for the samples (k, n) of one touch; zeros untouched.

    Parameters
    ----------
    geometry : SkinGeometry
        Of n taxels.
    samples : (k, n) array of 0 to 255
    rate : float
        Samples a second.
    """
    found = np.zeros(len(MOTION_FEATURES))
    columns = np.flatnonzero(samples.max(axis=0, initial=0) > ACTIVE)
    if len(columns) == 0:
        return found
    weight = np.maximum(samples[:, columns] - np.float32(FAINT), 0.0).astype(np.float64)
    load = weight.sum(axis=1)
    spells = presses(load, rate)
    if not spells:
        return found
    points = np.asarray(geometry.mesh.vertices)[columns]
    normals = np.asarray(geometry.mesh.skin.normals)[columns]
    lengths = np.array([last - first for first, last in spells])
    longest = spells[int(np.argmax(lengths))]
    starts = np.array([first for first, _ in spells])
    gaps = starts[1:] - np.array([last for _, last in spells])[:-1]
    found[0] = lengths.sum() / rate * MS
    found[1] = lengths.max() / rate * MS
    found[2] = len(spells)
    if len(spells) > 1:
        found[3] = middle(np.diff(starts)) / rate * MS
        found[4] = middle(gaps) / rate * MS
    held = load[slice(*longest)]
    found[5] = float(np.argmax(held >= 0.9 * held.max())) / rate * MS
    found[6:13] = _way(weight, points, normals, load, longest, rate)
    found[13:] = _shape(geometry, weight, columns, load, spells, longest)
    return found


def _way(
    weight: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    load: FloatArray,
    spell: tuple[int, int],
    rate: float,
) -> FloatArray:
    """(7,) way, reach, width, net, straightness, speed and reversals in the longest press."""
    rows = np.arange(*spell)
    rows = rows[load[rows] >= RISES * load[rows].max()]
    share = weight[rows] / load[rows, None]
    centres, facing = share @ points, unit(share @ normals)
    if len(rows) >= 5:  # three samples at once: their noise is no way
        centres = (centres[:-2] + centres[1:-1] + centres[2:]) / 3.0
        facing, rows = facing[1:-1], rows[1:-1]
    kept, (x, y, z) = [0], centres[0].tolist()
    for k, (u, v, w) in enumerate(centres.tolist()):
        if (u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2 >= STEP * STEP:
            kept.append(k)
            x, y, z = u, v, w
    if len(kept) < 2:
        return np.zeros(7)
    plane = develop(centres[kept], facing[kept])
    steps = np.linalg.norm(np.diff(plane, axis=0), axis=1)
    way = float(steps.sum())
    centred = plane - plane.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    along = centred @ axes.T
    reach = np.ptp(along, axis=0)
    net = float(np.linalg.norm(plane[-1] - plane[0]))
    seconds = (rows[kept[-1]] - rows[kept[0]]) / rate
    turns = reversals(along[:, 0], max(TURN, TURN_SHARE * float(reach[0])))
    across = float(reach[1]) if len(reach) > 1 else 0.0
    return np.array(
        [way * MM, reach[0] * MM, across * MM, net * MM, 100.0 * net / way, way / seconds * MM,
         turns]
    )  # fmt: skip


def develop(points: FloatArray, normals: FloatArray) -> FloatArray:
    """(p, 2) a way over a surface rolled out into the plane, its steps at their full length.

    The plane's axes are carried from point to point by the least rotation between the normals, so
    that a geodesic becomes a straight line.
    """
    axes = tangent_frames(normals[0])
    plane = np.zeros((len(points), 2))
    for k in range(1, len(points)):
        step = points[k] - points[k - 1]
        middle = normals[k - 1] + normals[k]
        scale = 1.0 / max(1.0 + float(normals[k - 1] @ normals[k]), 1e-9)
        after = axes - np.outer(axes @ normals[k], middle * scale)
        flat = (axes + after) @ step
        length = float(np.hypot(*flat))
        if length > 0:
            flat *= float(np.linalg.norm(step)) / length
        plane[k], axes = plane[k - 1] + flat, after
    return plane


def reversals(along: FloatArray, least: float) -> int:
    """How often a coordinate (p,) turns back by at least so much."""
    count, way = 0, 0
    low = high = float(along[0])
    for value in along.tolist():
        if way >= 0 and value > high:
            high = value
        if way <= 0 and value < low:
            low = value
        if way >= 0 and high - value >= least:
            count += way > 0
            way, low = -1, value
        elif way <= 0 and value - low >= least:
            count += way < 0
            way, high = 1, value
    return count


def _shape(
    geometry: SkinGeometry,
    weight: FloatArray,
    columns: NDArray[np.int64],
    load: FloatArray,
    spells: list[tuple[int, int]],
    longest: tuple[int, int],
) -> FloatArray:
    """(11,) turn, opposition, spread of normals, area, length, width, and so on to the peak."""
    points = np.asarray(geometry.mesh.vertices)[columns]
    normals = np.asarray(geometry.mesh.skin.normals)[columns]
    areas = geometry.areas[columns]
    rows = np.concatenate([np.arange(*spell) for spell in spells])
    rows = rows[load[rows] >= 0.5 * load.max()]
    some = rows
    if len(rows) > SHAPES:
        some = rows[np.linspace(0, len(rows) - 1, SHAPES).astype(np.int64)]
    share = weight[some] / load[some, None]
    active = weight[some] > 0
    now = middle(active @ areas)
    spread = _spread(share, points)
    # Length and width, 4 standard deviations.
    size = 4.0 * np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, :0:-1], 0.0))
    facing = share @ normals
    ahead, abreast = _across_way(spread, share @ points, facing)
    pooled = weight[rows].sum(axis=0)
    strongest = normals[int(np.argmax(pooled))]
    opposed = float(pooled[normals @ strongest < OPPOSED].sum() / pooled.sum())
    clear = size[:, 0] > LONG * np.maximum(size[:, 1], 1e-9)
    clear &= (some >= longest[0]) & (some < longest[1])
    turn = _turned(spread, facing, clear) if clear.sum() >= 3 else 0.0
    swept = float(areas[(weight[rows] > 0).sum(axis=0) >= 2].sum())
    held = load[slice(*longest)]
    inner = held[len(held) // 5 : len(held) - len(held) // 5]
    ripple = float(inner.std() / inner.mean()) if len(inner) and inner.mean() > 0 else 0.0
    return np.array(
        [
            np.degrees(turn),
            100.0 * opposed,
            100.0 * (1.0 - middle(np.linalg.norm(facing, axis=1))),
            now * MM**2,
            middle(size[:, 0]) * MM,
            middle(size[:, 1]) * MM,
            10.0 * swept / now if now > 0 else 0.0,
            100.0 * ripple,
            ahead * MM,
            abreast * MM,
            middle(weight[some].max(axis=1)),
        ]
    )


def _spread(share: FloatArray, points: FloatArray) -> FloatArray:
    """(k, 3, 3) covariances of weights (k, n) at points (n, 3)."""
    away = points - points.mean(axis=0)
    mean = share @ away
    squares = np.einsum("ni,nj->nij", away, away).reshape(len(away), 9)
    spread = (share @ squares).reshape(-1, 3, 3) - np.einsum("ki,kj->kij", mean, mean)
    return np.asarray(spread)


def _axes(spread: FloatArray, rows: IntArray) -> FloatArray:
    """(r, 3) the long axis in some rows (r,) of covariances (k, 3, 3).

    That of some samples together: in a single one of a round contact noise turns it.
    """
    first, last = np.maximum(rows - TOGETHER, 0), np.minimum(rows + TOGETHER + 1, len(spread))
    sums = np.concatenate([np.zeros((1, 3, 3)), spread.cumsum(axis=0)])
    return np.linalg.eigh(sums[last] - sums[first])[1][:, :, 2]


def _across_way(spread: FloatArray, centres: FloatArray, facing: FloatArray) -> tuple[float, float]:
    """How long the contact is along its way and across it, in the median; 0 where it stays [m]."""
    step = centres[1:] - centres[:-1]
    moving = np.einsum("ki,ki->k", step, step) > (0.5 * STEP) ** 2
    if not moving.any():
        return 0.0, 0.0
    ahead, normal, own = unit(step[moving]), unit(facing[1:][moving]), spread[1:][moving]
    abreast = cross(normal, ahead)
    found = [np.einsum("ki,kij,kj->k", one, own, one) for one in (ahead, abreast)]
    along, across = (4.0 * middle(np.sqrt(np.maximum(one, 0.0))) for one in found)
    return along, across


def _turned(spread: FloatArray, facing: FloatArray, clear: BoolArray) -> float:
    """How far the long axis turned about the normal where it is clear, least to most [rad]."""
    axis, normal = _axes(spread, np.flatnonzero(clear)), unit(facing[clear])
    axis = unit(axis - np.einsum("ki,ki->k", axis, normal)[:, None] * normal)
    before, after = axis[:-1], axis[1:]
    sine = np.einsum("ki,ki->k", cross(before, after), normal[1:])
    cosine = np.einsum("ki,ki->k", before, after)
    step = np.arctan2(sine, cosine)
    step = (step + 0.5 * np.pi) % np.pi - 0.5 * np.pi  # an axis has no head
    way = np.concatenate([[0.0], np.cumsum(step)])
    return float(np.ptp(way))

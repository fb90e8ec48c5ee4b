"""What an elastic skin makes of a body that is pressed on it: contact width from force.

Foam on a hard shell answers as a bed of springs (Winkler; Johnson, "Contact Mechanics", 1985,
4.3): the pressure at a point is its stiffness times how far the body would reach into it. The
body sinks in until the pressures add up to its force, so the contact is the wider the harder it is
pressed, the blunter body and skin are and the softer they are together. Foam then spreads the
pressure as a Gaussian, and a taxel feels the mean around its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.skin.skin import Skin
from skinmap.touch.simulation.hands import Body

FIRM = 30e3  # pressure under the middle of a fingertip pressed with 2 N: one unit of load [Pa]
AROUND = 18e-3  # taxels so near to a body's middle say how the skin bends there [m]
SHARPEST = 80.0  # curvature of a skin at most [1/m]; taxels say nothing of sharper bends
STEPS = (33, 17)  # places along and across a body where its pressures are added up
SEEK = 1e-3  # [m] added around the place that is searched for contact
# Points and weights of a Gaussian of deviation 1 in the plane: two circles by Gauss-Laguerre's
# rule, six points on each.
_RADII = np.sqrt(2.0 * (2.0 + np.sqrt(2.0) * np.array([-1.0, 1.0])))
_TURN = np.arange(6) * np.pi / 3.0
NODES = np.concatenate(
    [
        r * np.column_stack([np.cos(_TURN + t), np.sin(_TURN + t)])
        for r, t in zip(_RADII, (0.0, np.pi / 6), strict=True)
    ]
)
NODE_WEIGHTS = np.repeat((2.0 + np.sqrt(2.0) * np.array([1.0, -1.0])) / 4.0 / 6.0, 6)


@dataclass(frozen=True, slots=True)
class Foam:
    """The foam of a skin.

    Attributes
    ----------
    stiffness : float
        Pressure for each metre that it is pressed in [N/m3]: modulus over thickness.
    spread : float
        Standard deviation of the Gaussian by which it spreads a pressure [m].
    """

    stiffness: float
    spread: float


def bed_loads(bodies: Sequence[Body], foam: Foam, uv: FloatArray, skin: Skin) -> FloatArray:
    """(b, n) load of each body on each taxel at full press, 1 = the middle of a firm finger.

    Parameters
    ----------
    bodies : sequence of Body
        In the plane of `uv`.
    foam : Foam
    uv : (n, 2) float
        Plane coordinates of the taxels, NaN where the map does not reach [m].
    skin : Skin
        n taxels, for how it bends.
    """
    near = np.flatnonzero(np.isfinite(uv[:, 0]))
    places = uv[near]
    loads = np.zeros((len(bodies), len(uv)))
    for number, body in enumerate(bodies):
        bend = followed(body, curvature_at(body.middle, places, skin, near))
        series = 1.0 / (1.0 / body.stiffness + 1.0 / foam.stiffness)
        depth = sunk_in(body, bend, series)
        # Beyond the body and three spreads of the foam there is no load.
        reach = np.linalg.norm(np.subtract(body.end, body.start)) / 2 + body.radius
        close = np.linalg.norm(places - body.middle, axis=1) < reach + 3.0 * foam.spread
        around = places[close][:, None] + foam.spread * NODES
        pressure = _pressures(body, bend, series, depth, around.reshape(-1, 2))
        loads[number, near[close]] = pressure.reshape(-1, len(NODES)) @ NODE_WEIGHTS / FIRM
    return loads


def sunk_in(body: Body, bend: FloatArray, stiffness: float) -> float:
    """How deep [m] a body sinks into a bed of springs until they carry its force.

    The springs that are reached first carry more; with their gaps sorted, the depth for the first
    m of them is a division, and the right m is the last whose own gap is less than its depth.
    """
    points, area = _search(body, bend, stiffness)
    gap = np.sort(_gaps(body, bend, points))
    gap = gap[np.isfinite(gap)]
    count = np.arange(1, len(gap) + 1)
    depth = (body.force / (stiffness * area) + np.cumsum(gap)) / count
    last = int(np.flatnonzero(gap <= depth)[-1])
    found = float(depth[last])
    if np.isfinite(body.ceiling) and stiffness * (found - gap[0]) > body.ceiling:
        found = _sunk_in_under_ceiling(body, gap, stiffness, area)
    return found


def _sunk_in_under_ceiling(body: Body, gap: FloatArray, stiffness: float, area: float) -> float:
    """The same where no spring may carry more than the ceiling; what is beyond it is lost."""
    low, high = float(gap[0]), float(gap[-1])
    for _ in range(40):
        middle = 0.5 * (low + high)
        force = np.minimum(stiffness * np.clip(middle - gap, 0.0, None), body.ceiling).sum() * area
        low, high = (middle, high) if force < body.force else (low, middle)
    return 0.5 * (low + high)


def contact_width(body: Body, stiffness: float) -> float:
    """Half the width [m] of the contact of a body on a flat skin."""
    depth = min(_flat_depth(body, stiffness), body.radius)
    return float(np.sqrt(2.0 * body.radius * depth - depth**2))


def _flat_depth(body: Body, stiffness: float) -> float:
    """How deep a body sinks into a flat bed [m]: as a ball or as a straight bar, the lesser."""
    length, _ = body.axis
    ball = np.sqrt(body.force / (np.pi * stiffness * body.radius))
    if length == 0:
        return float(ball)
    bar = (0.75 * body.force / (stiffness * length * np.sqrt(2.0 * body.radius))) ** (2.0 / 3.0)
    return float(min(ball, bar))


def curvature_at(point: FloatArray, places: FloatArray, skin: Skin, rows: np.ndarray) -> FloatArray:
    """(2, 2) how a skin bends away around a point of its map [1/m].

    Least squares: taxels (places (k, 2), their rows (k,)) within `AROUND` lie below the tangent
    plane of the nearest one by half their offset times the curvature times their offset.
    """
    away = places - point
    nearest = int(np.argmin(np.einsum("ij,ij->i", away, away)))
    step = places - places[nearest]
    close = np.flatnonzero(np.einsum("ij,ij->i", step, step) < AROUND**2)
    if len(close) < 6:
        return np.zeros((2, 2))
    x, y = step[close].T
    own = rows[nearest]
    sag = -(skin.positions[rows[close]] - skin.positions[own]) @ skin.normals[own]
    table = np.column_stack([0.5 * x * x, x * y, 0.5 * y * y, x, y])
    # Normals of taxels are a few degrees off: the slopes x and y take that up.
    a, b, c, *_ = np.linalg.lstsq(table, sag, rcond=None)[0]
    value, axes = np.linalg.eigh(np.array([[a, b], [b, c]]))
    return np.asarray((axes * np.clip(value, -SHARPEST, SHARPEST)) @ axes.T)


def followed(body: Body, bend: FloatArray) -> FloatArray:
    """(2, 2) what is left of the skin's bend under a body whose axis follows it, or some of it."""
    length, along = body.axis
    if length == 0 or body.follows == 0:
        return bend
    return np.asarray(bend - body.follows * float(along @ bend @ along) * np.outer(along, along))


def _pressures(
    body: Body, bend: FloatArray, stiffness: float, depth: float, points: FloatArray
) -> FloatArray:
    """(m,) pressure at points (m, 2) of the plane [Pa]."""
    gap = _gaps(body, bend, points)
    return np.minimum(stiffness * np.clip(depth - gap, 0.0, None), body.ceiling)


def _gaps(body: Body, bend: FloatArray, points: FloatArray) -> FloatArray:
    """(m,) distance between body and skin at points (m, 2) before it sinks in [m]."""
    length, direction = body.axis
    away = points - body.middle
    along = away @ direction
    across = away @ np.array([-direction[1], direction[0]])
    beyond = np.clip(np.abs(along) - 0.5 * length, 0.0, None)
    squared = across**2 + beyond**2
    round_off = body.radius - np.sqrt(np.clip(body.radius**2 - squared, 0.0, None))
    sag = 0.5 * np.einsum("ij,jk,ik->i", away, bend, away)
    gap = round_off + 0.5 * body.bow * along**2 + sag + away @ np.array(body.lean)
    return np.where(squared < body.radius**2, gap, np.inf)


def _search(body: Body, bend: FloatArray, stiffness: float) -> tuple[FloatArray, float]:
    """Points (m, 2) of a grid over the place where a body can touch, and the area of each [m2]."""
    length, first = body.axis
    guess = np.sqrt(body.force / (np.pi * stiffness * body.radius))  # a bar may stand on one end
    wide = min(body.radius, 1.6 * np.sqrt(2.0 * body.radius * guess) + SEEK)
    along = np.linspace(-0.5 * length - wide, 0.5 * length + wide, STEPS[0])
    across = np.linspace(-wide, wide, STEPS[1])
    second = np.array([-first[1], first[0]])
    grid = body.middle + along[:, None, None] * first + across[None, :, None] * second
    area = float((along[1] - along[0]) * (across[1] - across[0]))
    return grid.reshape(-1, 2), area

"""Boards and links of the real iCub, and simulated evidence of where the taxels are.

The truth are the taxels of the built-in iCub; a board is the flat map of a patch, of at most 16
modules round a random one. Evidence is made from the truth with noise of known spread.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

import skinmap
from calibration import Touch
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import turn_about
from skinmap.geometry.triangles import unit

MAX_MODULES = 16
FELT = 4e-3  # width of what a taxel feels [m]
LEAST = 0.08  # share of its largest value that counts as felt
GAIN = 0.25  # spread of the taxels' gains
TRIANGLE = 12e-3  # longest side of a triangle of taxels that is skin [m]


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """A patch: part, board (n, 2), true places (n, 3) [m], modules (n,) and its link's mesh."""

    part: str
    layout: FloatArray
    truth: FloatArray
    modules: IntArray
    vertices: FloatArray
    faces: IntArray


def icub_cases() -> Iterator[Case]:
    """All patches of the iCub."""
    robot = skinmap.load_robot("icub")
    for part in robot.parts:
        skin = robot.skin(part)
        link = robot.mesh(skin.link)
        for chart in skinmap.flatten(skinmap.build_surface(skin)).charts:
            keep = _some_modules(skin.modules[chart.taxels], chart.uv)
            taxels = chart.taxels[keep]
            yield Case(
                part,
                chart.uv[keep],
                skin.positions[taxels],
                skin.modules[taxels],
                link.vertices,
                link.faces,
            )


def _some_modules(modules: IntArray, uv: FloatArray) -> FloatArray:
    names = np.unique(modules)
    middle = np.array([uv[modules == name].mean(axis=0) for name in names])
    first = np.random.default_rng(0).integers(len(names))
    order = np.argsort(np.linalg.norm(middle - middle[first], axis=1))
    return np.isin(modules, names[order[:MAX_MODULES]])


def normalised(error: FloatArray, covariance: FloatArray) -> float:
    """Mean square of errors (n, 3) in their stated spreads (n, 3, 3): 1 where these are true."""
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    return float(square.mean() / 3)


def displaced(
    middle: FloatArray, rng: np.random.Generator, angle: float, distance: float
) -> FloatArray:
    """T (4, 4) that turns by an angle about a random axis through a point, and shifts [m]."""
    turn, way = unit(rng.normal(size=(2, 3)))
    return turn_about(middle, Rotation.from_rotvec(angle * turn).as_matrix(), distance * way)


def counted(words: Iterable[object]) -> dict[str, int]:
    """How often each word comes, by its name."""
    return dict(sorted(Counter(map(str, words)).items()))


def far_apart(layout: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """Taxels (count,) of a board, each the furthest from those before."""
    start = layout[rng.integers(len(layout))]
    chosen = [int(np.argmax(np.linalg.norm(layout - start, axis=1)))]
    while len(chosen) < count:
        gap = np.linalg.norm(layout[:, None] - layout[chosen][None], axis=2).min(axis=1)
        chosen.append(int(np.argmax(gap)))
    return np.array(chosen)


def simulate_touches(
    case: Case,
    count: int,
    rng: np.random.Generator,
    *,
    noise: float,
    wrong: float = 0.0,
    dead: float = 0.0,
    one_module: bool = False,
) -> list[Touch]:
    """Touches at random places; `wrong` of them have the place of another taxel."""
    corners = Delaunay(case.layout).simplices
    sides = case.layout[corners] - case.layout[np.roll(corners, 1, axis=1)]
    corners = corners[np.linalg.norm(sides, axis=2).max(axis=1) < TRIANGLE]
    if one_module:
        own = case.modules == case.modules[rng.integers(len(case.modules))]
        corners = corners[own[corners].all(axis=1)]
    n = len(case.layout)
    gain = np.exp(rng.normal(0.0, GAIN, n)) * (rng.random(n) >= dead)
    touches: list[Touch] = []
    while len(touches) < count:
        place = rng.dirichlet([1.0] * 3) @ case.truth[corners[rng.integers(len(corners))]]
        value = gain * np.exp(-np.sum((case.truth - place) ** 2, axis=1) / (2 * FELT**2))
        felt = np.flatnonzero(value > LEAST)
        if len(felt) == 0:
            continue
        if rng.random() < wrong:
            place = case.truth[rng.integers(n)]
        touches.append(Touch(place + rng.normal(0.0, noise, 3), noise, felt, value[felt]))
    return touches

"""Minima of the sheet model's cost: from several starts, through annealed stiffness, to few.

Starts of the wrap: a board laid on a surface through the surface's own flat coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree

from calibration.patch.link_surface import THIN, Board, Target, facing, shortening
from calibration.patch.sheet_model import (
    ROUGHLY,
    SAME,
    SETTLED,
    STAGES,
    Evidence,
    State,
    apart,
    linearise,
    settle,
)
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.triangles import pair_lengths

REACH = 1.25  # of a log map, in sizes of the board: paths along edges are a tenth longer
NEAR = 12  # surface points whose coordinates place one taxel


def log_map_start(
    target: Target, layout: FloatArray, places: FloatArray, points: FloatArray, source: FloatArray
) -> FloatArray:
    """Taxels (n, 3) [m] where a log map around a source point (3,) puts the layout (n, 2).

    The log map gives the surface plane coordinates; the layout is moved there by the rigid
    motion that takes known places (k, 2) of it best to their points (k, 3), and carried back to
    the surface. What lies beyond the map's reach is carried on in the plane of its nearest
    known points.
    """
    laid = []
    for vertices, uv, there in _maps(target, layout, points, source):
        turn, shift = rigid_2d(places, there)
        missed = float(np.linalg.norm(places @ turn.T + shift - there, axis=1).mean())
        laid.append((missed, vertices, uv, layout @ turn.T + shift))
    _, vertices, uv, wanted = min(laid, key=lambda one: one[0])
    # Where the map overlaps itself (round a limb) the place on the near side counts: the
    # nearest few in the plane, of those the ones on the sheet of the nearest one.
    _, index = cKDTree(uv).query(wanted, k=min(NEAR, len(uv)))
    return _moving_affine(vertices, uv, wanted, index)


def log_map_places(target: Target, layout: FloatArray, points: FloatArray) -> list[FloatArray]:
    """Plane coordinates (k, 2) [m] of points (k, 3) in a log map round their middle.

    One array for each side of the surface: two where it is a thin shell.
    """
    middle = points[np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1))]
    return [there for _, _, there in _maps(target, layout, points, middle)]


def _maps(
    target: Target, layout: FloatArray, points: FloatArray, source: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Vertices (m, 3) within reach, plane coordinates (m, 2), those (k, 2) of points (k, 3)."""
    reach = REACH * float(np.linalg.norm(np.ptp(layout, axis=0))) + 0.02
    for seed in _seeds(target, source):
        uv, _ = log_map(target.vertices, target.normals, target.graph, seed, reach)
        known = np.isfinite(uv[:, 0])
        vertices, uv = target.vertices[known], uv[known]
        yield vertices, uv, uv[_on_the_near_side(vertices, uv, points)]


def _seeds(target: Target, source: FloatArray) -> list[int]:
    """The vertex at a point, and the one behind it where the surface is a thin shell there."""
    away = np.linalg.norm(target.vertices - source, axis=1)
    nearest = int(np.argmin(away))
    behind = target.normals @ target.normals[nearest] < -0.5
    other = int(np.argmin(np.where(behind, away, np.inf)))
    thin = behind.any() and away[other] < away[nearest] + THIN
    return [nearest, other] if thin else [nearest]


def _on_the_near_side(vertices: FloatArray, uv: FloatArray, points: FloatArray) -> IntArray:
    """Vertices (k,) at points (k, 3); of a shell's two sides the one that is less far away."""
    away, index = cKDTree(vertices).query(points, k=min(NEAR, len(vertices)))
    way = np.where(away < away[:, :1] + THIN, np.linalg.norm(uv[index], axis=2), np.inf)
    # Neighbours on one side are a few millimetres apart on the way too: the nearest of them.
    same = way < way.min(axis=1, keepdims=True) + 2.0 * THIN
    return np.asarray(index[np.arange(len(points)), np.argmax(same, axis=1)])


def rigid_2d(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation (2, 2), never a mirror image, and shift (2,) that take points a (k, 2) to b."""
    middle_a, middle_b = a.mean(axis=0), b.mean(axis=0)
    left, _, right = np.linalg.svd((b - middle_b).T @ (a - middle_a))
    fix = np.diag([1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    turn = left @ fix @ right
    return turn, middle_b - turn @ middle_a


def _moving_affine(
    vertices: FloatArray, uv: FloatArray, wanted: FloatArray, index: IntArray
) -> FloatArray:
    """Points (n, 3) for plane coordinates (n, 2): the affine map of the nearest known ones."""
    local, places = uv[index], vertices[index]
    # Points of another turn round the limb come close in the plane but not in space.
    same = (
        np.linalg.norm(places - places[:, :1], axis=2)
        < 5.0 * np.linalg.norm(local - local[:, :1], axis=2) + 4e-3
    )
    weight = same.astype(float)
    total = weight.sum(axis=1, keepdims=True)
    middle_uv = np.einsum("nk,nkd->nd", weight, local) / total
    middle = np.einsum("nk,nkd->nd", weight, places) / total
    du, dx = local - middle_uv[:, None], places - middle[:, None]
    gram = np.einsum("nk,nki,nkj->nij", weight, du, du) + 1e-10 * np.eye(2)
    cross = np.einsum("nk,nki,nkj->nij", weight, du, dx)
    linear = np.linalg.solve(gram, cross)
    return middle + np.einsum("ni,nij->nj", wanted - middle_uv, linear)


STARTS = 3  # from how many places a board is laid at first: most patches need three
BEST, ROUNDS = 3, 2  # minima that are settled as flat maps of where they lie, and how often
MORE = 3  # times the starts, where the first ones fit badly
HOPELESS = 100.0  # times the cost of a minimum: folded, no steps would unfold it
GOOD = 8.0  # cost for each anchor or touch: three coordinates, and lengths and heights that fit
AGREED = 2.0 * GOOD  # the same where all starts that did not fold led to one place
FOLDED = 0.1  # ratio of lengths below which a sheet has collapsed: no strain means anything
FLAT_STEPS = 12  # of Gauss and Newton, at most, that lay a surface's lengths flat


@dataclass(frozen=True, eq=False, slots=True)
class Minimum:
    """A state that the cost cannot be improved from.

    Attributes
    ----------
    board : Board
        With the strain that is expected there.
    state : State
    cost : float
    hessian : (3n + m + 1, 3n + m + 1) float
        Gauss-Newton matrix.
    """

    board: Board
    state: State
    cost: float
    hessian: FloatArray

    @classmethod
    def at(cls, target: Target, board: Board, evidence: Evidence, state: State) -> Minimum:
        """Of a state that has settled."""
        cost, _, hessian = linearise(target, board, evidence, state)
        return cls(board, state, cost, hessian)


def find_minima(
    target: Target,
    board: Board,
    evidence: Evidence,
    first: BoolArray,
    *,
    starts: int = STARTS,
    patient: bool = True,
    rng: np.random.Generator,
) -> list[Minimum]:
    """Distinct minima of the cost, the lowest first, from starts that fit some (k,) evidence.

    What fits badly from a few starts gets more of them where one is `patient`.
    """
    places = evidence.blend[first] @ board.layout
    points = evidence.points[first]
    order = rng.permutation(len(points))
    sources = [points.mean(axis=0), *points[order[: MORE * starts - 1]]]
    close, normals = target.project(points)
    above = float(np.median(np.einsum("kd,kd->k", points - close, normals)))
    nothing = np.zeros(len(board.firmness))
    found: list[Minimum] = []
    passed: list[list[State]] = [[] for _ in STAGES[:-1]]
    alone = True  # whether all starts that did not fold led to one minimum
    # Most patches need the first starts only; those that fit badly, and differ, get the others.
    for some in (sources[:starts], sources[starts:]):
        fair = AGREED if alone else GOOD
        if found and (not patient or found[0].cost < fair * len(evidence)):
            break
        soft: list[State] = []
        for source in some:
            start = State(
                log_map_start(target, board.layout, places, points, source), nothing, above
            )
            state = _softly(target, board, evidence, start, passed)
            if state is not None:
                soft.append(state)
        costs = [linearise(target, board, evidence, state)[0] for state in soft]
        for row in np.argsort(costs, kind="stable"):
            if found and costs[row] > HOPELESS * min(minimum.cost for minimum in found):
                continue
            known = [minimum.state for minimum in found]
            final = settle(
                target, board, evidence, soft[row],
                stages=STAGES[-1:], known=known,
            )  # fmt: skip
            if all(apart(final, other) > SAME for other in known):
                found.append(Minimum.at(target, board, evidence, final))
        found.sort(key=lambda minimum: minimum.cost)
        alone = alone and len(found) == 1
    return _as_flat_maps(target, found, evidence)


def _as_flat_maps(target: Target, found: list[Minimum], evidence: Evidence) -> list[Minimum]:
    """The best minima again, each with the board as a flat map of where it lies there."""
    settled: list[Minimum] = []
    for minimum in found[:BEST]:
        board, state = minimum.board, minimum.state
        for _ in range(ROUNDS):
            board = expecting(target, board, state)
            state = settle(target, board, evidence, state, stages=STAGES[-1:])
        if all(apart(state, other.state) > SAME for other in settled):
            settled.append(Minimum.at(target, board, evidence, state))
    return sorted(settled, key=lambda minimum: minimum.cost)


def _softly(
    target: Target, board: Board, evidence: Evidence, state: State, passed: list[list[State]]
) -> State | None:
    """Carry a start through all stages but the last; None once it is where another one passed.

    `passed` holds the states after each of these stages and grows with those that are new.
    """
    for stiff, others in zip(STAGES[:-1], passed, strict=True):
        state = settle(
            target, board, evidence, state,
            stages=(stiff,), settled=ROUGHLY, known=others,
        )  # fmt: skip
        if any(apart(state, other) < SAME for other in others):
            return None
        others.append(state)
    return state


def expecting(target: Target, board: Board, state: State) -> Board:
    """The board as a flat map of where a state has it: with the strain that this implies.

    The sheet is put on the surface at its common height, its lengths there are laid flat by least
    squares over the same pairs, and what that map stretches is what the layout is expected to.
    Rigid modules are put as plates on both, which says how their gaps open and corners rise.
    """
    close, normals = target.project(state.positions, facing(board, state.positions))
    on = close + state.height * normals
    lengths = pair_lengths(on, board.pairs) / shortening(on, normals, board.pairs)
    drawn = _laid_flat(board, lengths)
    placed = _as_plates(board, on)
    drawn = _as_plates(board, drawn)
    below, out = target.project(placed, facing(board, placed))
    rise = np.einsum("nd,nd->n", placed - below, out) - state.height
    longer = pair_lengths(placed, board.pairs) / np.maximum(
        pair_lengths(drawn, board.pairs), SETTLED
    )
    return replace(
        board,
        expected=np.log(np.maximum(longer, FOLDED) / shortening(placed, out, board.pairs)),
        rise=rise if board.plates else board.rise,
    )


def _as_plates(board: Board, places: FloatArray) -> FloatArray:
    """Places (n, 2 or 3) with each rigid module moved, as it was drawn, to where they have it."""
    moved = places.copy()
    for rows in board.plates:
        drawn = board.layout[rows] - board.layout[rows].mean(axis=0)
        middle = places[rows].mean(axis=0)
        left, _, right = np.linalg.svd((places[rows] - middle).T @ drawn, full_matrices=False)
        moved[rows] = middle + drawn @ (left @ right).T
    return moved


def _laid_flat(board: Board, lengths: FloatArray) -> FloatArray:
    """Places in the plane (n, 2) whose distances are nearest to given lengths (p,) of the pairs."""
    places, n = board.layout * float(np.median(lengths / board.lengths)), len(board.layout)
    weight = 1.0 / board.spread**2
    for _ in range(FLAT_STEPS):
        step = board.ends @ places
        drawn = np.linalg.norm(step, axis=1)
        along = step / np.maximum(drawn, 1e-12)[:, None]
        normal = np.empty((2 * n, 2 * n))
        force = np.empty(2 * n)
        for a in range(2):
            force[a::2] = board.ends.T @ (weight * (drawn - lengths) * along[:, a])
            for b in range(2):
                block = weight * along[:, a] * along[:, b]
                normal[a::2, b::2] = (board.ends.T @ (block[:, None] * board.ends)).toarray()
        # Rigid motions are free: a trace of damping holds them.
        normal[np.diag_indices(2 * n)] *= 1.0 + 1e-6
        move = cho_solve(cho_factor(normal, check_finite=False), -force, check_finite=False)
        places = places + move.reshape(-1, 2)
        if np.abs(move).max() < SETTLED:
            break
    return places

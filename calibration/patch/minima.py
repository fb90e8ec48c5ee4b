"""Minima of the sheet model's cost: from several starts, through annealed stiffness, to few."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.patch.board import Board
from calibration.patch.expected_strain import expecting
from calibration.patch.initial_guess import log_map_start
from calibration.patch.link_surface import Target
from calibration.patch.sheet_model import (
    ROUGHLY,
    SAME,
    STAGES,
    Evidence,
    State,
    apart,
    linearise,
    settle,
)
from calibration.patch.solver_budget import FULL, Effort
from skinmap.arrays import BoolArray, FloatArray

BEST, ROUNDS = 3, 2  # minima that are settled as flat maps of where they lie, and how often
MORE = 3  # times the starts, where the first ones fit badly
HOPELESS = 100.0  # times the cost of a minimum: folded, no steps would unfold it
GOOD = 8.0  # cost for each anchor or touch: three coordinates, and lengths and heights that fit
AGREED = 2.0 * GOOD  # the same where all starts that did not fold led to one place


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


def find_minima(
    target: Target,
    board: Board,
    evidence: Evidence,
    first: BoolArray,
    *,
    effort: Effort = FULL,
    patient: bool = True,
    rng: np.random.Generator,
) -> list[Minimum]:
    """Distinct minima of the cost, the lowest first, from starts that fit some (k,) evidence.

    What fits badly from a few starts gets more of them where one is `patient`.
    """
    places = evidence.blend[first] @ board.layout
    points = evidence.points[first]
    order = rng.permutation(len(points))
    sources = [points.mean(axis=0), *points[order[: MORE * effort.starts - 1]]]
    close, normals = target.project(points)
    above = float(np.median(np.einsum("kd,kd->k", points - close, normals)))
    nothing = np.zeros(len(board.firmness))
    found: list[Minimum] = []
    passed: list[list[State]] = [[] for _ in STAGES[:-1]]
    alone = True  # whether all starts that did not fold led to one minimum
    # Most patches need the first starts only; those that fit badly, and differ, get the others.
    for some in (sources[: effort.starts], sources[effort.starts :]):
        fair = AGREED if alone else GOOD
        if found and (not patient or found[0].cost < fair * len(evidence)):
            break
        soft: list[State] = []
        for source in some:
            start = State(
                log_map_start(target, board.layout, places, points, source), nothing, above
            )
            state = _softly(target, board, evidence, start, passed, effort.steps)
            if state is not None:
                soft.append(state)
        costs = [linearise(target, board, evidence, state)[0] for state in soft]
        for row in np.argsort(costs, kind="stable"):
            if found and costs[row] > HOPELESS * min(minimum.cost for minimum in found):
                continue
            known = [minimum.state for minimum in found]
            final = settle(
                target, board, evidence, soft[row],
                stages=STAGES[-1:], steps=effort.steps, known=known,
            )  # fmt: skip
            if all(apart(final, other) > SAME for other in known):
                cost, _, hessian = linearise(target, board, evidence, final)
                found.append(Minimum(board, final, cost, hessian))
        found.sort(key=lambda minimum: minimum.cost)
        alone = alone and len(found) == 1
    return _as_flat_maps(target, found, evidence, effort.steps)


def _as_flat_maps(
    target: Target, found: list[Minimum], evidence: Evidence, steps: int
) -> list[Minimum]:
    """The best minima again, each with the board as a flat map of where it lies there."""
    settled: list[Minimum] = []
    for minimum in found[:BEST]:
        board, state = minimum.board, minimum.state
        for _ in range(ROUNDS):
            board = expecting(target, board, state)
            state = settle(target, board, evidence, state, stages=STAGES[-1:], steps=steps)
        if all(apart(state, other.state) > SAME for other in settled):
            cost, _, hessian = linearise(target, board, evidence, state)
            settled.append(Minimum(board, state, cost, hessian))
    return sorted(settled, key=lambda minimum: minimum.cost)


def _softly(
    target: Target,
    board: Board,
    evidence: Evidence,
    state: State,
    passed: list[list[State]],
    steps: int,
) -> State | None:
    """Carry a start through all stages but the last; None once it is where another one passed.

    `passed` holds the states after each of these stages and grows with those that are new.
    """
    for stiff, others in zip(STAGES[:-1], passed, strict=True):
        state = settle(
            target, board, evidence, state,
            stages=(stiff,), steps=steps, settled=ROUGHLY, known=others,
        )  # fmt: skip
        if any(apart(state, other) < SAME for other in others):
            return None
        others.append(state)
    return state

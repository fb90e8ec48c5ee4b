"""Wrapping a board on a link: from its flat layout and a few anchors to where every taxel is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibration.patch.evidence import check_anchors, check_layout, check_link
from calibration.patch.initial_guess import log_map_start
from calibration.patch.link_surface import Target, make_target
from calibration.patch.patch_calibration import PatchCalibration
from calibration.patch.sheet_model import (
    ROUGHLY,
    SAME,
    STAGES,
    Board,
    Evidence,
    State,
    apart,
    linearise,
    make_board,
    settle,
)
from calibration.patch.solver_budget import FULL, Effort
from calibration.patch.status import judge
from calibration.threads import one_thread
from skinmap.arrays import BoolArray, FloatArray

MORE = 3  # times the starts, where the first ones fit badly
HOPELESS = 100.0  # times the cost of a minimum: folded, no steps would unfold it
GOOD = 8.0  # cost for each anchor or touch: three coordinates, and lengths and heights that fit
AGREED = 2.0 * GOOD  # the same where all starts that did not fold led to one place


@dataclass(frozen=True, eq=False, slots=True)
class Minimum:
    """A state that the cost cannot be improved from, its cost and its Gauss-Newton matrix."""

    state: State
    cost: float
    hessian: FloatArray


def wrap_layout(
    layout: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    anchor_indices: ArrayLike,
    anchor_points: ArrayLike,
    *,
    anchor_sigma: ArrayLike = 1e-3,
    effort: Effort = FULL,
    rng: np.random.Generator,
) -> PatchCalibration:
    """Lay a flat board on a link so that lengths hold and the anchors are where they should be.

    Parameters
    ----------
    layout : (n, 2) array-like of float
        Taxels on the flat board, seen from outside [m].
    vertices, faces : (v, 3) array-like of float, (f, 3) array-like of int
        The link's mesh [m]; it may be open, doubled or partly inside out.
    anchor_indices : (k,) array-like of int
        Taxels whose place is known; at least three, not in a row.
    anchor_points : (k, 3) array-like of float
        Where they are, in the frame of the mesh [m].
    anchor_sigma : float
        Standard deviation of each coordinate of an anchor [m].
    effort : Effort
        Starts, steps and detail of the wrap.
    rng : numpy.random.Generator
        Where the starts are taken.

    Returns
    -------
    PatchCalibration

    Raises
    ------
    InvalidArrayError
        NaN, wrong shapes, fewer than three anchors, anchors in a row or twice, a taxel that the
        layout lacks, lengths in other units than metres (names the factor).
    InvalidMeshError
        An empty mesh, or one that the anchors are far from.
    """
    board_layout = check_layout(layout)
    link = check_link(vertices, faces)
    anchors = check_anchors(board_layout, link, anchor_indices, anchor_points, anchor_sigma)
    target = make_target(*link, detail=effort.detail)
    board = make_board(board_layout)
    every = np.ones(len(anchors), bool)
    with one_thread():
        minima = find_minima(target, board, anchors, every, effort=effort, rng=rng)
        return judge(target, board, anchors, minima, {"anchors": every})


def find_minima(
    target: Target,
    board: Board,
    evidence: Evidence,
    first: BoolArray,
    *,
    effort: Effort = FULL,
    rng: np.random.Generator,
) -> list[Minimum]:
    """Distinct minima of the cost, the lowest first, from starts that fit some (k,) evidence."""
    places = evidence.blend[first] @ board.layout
    points = evidence.points[first]
    order = rng.permutation(len(points))
    sources = [points.mean(axis=0), *points[order[: MORE * effort.starts - 1]]]
    close, normals = target.project(points)
    above = float(np.median(np.einsum("kd,kd->k", points - close, normals)))
    found: list[Minimum] = []
    passed: list[list[State]] = [[] for _ in STAGES[:-1]]
    alone = True  # whether all starts that did not fold led to one minimum
    # Most patches need the first starts only; those that fit badly, and differ, get the others.
    for some in (sources[: effort.starts], sources[effort.starts :]):
        fair = AGREED if alone else GOOD
        if found and found[0].cost < fair * len(evidence):
            break
        soft: list[State] = []
        for source in some:
            start = State(log_map_start(target, board.layout, places, points, source), 0.0, above)
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
                found.append(Minimum(final, cost, hessian))
        found.sort(key=lambda minimum: minimum.cost)
        alone = alone and len(found) == 1
    return found


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

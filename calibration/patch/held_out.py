"""Held-out error of a calibration: evidence is left out and predicted by the rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calibration.patch.evidence import FEWEST, check_layout, check_link
from calibration.patch.link_surface import make_target
from calibration.patch.patch_calibration import PatchCalibration
from calibration.patch.sheet_model import STAGES, Evidence, State, at_taxels, make_board, settle
from calibration.patch.solver_budget import FULL, Effort
from calibration.patch.touch import Touch, check_touches
from calibration.threads import one_thread
from skinmap.arrays import BoolArray, FloatArray, check_points
from skinmap.errors import InvalidArrayError

SETTLED = 20e-6  # held-out errors are above a tenth of a millimetre [m]
FOLDS = 5  # of touches


def held_out_errors(
    found: PatchCalibration,
    layout: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    anchor_indices: ArrayLike,
    anchor_points: ArrayLike,
    *,
    anchor_sigma: ArrayLike = 1e-3,
    effort: Effort = FULL,
) -> FloatArray:
    """Distance of each anchor from where a wrap without it puts its taxel.

    The wraps start at the one found with all anchors, so a wrong minimum of that one stays
    unseen here; the status is what warns of it. The distances hold the anchor's own error too.

    Parameters
    ----------
    found : PatchCalibration
        What `wrap_layout` made of the same arguments.
    layout, vertices, faces, anchor_indices, anchor_points, anchor_sigma, effort
        As for `wrap_layout`.

    Returns
    -------
    (k,) array of float
        [m]; empty for three anchors, as two cannot hold a patch.
    """
    points = check_points(anchor_points, "anchor_points")
    sigma = np.broadcast_to(np.asarray(anchor_sigma, np.float64), len(points))
    if len(points) <= FEWEST:
        return np.zeros(0)
    anchors = at_taxels(len(found), np.asarray(anchor_indices, np.int64), points, sigma)
    folds = list(np.eye(len(points), dtype=bool))
    return _errors(found, layout, vertices, faces, anchors, folds, effort)


def held_out_touches(
    found: PatchCalibration,
    layout: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    touches: Sequence[Touch],
    *,
    effort: Effort = FULL,
) -> FloatArray:
    """The same for touches, of which every fifth is left out at a time.

    Returns
    -------
    (k,) array of float
        [m]; empty for fewer than eight touches. Those that are wrong stand out.
    """
    if len(touches) < FEWEST + FOLDS:
        return np.zeros(0)
    felt = check_touches(check_layout(layout), check_link(vertices, faces), touches)
    folds = [np.arange(len(touches)) % FOLDS == fold for fold in range(FOLDS)]
    return _errors(found, layout, vertices, faces, felt, folds, effort)


def _errors(
    found: PatchCalibration,
    layout: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    evidence: Evidence,
    folds: Sequence[BoolArray],
    effort: Effort,
) -> FloatArray:
    board = make_board(check_layout(layout))
    if len(found) != len(board.layout):
        raise InvalidArrayError(
            f"the calibration has {len(found)} taxels, the layout {len(board.layout)}"
        )
    target = make_target(*check_link(vertices, faces), detail=effort.detail)
    start = State(found.positions, float(np.log(found.scale)), found.height)
    errors = np.empty(len(evidence))
    with one_thread():
        for out in folds:
            rest = evidence.only(~out)
            state = settle(
                target, board, rest, start,
                stages=STAGES[-1:], steps=effort.steps, settled=SETTLED,
            )  # fmt: skip
            _, normals = target.project(state.positions)
            missed = evidence.only(out).missed(state.positions, normals)
            errors[out] = np.linalg.norm(missed, axis=1)
    return errors

"""The strain that a board is expected to have where it lies: that of a flat map of this place.

No drawing keeps all lengths of a doubly curved surface (Gauss), and a board that lies on it well is
a flat map of it. What that map stretches is smooth and systematic; taken for independent errors of
a thousand lengths it would be cheaper to sink the sheet into the link.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from calibration.patch.board import Board, facing, pair_distances, shortening
from calibration.patch.link_surface import Target
from calibration.patch.sheet_model import SETTLED, State
from skinmap.arrays import FloatArray

FOLDED = 0.1  # ratio of lengths below which a sheet has collapsed: no strain means anything
FLAT_STEPS = 12  # of Gauss and Newton, at most, that lay a surface's lengths flat


def expecting(target: Target, board: Board, state: State) -> Board:
    """The board as a flat map of where a state has it: with the strain that this implies.

    The sheet is put on the surface at its common height, its lengths there are laid flat by least
    squares over the same pairs, and what that map stretches is what the layout is expected to.
    Rigid modules are put as plates on both, which says how their gaps open and corners rise.
    """
    close, normals = target.project(state.positions, facing(board, state.positions))
    on = close + state.height * normals
    lengths = pair_distances(on, board.pairs) / shortening(on, normals, board.pairs)
    drawn = _laid_flat(board, lengths)
    placed = _as_plates(board, on)
    drawn = _as_plates(board, drawn)
    below, out = target.project(placed, facing(board, placed))
    rise = np.einsum("nd,nd->n", placed - below, out) - state.height
    longer = pair_distances(placed, board.pairs) / np.maximum(
        pair_distances(drawn, board.pairs), SETTLED
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

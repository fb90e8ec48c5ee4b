"""Touches that agree with each other: their distances along the link are those on the board."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist, squareform

from calibration.patch.board import Board
from calibration.patch.link_surface import Target
from calibration.patch.sheet_model import Evidence
from skinmap.arrays import BoolArray, FloatArray

FEWEST = 3
# Lengths of paths along edges are up to a tenth above the shortest ways across the triangles.
LONGER, SHORTER = 0.12, 0.06
SLACK = 3.0  # standard deviations
AGREE = 0.7  # share of the touches held so far that another one must be consistent with


def consistent(target: Target, board: Board, felt: Evidence) -> BoolArray:
    """(k,) touches whose distances along the link are those on the board.

    Pairs are consistent or not; the largest eigenvector of that table ranks the touches
    (Leordeanu and Hebert, "A Spectral Technique for Correspondence Problems", ICCV 2005), and
    they are taken in that order while they agree with most of those taken before.
    """
    flat = squareform(pdist(felt.blend @ board.layout))
    along = surface_distances(target, felt.points)
    spread = SLACK * np.hypot(felt.sigma[:, None], felt.sigma[None])
    fits = (along - flat < LONGER * flat + spread) & (flat - along < SHORTER * flat + spread)
    np.fill_diagonal(fits, False)
    weight = np.ones(len(felt))
    for _ in range(30):
        weight = fits @ weight + 1e-9
        weight = weight / np.linalg.norm(weight)
    taken = np.zeros(len(felt), bool)
    for row in np.argsort(-weight, kind="stable"):
        if not taken.any() or fits[row, taken].mean() >= AGREE:
            taken[row] = True
    if taken.sum() < FEWEST:  # nothing agrees with anything: the status will say so
        taken[:] = True
    return taken


def surface_distances(target: Target, points: FloatArray) -> FloatArray:
    """(k, k) lengths of paths along the edges of the target between its vertices there [m]."""
    _, nearest = cKDTree(target.vertices).query(points)
    reach = 1.5 * float(pdist(points).max()) + 0.05
    length = dijkstra(target.graph, directed=False, indices=nearest, limit=reach)
    return np.minimum(np.asarray(length[:, nearest]), reach)

"""Where taxels are, from touches with a known probe: wrong touches and dead taxels do no harm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist, squareform

from calibration.patch.evidence import Link, check_anchors, check_layout, check_link, check_spread
from calibration.patch.link_surface import Target, make_target
from calibration.patch.patch_calibration import PatchCalibration
from calibration.patch.sheet_model import Board, Evidence, make_board
from calibration.patch.solver_budget import FULL, Effort
from calibration.patch.status import judge
from calibration.patch.wrap import find_minima
from calibration.threads import one_thread
from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, freeze
from skinmap.errors import InvalidArrayError
from skinmap.geometry.proximity import closest_on_mesh, median_spacing

FEWEST = 3
FAR = 0.05  # a touch further than this from the link cannot have touched it [m]
PLACE = 0.15  # of the pitch: how well the centre of activated taxels tells the place of a touch
# Lengths of paths along edges are up to a tenth above the shortest ways across the triangles.
LONGER, SHORTER = 0.12, 0.06
SLACK = 3.0  # standard deviations
AGREE = 0.7  # share of the touches held so far that another one must be consistent with


@dataclass(frozen=True, eq=False, slots=True)
class Touch:
    """A probe that touched the skin, and what was felt.

    Attributes
    ----------
    point : (3,) float
        Where the probe touched, in the frame of the mesh [m].
    sigma : float
        Standard deviation of each of its coordinates [m].
    channels : (k,) int
        Rows of the layout that felt it.
    values : (k,) float
        How much, in any unit; not negative.
    """

    point: FloatArray
    sigma: float
    channels: IntArray
    values: FloatArray

    def __post_init__(self) -> None:
        freeze(
            self,
            point=np.asarray(self.point, np.float64),
            channels=np.asarray(self.channels),
            values=np.asarray(self.values, np.float64),
        )


def locate_by_touch(
    layout: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    touches: Sequence[Touch],
    *,
    anchors: tuple[ArrayLike, ArrayLike] | None = None,
    anchor_sigma: ArrayLike = 1e-3,
    effort: Effort = FULL,
    rng: np.random.Generator,
) -> PatchCalibration:
    """Lay a flat board on a link by touches, with anchors or without.

    Touches whose distances along the link contradict those on the board are left out of the
    starts; in the solution every touch counts, by Cauchy's loss.

    Parameters
    ----------
    layout : (n, 2) array-like of float
        Taxels on the flat board, seen from outside [m].
    vertices, faces : (v, 3) array-like of float, (f, 3) array-like of int
        The link's mesh [m].
    touches : sequence of Touch
        At least three; `ok` needs eight, all over the patch.
    anchors : tuple of (k,) and (k, 3) array-like, optional
        Taxels whose place is known, and where they are [m].
    anchor_sigma : float
        Standard deviation of each coordinate of an anchor [m].
    effort : Effort
        Starts, steps and detail of the wrap.
    rng : numpy.random.Generator
        Where the starts are taken.

    Returns
    -------
    PatchCalibration
        With residuals of `touches`; `next_taxels` says where to touch next.

    Raises
    ------
    InvalidArrayError
        Too few touches, a channel that the layout lacks, NaN, other units (names the row).
    InvalidMeshError
        An empty mesh, or one that the anchors are far from.
    """
    board_layout = check_layout(layout)
    link = check_link(vertices, faces)
    felt = check_touches(board_layout, link, touches)
    evidence = felt
    if anchors is not None:
        evidence = _joined(felt, check_anchors(board_layout, link, *anchors, anchor_sigma))
    target, board = make_target(*link, detail=effort.detail), make_board(board_layout)
    kinds = {"touches": evidence.doubted, "anchors": ~evidence.doubted}
    kinds = {name: rows for name, rows in kinds.items() if rows.any()}
    with one_thread():
        first = kinds["anchors"] if anchors is not None else consistent(target, board, felt)
        minima = find_minima(target, board, evidence, first, effort=effort, rng=rng)
        return judge(target, board, evidence, minima, kinds)


def check_touches(layout: FloatArray, link: Link, touches: Sequence[Touch]) -> Evidence:
    """Touches as evidence: the centre of what was felt is where the probe was."""
    if len(touches) < FEWEST:
        raise InvalidArrayError(f"a patch needs at least {FEWEST} touches, got {len(touches)}")
    blend = np.zeros((len(touches), len(layout)))
    for row, touch in enumerate(touches):
        blend[row] = _shares(touch, row, len(layout))
    points = np.array([touch.point for touch in touches])
    sigma = np.array([touch.sigma for touch in touches])
    places = blend @ layout
    if np.median(pdist(places)) > 2.0 * median_spacing(layout):
        check_spread(places, points, "touches")
    distance, _, _ = closest_on_mesh(points, *link)
    far = np.flatnonzero(distance > FAR)
    if len(far) > len(touches) / 2:
        raise InvalidArrayError(
            f"touches {far.tolist()} lie up to {distance.max():.3g} m from the mesh: another "
            "link, frame or unit?"
        )
    spread = np.hypot(sigma, PLACE * median_spacing(layout))
    return Evidence(blend, points, spread, np.ones(len(touches), bool))


def _shares(touch: Touch, row: int, count: int) -> FloatArray:
    name = f"touch {row}"
    check_finite(touch.point, f"the point of {name}", (3,))
    values = check_finite(touch.values, f"the values of {name}", (None,))
    if not (np.isfinite(touch.sigma) and touch.sigma > 0):
        raise InvalidArrayError(f"the sigma of {name} must be above 0 m, got {touch.sigma}")
    if touch.channels.shape != values.shape or touch.channels.dtype.kind not in "iu":
        raise InvalidArrayError(
            f"{name} has {len(values)} values for channels of {touch.channels.dtype} "
            f"{touch.channels.shape}"
        )
    wrong = (touch.channels < 0) | (touch.channels >= count)
    if wrong.any():
        raise InvalidArrayError(
            f"{name} has taxel {touch.channels[wrong][0]}, the layout has 0..{count - 1}"
        )
    if (values < 0).any() or values.sum() <= 0:
        raise InvalidArrayError(f"{name} has no value above 0, or one below it")
    shares = np.bincount(touch.channels, values, minlength=count)
    return np.asarray(shares / shares.sum())


def _joined(one: Evidence, other: Evidence) -> Evidence:
    return Evidence(
        np.concatenate([one.blend, other.blend]),
        np.concatenate([one.points, other.points]),
        np.concatenate([one.sigma, other.sigma]),
        np.concatenate([one.doubted, other.doubted]),
    )


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

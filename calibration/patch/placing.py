"""Where the taxels of a board are on a link: by touches with a known probe, or by anchors.

What is wrong where a patch does not fit: each likely mistake is mended and tried.

A mistake counts as the cause where the mended input is consistent: every anchor is where the
others predict it. What keeps all anchors is tried first: the board drawn from its other side, in
another scale, two anchors whose names were exchanged; then each anchor is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist, squareform
from threadpoolctl import threadpool_limits

from calibration.patch.link_surface import Board, Target, make_board, make_target
from calibration.patch.minima import STARTS, find_minima, log_map_places, rigid_2d
from calibration.patch.patch_calibration import Doubt, PatchCalibration, Status
from calibration.patch.patch_evidence import (
    Link,
    check_anchors,
    check_layout,
    check_link,
    check_names,
    check_spread,
)
from calibration.patch.patch_status import judge
from calibration.patch.sheet_model import Evidence
from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, freeze
from skinmap.errors import InvalidArrayError
from skinmap.geometry.proximity import closest_on_mesh, median_spacing

FEWEST = 3  # anchors or touches that hold a patch
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


ONE = 1  # start of each trial: it only has to be better than what came
TRIED = 3  # anchors to leave out, and pairs to exchange, the most suspicious first
BETTER = 0.6  # times the misfit in the plane that an exchange must come to, to be tried at all
WIDE = 0.3  # of the scale where it is searched for, as a standard deviation
SCALED = 0.02  # a board whose scale is off by less is not called another one
CLEARER = 2.0  # times the cost by which the next best anchor must explain less
PRICE = 2.0  # of each number that a mended input may choose: Akaike's, on the scale of costs
# Contradictions; coverage or a wide spread is no mistake, only too little evidence.
MISTAKES = {Doubt.MISFIT, Doubt.STRETCHED, Doubt.FOLDED, Doubt.SCALE, Doubt.DISAGREE}


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """What was to be solved.

    Attributes
    ----------
    target : Target
    layout : (n, 2) float
        As it was tried: turned round already where `mirror` is set [m].
    modules : (n,) int or None
    evidence : Evidence
    channels : (n,) int
        What the taxels are called in messages.
    mirror : bool
        Whether the caller said that the board is drawn from its other side.
    seed : int
        Of the starts of each trial.
    """

    target: Target
    layout: FloatArray
    modules: IntArray | None
    evidence: Evidence
    channels: IntArray
    mirror: bool
    seed: int

    def name(self, row: int) -> int:
        """Channel of the taxel that an anchor or a touch is of most."""
        return int(self.channels[self.evidence.taxel(row)])

    def tried(
        self,
        layout: FloatArray,
        evidence: Evidence,
        *,
        wide: bool = False,
        patient: bool = False,
        rng: np.random.Generator | None = None,
    ) -> PatchCalibration:
        """The patch that some input gives, judged in the same way; by more starts if patient."""
        board = make_board(layout, self.modules)
        if wide:
            firmness = np.array(board.firmness)
            firmness[0] = 1.0 / WIDE**2
            board = replace(board, firmness=firmness)
        # Starts are fitted to anchors, or where there are none to the touches that agree.
        anchors = ~evidence.doubted
        minima = find_minima(
            self.target, board, evidence,
            anchors if anchors.any() else consistent(self.target, board, evidence),
            starts=STARTS if patient else ONE, patient=patient,
            rng=np.random.default_rng(self.seed) if rng is None else rng,
        )  # fmt: skip
        return judge(self.target, evidence, minima, self.channels)


def lay(
    layout: ArrayLike,
    link: tuple[ArrayLike, ArrayLike],
    gather: Callable[[FloatArray, Link, IntArray], Evidence],
    *,
    modules: ArrayLike | None,
    channels: ArrayLike | None,
    mirror: bool,
    rng: np.random.Generator | int,
) -> PatchCalibration:
    """A board checked and laid on its link, by what is gathered of layout, link and channels.

    The patch is judged, and explained where it is doubtful.
    """
    rng = np.random.default_rng(rng)
    flat = check_layout(layout) * ([-1.0, 1.0] if mirror else [1.0, 1.0])
    rows = np.arange(len(flat))
    names = rows if channels is None else check_names(channels, "channels", len(flat))
    plates = None if modules is None else check_names(modules, "modules", len(flat))
    mesh = check_link(*link)
    evidence = gather(flat, mesh, names)
    seed = int(rng.integers(2**32))
    problem = Problem(make_target(*mesh), flat, plates, evidence, names, mirror, seed)
    # One thread: matrices of one patch are too small for more, and sums in another order would end
    # in other bits.
    with threadpool_limits(limits=1, user_api="blas"):
        return explained(problem, problem.tried(flat, evidence, patient=True, rng=rng))


@dataclass(frozen=True, slots=True)
class Cause:
    """A mistake that explains what does not fit: its cost once it is mended, and words."""

    cost: float
    words: str


def explained(problem: Problem, found: PatchCalibration) -> PatchCalibration:
    """A doubtful patch with the mistake that explains it as its first reason, if there is one."""
    found = replace(found, mirrored=problem.mirror)
    if _consistent(found):
        return found
    cause = _mirrored(problem)
    if cause is not None:
        return _doubted(replace(found, mirrored=not problem.mirror), cause)
    anchors = np.flatnonzero(~problem.evidence.doubted)
    causes = [_scaled(problem), _exchanged(problem, anchors), _left_out(problem, anchors, found)]
    known = [cause for cause in causes if cause is not None]
    return _doubted(found, min(known, key=lambda cause: cause.cost)) if known else found


def _doubted(found: PatchCalibration, cause: Cause) -> PatchCalibration:
    return replace(found, status=Status.AMBIGUOUS, reasons=(cause.words, *found.reasons))


def _consistent(found: PatchCalibration) -> bool:
    return not MISTAKES & set(found.doubts)


def _mirrored(problem: Problem) -> Cause | None:
    trial = problem.tried(problem.layout * [-1.0, 1.0], problem.evidence)
    if not _consistent(trial):
        return None
    if problem.mirror:
        return Cause(trial.cost, "the board fits as it is drawn: leave --mirror (mirror=True) out")
    return Cause(
        trial.cost,
        "the board is drawn from the other side: its mirror image fits; use --mirror "
        "(mirror=True), or draw it as seen from outside. Where the mesh is open and its faces "
        "point inward, turn them instead",
    )


def _scaled(problem: Problem) -> Cause | None:
    trial = problem.tried(problem.layout, problem.evidence, wide=True)
    rest = set(trial.doubts) - {Doubt.SCALE}
    if MISTAKES & rest or abs(np.log(trial.scale)) < SCALED:
        return None
    larger = "large" if trial.scale < 1.0 else "small"
    return Cause(
        trial.cost + PRICE,
        f"the board is drawn {100 * abs(1.0 / trial.scale - 1.0):.1f} % too {larger}: "
        f"multiply the lengths of the layout by {trial.scale:.4f}",
    )


def _exchanged(problem: Problem, anchors: IntArray) -> Cause | None:
    if len(anchors) < FEWEST:
        return None
    evidence = problem.evidence
    places = evidence.blend[anchors] @ problem.layout
    sides = log_map_places(problem.target, problem.layout, evidence.points[anchors])
    now = min(_flat_misfit(places, there) for there in sides)
    pairs = list(combinations(range(len(anchors)), 2))
    misses = np.array([
        min(_flat_misfit(_exchange(places, pair), there) for there in sides) for pair in pairs
    ])  # fmt: skip
    causes = []
    for row in np.argsort(misses, kind="stable")[:TRIED]:
        if misses[row] > BETTER * now:
            break
        one, other = anchors[list(pairs[row])].tolist()
        swapped = replace(evidence, points=_exchange(evidence.points, (one, other)))
        trial = problem.tried(problem.layout, swapped)
        if _consistent(trial):
            first, second = problem.name(one), problem.name(other)
            words = (
                f"the anchors of channels {first} and {second} are exchanged: put right, they fit"
            )
            causes.append(Cause(trial.cost + PRICE, words))
    return min(causes, key=lambda cause: cause.cost, default=None)


def _exchange(rows: FloatArray, pair: tuple[int, int]) -> FloatArray:
    changed = rows.copy()
    changed[list(pair)] = rows[list(pair[::-1])]
    return changed


def _flat_misfit(places: FloatArray, there: FloatArray) -> float:
    """How badly a rigid motion lays places (k, 2) of a board on those of the surface [m]."""
    turn, shift = rigid_2d(places, there)
    return float(np.linalg.norm(places @ turn.T + shift - there, axis=1).sum())


def _left_out(problem: Problem, anchors: IntArray, found: PatchCalibration) -> Cause | None:
    evidence = problem.evidence
    if len(anchors) <= FEWEST:
        return None
    order = anchors[np.argsort(-found.left_out.misfit[anchors], kind="stable")]
    fits: list[tuple[float, int, PatchCalibration]] = []
    # The most suspicious one again and more patiently, where none explains anything.
    for row, patient in (*((row, False) for row in order[: TRIED + 1]), (order[0], True)):
        if fits and patient:
            break
        rest = evidence.only(np.arange(len(evidence)) != row)
        trial = problem.tried(problem.layout, rest, patient=patient)
        if _consistent(trial):
            fits.append((trial.cost, int(row), trial))
    if not fits:
        return None
    cost, row, trial = min(fits, key=lambda fit: fit[0])
    name, point = problem.name(row), evidence.points[row]
    away = float(np.linalg.norm(point - evidence.blend[row] @ trial.positions))
    words = (
        f"the anchor of channel {name} is misplaced or misnamed: by the others its taxel is "
        f"{1e3 * away:.1f} mm away"
    )
    nearest = int(np.argmin(np.linalg.norm(trial.positions - point, axis=1)))
    if nearest != int(np.argmax(evidence.blend[row])):
        words += f", and channel {problem.channels[nearest]} is where it was measured"
    rivals = [other for own, other, _ in fits if other != row and own < CLEARER * cost]
    if rivals:
        others = ", ".join(str(problem.name(other)) for other in rivals)
        words += f" (or it is that of {others}: measure these again)"
    return Cause(cost + 3.0 * PRICE, words)


FAR = 0.05  # a touch further than this from the link cannot have touched it [m]
PLACE = 0.15  # of the pitch: how well the centre of activated taxels tells the place of a touch
LONE = 0.3  # the same where one channel alone felt it: anywhere in its cell, of a deviation of .29


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
    modules: ArrayLike | None = None,
    channels: ArrayLike | None = None,
    mirror: bool = False,
    rng: np.random.Generator | int,
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
    modules : (n,) array-like of int, optional
        Rigid module of each taxel; without them the board is one flexible sheet.
    channels : (n,) array-like of int, optional
        What the taxels are called in messages; their rows by default.
    mirror : bool
        Whether the layout shows the board from its other side.
    rng : numpy.random.Generator or int
        Where the starts are taken; a number is its seed.

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

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> skin = robot.skin("left_hand")
    >>> link, board = robot.mesh(skin.link), skinmap.flatten(skinmap.build_surface(skin)).uv
    >>> touches = [
    ...     skinmap.Touch(skin.positions[row], 1e-3, channels=[row], values=[1.0])
    ...     for row in range(0, 144, 4)
    ... ]
    >>> skinmap.locate_by_touch(board, link.vertices, link.faces, touches, rng=0).status.value
    'ok'
    """

    def gather(flat: FloatArray, link: Link, names: IntArray) -> Evidence:
        felt = check_touches(flat, link, touches)
        if anchors is None:
            return felt
        return _joined(felt, check_anchors(flat, link, *anchors, anchor_sigma, names))

    return lay(
        layout, (vertices, faces), gather,
        modules=modules, channels=channels, mirror=mirror, rng=rng,
    )  # fmt: skip


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
    told = np.where((blend > 0.0).sum(axis=1) == 1, LONE, PLACE)
    spread = np.hypot(sigma, told * median_spacing(layout))
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


def wrap_layout(
    layout: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    anchor_indices: ArrayLike,
    anchor_points: ArrayLike,
    *,
    anchor_sigma: ArrayLike = 1e-3,
    modules: ArrayLike | None = None,
    channels: ArrayLike | None = None,
    mirror: bool = False,
    rng: np.random.Generator | int,
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
    modules : (n,) array-like of int, optional
        Rigid module of each taxel; without them the board is one flexible sheet.
    channels : (n,) array-like of int, optional
        What the taxels are called in messages; their rows by default.
    mirror : bool
        Whether the layout shows the board from its other side.
    rng : numpy.random.Generator or int
        Where the starts are taken; a number is its seed.

    Returns
    -------
    PatchCalibration
        Positions (n, 3) [m], their covariance, and whether they may be used.

    Raises
    ------
    InvalidArrayError
        NaN, wrong shapes, fewer than three anchors, anchors in a row or twice, a taxel that the
        layout lacks, lengths in other units than metres (names the factor).
    InvalidMeshError
        An empty mesh, or one that the anchors are far from.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> skin = robot.skin("left_hand")
    >>> link, board = robot.mesh(skin.link), skinmap.flatten(skinmap.build_surface(skin)).uv
    >>> known = range(0, 144, 16)
    >>> found = skinmap.wrap_layout(
    ...     board, link.vertices, link.faces, known, skin.positions[known], rng=0
    ... )
    >>> found.status.value, bool(abs(found.positions - skin.positions).max() < 2e-3)
    ('ok', True)
    """
    return lay(
        layout, (vertices, faces),
        lambda flat, link, names: check_anchors(
            flat, link, anchor_indices, anchor_points, anchor_sigma, names
        ),
        modules=modules, channels=channels, mirror=mirror, rng=rng,
    )  # fmt: skip

"""Whether a wrapped patch may be trusted: coverage, second minima, predicted errors, directions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull, cKDTree
from scipy.special import chdtri

from calibration.patch.link_surface import SCALE, Board, Target, chords, facing
from calibration.patch.minima import Minimum
from calibration.patch.patch_calibration import (
    Doubt,
    LeftOut,
    PatchCalibration,
    Status,
    leave_one_out,
)
from calibration.patch.sheet_model import ROUGHLY, Evidence
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.topology import border_edges
from skinmap.geometry.triangles import unit
from skinmap.summary import first_few

COVERAGE = 0.25  # share of the patch inside the hull of its evidence
# A second minimum that costs less than this much more is as good: costs are twice a log likelihood,
# so the best is at most 20 times as likely. With four anchors as with many touches.
RIVAL = 6.0
# Mean square of a coordinate along the skin of an anchor that the others predict, over what is
# expected of it: honest noise of two coordinates exceeds it once in 1,100 anchors (chi squared of
# 14), which refuses 0.4 to 0.8 % of honest runs with 4 to 8 of them. An anchor that is 9 mm off has
# 12 to 35 as a rule, and 4 to 7 where the noise of the others hides it.
CONTRADICTION = 7.0
# The cost of honest boards by 4, 6 and 8 anchors (150 of the family and the iCub) has medians of
# 7.2, 13.0 and 20.7: those of chi squared with three degrees of freedom an anchor, less four.
PLACED = 4
UNLIKELY = 5e-4  # chance that an honest board costs as much
TOUCHED = 0.4  # as COVERAGE, for touches, of which there are many
FEWEST_TOUCHES = 8  # fewer cannot show which of them are wrong
AGREES = 3.0  # residual of a touch over its spread, in space
ENOUGH_AGREE = 0.5  # of all touches
NEXT = 3  # places to measure next that are named
# Linearised covariances know of one minimum only. Beyond the hull of evidence that covers too
# little a sheet may lie in a neighbouring one: on the iCub's 23 patches with all touches on one
# module errors grow by 3 % of the distance from the hull (normalised error squared 1.3; without
# that 7.0).
ASTRAY = 0.03
STRETCHED = 0.03  # rms of strain that was not expected: above, this is not the board
OFF_SCALE = 3.5  # standard deviations of the scale: above, the board is drawn in another one
# A sheet follows an edge that its evidence does not reach, where the board may stand out straight
# (by a circle's bend, 45 degrees in 15 mm are a radius of 19 mm). On tubes its evidence bends too.
EDGE, SHARPER = np.radians(45.0), 1.5  # turn of a pair, and times the sharpest inside the hull
FAR_ON_BOARD, ON_ITSELF = 3.0, 0.5  # pitches on the board and in space of taxels that overlap
FOLDED = 0.1  # share of the sheet that faces inward: above, it is folded

STATUS = {
    Doubt.WIDE: Status.UNOBSERVABLE,
    Doubt.COVERAGE: Status.LOW_COVERAGE,
    Doubt.FEW: Status.LOW_COVERAGE,
    Doubt.EDGE: Status.LOW_COVERAGE,
    Doubt.UNSETTLED: Status.NOT_SETTLED,
}  # that a doubt comes to; all others leave the patch ambiguous
Finding = tuple[Doubt, str]


def judge(
    target: Target, evidence: Evidence, minima: list[Minimum], channels: IntArray
) -> PatchCalibration:
    """The lowest minimum as a calibration, with its covariance, status and reasons.

    Parameters
    ----------
    target : Target
    evidence : Evidence
        Anchors, and touches where it is doubted.
    minima : list of Minimum
        The lowest first.
    channels : (n,) int
        What the taxels are called in messages.
    """
    best = minima[0]
    board = best.board
    x = best.state.positions
    n = len(x)
    spacing = median_spacing(board.layout)
    inverse = np.asarray(np.linalg.inv(best.hessian), np.float64)
    everything: FloatArray = np.reshape(inverse[: 3 * n, : 3 * n], (n, 3, n, 3))
    covariance = everything[np.arange(n), :, np.arange(n), :]
    covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
    faces = facing(board, x)
    _, normals = target.project(x, faces)
    missed = evidence.missed(x, normals)
    left_out = leave_one_out(everything, evidence, missed, normals)
    relative = missed / evidence.sigma[:, None]
    agrees = ~evidence.doubted | ((relative**2).sum(axis=1) < AGREES**2)
    places = evidence.blend[agrees] @ board.layout
    share = coverage(board.layout, places)
    needed = TOUCHED if evidence.doubted.any() else COVERAGE
    # Anchors that miss more than their stated errors explain widen them.
    stated = max(1.0, best.cost / (_freedom(evidence) or np.inf)) * covariance
    if share < needed:
        astray = ASTRAY * _beyond(board.layout, places)
        stated = stated + astray[:, None, None] ** 2 * np.eye(3)
    chord, _, wanted = chords(board, x, normals)
    strain = chord / wanted - 1.0
    expected = np.exp(board.expected + board.fields @ best.state.strain) - 1.0
    unexpected = (1.0 + strain) / (1.0 + expected) - 1.0
    found = [
        *_folded(target, x, faces, normals),
        *_overlapping(board, x, normals, channels),
        *_contradictions(evidence, left_out, channels),
        *_ill_fitting(evidence, best.cost, unexpected, best.state.scale),
        *_unobservable(x, covariance, spacing),
        *_ambiguous(minima, spacing, channels),
        *_too_little(evidence, agrees, share, needed),
        *_round_an_edge(board, faces, places, channels),
        *_unsettled(best.state.moved),
    ]
    kinds = {"anchors": ~evidence.doubted, "touches": evidence.doubted}
    residuals = {name: relative[rows] for name, rows in kinds.items() if rows.any()}
    return PatchCalibration(
        x,
        normals,
        stated,
        STATUS.get(found[0][0], Status.AMBIGUOUS) if found else Status.OK,
        tuple(reason for _, reason in found),
        doubts=tuple(doubt for doubt, _ in found),
        residuals={**residuals, "strain": unexpected},
        left_out=left_out,
        strain=strain,
        expected_strain=expected,
        pairs=board.pairs,
        cost=best.cost,
        scale=best.state.scale,
        height=best.state.height,
        coverage=share,
        weakest=weakest_motion(x, covariance),
        next_taxels=best_next(everything, float(np.median(evidence.sigma)), NEXT),
    )


def _folded(
    target: Target, positions: FloatArray, faces: FloatArray, normals: FloatArray
) -> Iterator[Finding]:
    """A sheet that is folded, or whose outside looks into the link."""
    area = np.linalg.norm(faces, axis=1)
    inward = np.einsum("nd,nd->n", faces, normals) < 0.0
    share, allowed = float(area[inward].sum() / max(area.sum(), 1e-30)), FOLDED
    if share <= FOLDED:
        # On a thin shell either side will do for the wrap; the mesh defines its outside.
        behind = target.behind(positions, normals)
        share, allowed = float(area[behind].sum() / max(area.sum(), 1e-30)), 0.5
    if share > allowed:
        how = "inside out" if share > 0.5 else "folded"
        words = f"the sheet is {how}: {100 * share:.0f} % of it faces the inside of the link"
        yield Doubt.FOLDED, words


def coverage(layout: FloatArray, places: FloatArray) -> float:
    """Area of the hull of some places (k, 2) against that of the whole layout (n, 2)."""
    flat = places - places.mean(axis=0)
    if len(places) < 3 or np.linalg.matrix_rank(flat, tol=1e-6) < 2:
        return 0.0
    return float(ConvexHull(places).volume / ConvexHull(layout).volume)


def _overlapping(
    board: Board, positions: FloatArray, normals: FloatArray, channels: IntArray
) -> Iterator[Finding]:
    """A board that comes round to itself: taxels from far apart on it at one place of the link."""
    pitch = median_spacing(board.layout)
    pairs = cKDTree(positions).query_pairs(ON_ITSELF * pitch, output_type="ndarray")
    i, j = pairs.T
    # Where two borders meet is a seam.
    inner = np.setdiff1d(board.triangles, border_edges(board.triangles))
    far = np.linalg.norm(board.layout[i] - board.layout[j], axis=1) > FAR_ON_BOARD * pitch
    far &= (np.einsum("pd,pd->p", normals[i], normals[j]) > 0.5) & np.isin(pairs, inner).any(axis=1)
    if far.any():
        one, other = pairs[far][0].tolist()
        apart = 1e3 * np.linalg.norm(positions[one] - positions[other])
        words = f"channels {channels[one]} and {channels[other]} ({apart:.1f} mm apart)"
        yield Doubt.OVERLAP, f"the board lies on itself at {words}: it is longer than the link"


def _round_an_edge(
    board: Board, faces: FloatArray, places: FloatArray, channels: IntArray
) -> Iterator[Finding]:
    """A sheet that turns round an edge beyond the hull of its evidence, at places (k, 2)."""
    i, j = board.pairs.T
    normals = unit(faces)  # of the sheet: the link's jump from side to side where it is thin
    gap = _beyond(board.layout, places)
    beyond = gap > 0.5 * median_spacing(board.layout)
    turn = np.arccos(np.clip(np.einsum("pd,pd->p", normals[i], normals[j]), -1.0, 1.0))
    inside = ~(beyond[i] | beyond[j])
    rate = float(np.max(turn[inside] / board.lengths[inside], initial=0.0))
    sharp = (
        ~inside
        & (faces[i].any(axis=1) & faces[j].any(axis=1))
        & (turn > np.maximum(EDGE, SHARPER * rate * board.lengths))
    )
    round_it = np.unique(np.where(gap[i] > gap[j], i, j)[sharp])
    if len(round_it):
        named = first_few(channels[round_it].tolist())
        yield (
            Doubt.EDGE,
            f"the sheet turns round an edge beyond its evidence, at {len(round_it)} taxels: "
            f"channels {named}. Measure one there; a board that overhangs has no place on the link",
        )


def _beyond(layout: FloatArray, places: FloatArray) -> FloatArray:
    """(n,) distances of a layout (n, 2) from the hull of places (k, 2) [m]."""
    if len(places) < 3 or np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-6) < 2:
        gap = np.linalg.norm(layout[:, None] - places[None], axis=2).min(axis=1, initial=np.inf)
        return np.where(np.isfinite(gap), gap, np.ptp(layout))
    hull = ConvexHull(places)
    inside = (layout @ hull.equations[:, :2].T + hull.equations[:, 2] <= 0.0).all(axis=1)
    start = places[hull.vertices]
    side = np.roll(start, -1, axis=0) - start
    off = layout[:, None] - start[None]
    along = np.einsum("nkd,kd->nk", off, side) / np.einsum("kd,kd->k", side, side)
    away = off - np.clip(along, 0.0, 1.0)[..., None] * side
    return np.where(inside, 0.0, np.linalg.norm(away, axis=2).min(axis=1))


def _unsettled(moved: float) -> Iterator[Finding]:
    """A search that ended for want of steps: the covariance is that of no minimum."""
    if moved > ROUGHLY:
        words = "the solution has not settled: its last step moved a taxel by"
        yield Doubt.UNSETTLED, f"{words} {1e3 * moved:.2f} mm"


def _too_little(
    evidence: Evidence, agrees: BoolArray, share: float, needed: float
) -> Iterator[Finding]:
    """Touches that are too few, or that contradict each other; evidence of a small share."""
    count, good = int(evidence.doubted.sum()), int((evidence.doubted & agrees).sum())
    if 0 < count < FEWEST_TOUCHES and evidence.doubted.all():
        yield Doubt.FEW, f"{count} touches, at least {FEWEST_TOUCHES} are needed"
    if good < ENOUGH_AGREE * count:
        yield (
            Doubt.DISAGREE,
            f"only {good} of {count} touches agree with the patch found: wrong channels, "
            "a probe that is off, or another link",
        )
    if share < needed:
        yield (
            Doubt.COVERAGE,
            f"the evidence spans {100 * share:.0f} % of the patch, at least {100 * needed:.0f} % "
            "are needed: add some near its far ends",
        )


def _ambiguous(minima: list[Minimum], spacing: float, channels: IntArray) -> Iterator[Finding]:
    best = minima[0]
    for other in minima[1:]:
        apart = np.linalg.norm(other.state.positions - best.state.positions, axis=1)
        if other.cost - best.cost < RIVAL and np.median(apart) > spacing / 2:
            yield (
                Doubt.RIVAL,
                f"another place fits as well (cost {other.cost:.1f} against {best.cost:.1f}), "
                f"{1e3 * np.median(apart):.1f} mm away: add an anchor where they differ most, "
                f"at channel {channels[np.argmax(apart)]}",
            )
            return


def _contradictions(evidence: Evidence, left_out: LeftOut, channels: IntArray) -> Iterator[Finding]:
    """Anchors that are not where all others say."""
    rows = np.flatnonzero(~evidence.doubted & (left_out.misfit > CONTRADICTION))
    worst = rows[np.argsort(-left_out.misfit[rows], kind="stable")][:NEXT].tolist()
    words = ", ".join(
        f"{channels[evidence.taxel(row)]} ({1e3 * left_out.distance[row]:.1f} mm, expected "
        f"{1e3 * left_out.expected[row]:.1f} mm)"
        for row in worst
    )
    if words:
        yield (
            Doubt.MISFIT,
            f"the anchors contradict each other; furthest from where the others predict it: "
            f"channel {words}",
        )


def _freedom(evidence: Evidence) -> int:
    """Degrees of freedom of the cost of anchors; 0 where there are too few.

    Of touches, whose loss bounds what a wrong one costs, the cost is no measure.
    """
    return 0 if evidence.doubted.any() else max(0, 3 * len(evidence) - PLACED)


def _ill_fitting(
    evidence: Evidence, cost: float, strain: FloatArray, scale: float
) -> Iterator[Finding]:
    """Anchors that fit worse together than their errors explain; other lengths, another scale."""
    free = _freedom(evidence)
    most = float(chdtri(free, UNLIKELY)) if free else np.inf
    if cost > most:
        yield (
            Doubt.MISFIT,
            f"the anchors together fit worse than their stated errors explain (cost {cost:.0f}, at "
            f"most {most:.0f} expected): one of them may be misplaced, the board of another scale, "
            "or the errors larger",
        )
    rms = float(np.sqrt(np.mean(strain**2)))
    if rms > STRETCHED:
        yield (
            Doubt.STRETCHED,
            f"lengths are stretched by {100 * rms:.1f} % rms to fit: "
            "another board, or anchors on wrong taxels",
        )
    if abs(float(np.log(scale))) / SCALE > OFF_SCALE:
        size = "larger" if scale > 1.0 else "smaller"
        words = f"the board would be {100 * abs(scale - 1.0):.1f} % {size} than it is drawn"
        yield Doubt.SCALE, words


def _unobservable(
    positions: FloatArray, covariance: FloatArray, spacing: float
) -> Iterator[Finding]:
    with np.errstate(invalid="ignore"):  # of what is no covariance
        sd = np.sqrt(np.einsum("nii->n", covariance))
    if not np.isfinite(sd).all() or not (sd > 0.0).all():
        yield (
            Doubt.WIDE,
            "the places of the taxels are not determined: nothing holds the patch together",
        )
    elif np.median(sd) > spacing / 2:
        yield (
            Doubt.WIDE,
            f"taxels are known to {1e3 * np.median(sd):.1f} mm only, half a pitch is "
            f"{1e3 * spacing / 2:.1f} mm; the patch {weak_direction(positions, covariance)}",
        )


def weakest_motion(positions: FloatArray, covariance: FloatArray) -> str:
    """How a patch could still move most easily, and by how much, in words."""
    sd = 1e3 * np.sqrt(np.linalg.eigvalsh(covariance.mean(axis=0))[-1])
    return f"most easily the patch {weak_direction(positions, covariance)}, by {sd:.1f} mm (sd)"


def weak_direction(positions: FloatArray, covariance: FloatArray) -> str:
    """How a patch is free to move, in words: along its long axis, across it, or in and out."""
    _, vectors = np.linalg.eigh(covariance.mean(axis=0))
    weakest = vectors[:, -1]
    _, _, axes = np.linalg.svd(positions - positions.mean(axis=0), full_matrices=False)
    words = ("slides along its long axis", "slides across its long axis", "lifts off the link")
    return words[int(np.argmax(np.abs(axes @ weakest)))]


def best_next(joint: FloatArray, sigma: float, count: int) -> IntArray:
    """Taxels (count,) to measure, best first, each given the ones before.

    Measuring the place of taxel t with a standard deviation of sigma [m] a coordinate takes
    tr(J[:, t] (J[t, t] + sigma^2 I)^-1 J[t, :]) off the summed variance of all taxels.

    Parameters
    ----------
    joint : (n, 3, n, 3) float
        Joint covariance J of all positions [m2].
    """
    n = len(joint)
    rest = np.array(joint.reshape(3 * n, 3 * n))
    chosen: list[int] = []
    for _ in range(min(count, n)):
        columns = rest.reshape(3 * n, n, 3)
        gram = np.einsum("itk,itl->tkl", columns, columns)
        own = rest.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :] + sigma**2 * np.eye(3)
        gain = np.einsum("tkk->t", np.linalg.solve(own, gram))
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        column = columns[:, best]
        rest = rest - column @ np.linalg.solve(own[best], column.T)
    return np.array(chosen, np.int64)

"""Whether a wrapped patch may be trusted: coverage, second minima, predicted errors, directions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from calibration.patch.link_surface import Target
from calibration.patch.next_places import best_next
from calibration.patch.patch_calibration import PatchCalibration, Status
from calibration.patch.sheet_model import Board, Evidence, chords
from skinmap.arrays import BoolArray, FloatArray
from skinmap.geometry.proximity import median_spacing

if TYPE_CHECKING:
    from calibration.patch.wrap import Minimum

COVERAGE = 0.25  # share of the patch inside the hull of its evidence
RIVAL = 1.05  # a second minimum of at most this many times the cost is as good
CONTRADICTION = 4.0  # mean square of the anchors' residuals: above, they contradict the board
TOUCHED = 0.4  # the same for touches, of which there are many
FEWEST_TOUCHES = 8  # fewer cannot show which of them are wrong
AGREES = 3.0  # residual of a touch over its spread, in space
ENOUGH_AGREE = 0.5  # of all touches
NEXT = 3  # places to measure next that are named
# Linearised covariances know of one minimum only. Beyond the hull of evidence that covers too
# little a sheet may lie in a neighbouring one: on the iCub's 23 patches with all touches on one
# module errors grow by 3 % of the distance from the hull (normalised error squared 1.3; without
# that 7.0).
ASTRAY = 0.03
STRETCHED = 0.03  # rms strain: above, this is not the board


def judge(
    target: Target,
    board: Board,
    evidence: Evidence,
    minima: list[Minimum],
    kinds: Mapping[str, BoolArray],
) -> PatchCalibration:
    """The lowest minimum as a calibration, with its covariance, status and reasons.

    Parameters
    ----------
    target : Target
    board : Board
    evidence : Evidence
    minima : list of Minimum
        The lowest first.
    kinds : mapping of str to (k,) array of bool
        Which of the evidence is "anchors", which "touches".
    """
    best = minima[0]
    x = best.state.positions
    n = len(x)
    spacing = median_spacing(board.layout)
    inverse = np.asarray(np.linalg.inv(best.hessian), np.float64)
    everything: FloatArray = np.reshape(inverse[:-2, :-2], (n, 3, n, 3))
    covariance = everything[np.arange(n), :, np.arange(n), :]
    covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
    _, normals = target.project(x)
    missed = evidence.missed(x, normals) / evidence.sigma[:, None]
    agrees = ~evidence.doubted | ((missed**2).sum(axis=1) < AGREES**2)
    places = evidence.blend[agrees] @ board.layout
    share = coverage(board.layout, places)
    needed = TOUCHED if evidence.doubted.any() else COVERAGE
    stated = covariance
    if share < needed:
        stated = covariance + _astray(board.layout, places)[:, None, None] * np.eye(3)
    chord, _, wanted = chords(board, x, normals)
    strain = chord / (np.exp(best.state.log_scale) * wanted) - 1.0
    found = [
        *_unobservable(x, covariance, spacing),
        *_ambiguous(minima, spacing),
        *_contradictions(missed[~evidence.doubted], strain),
        *_doubted(evidence, agrees),
        *_uncovered(share, needed),
    ]
    return PatchCalibration(
        x,
        normals,
        stated,
        found[0][0] if found else Status.OK,
        tuple(reason for _, reason in found),
        {**{name: missed[rows] for name, rows in kinds.items()}, "strain": strain},
        float(np.exp(best.state.log_scale)),
        best.state.height,
        share,
        _weakest(x, covariance),
        best_next(everything, float(np.median(evidence.sigma)), NEXT),
    )


def coverage(layout: FloatArray, places: FloatArray) -> float:
    """Area of the hull of some places (k, 2) against that of the whole layout (n, 2)."""
    flat = places - places.mean(axis=0)
    if len(places) < 3 or np.linalg.matrix_rank(flat, tol=1e-6) < 2:
        return 0.0
    return float(ConvexHull(places).volume / ConvexHull(layout).volume)


def _astray(layout: FloatArray, places: FloatArray) -> FloatArray:
    """(n,) variances of each coordinate [m2] by the distance from the hull of places (k, 2)."""
    if len(places) < 3 or np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-6) < 2:
        gap = np.linalg.norm(layout[:, None] - places[None], axis=2).min(axis=1, initial=np.inf)
        return np.asarray((ASTRAY * np.where(np.isfinite(gap), gap, np.ptp(layout))) ** 2)
    hull = ConvexHull(places)
    inside = (layout @ hull.equations[:, :2].T + hull.equations[:, 2] <= 0.0).all(axis=1)
    start = places[hull.vertices]
    side = np.roll(start, -1, axis=0) - start
    off = layout[:, None] - start[None]
    along = np.einsum("nkd,kd->nk", off, side) / np.einsum("kd,kd->k", side, side)
    away = off - np.clip(along, 0.0, 1.0)[..., None] * side
    gap = np.where(inside, 0.0, np.linalg.norm(away, axis=2).min(axis=1))
    return np.asarray((ASTRAY * gap) ** 2)


def _uncovered(share: float, needed: float) -> list[tuple[Status, str]]:
    if share >= needed:
        return []
    return [
        (
            Status.LOW_COVERAGE,
            f"the evidence spans {100 * share:.0f} % of the patch, at least {100 * needed:.0f} % "
            "are needed: add some near its far ends",
        )
    ]


def _doubted(evidence: Evidence, agrees: BoolArray) -> list[tuple[Status, str]]:
    """Touches that are too few, or that contradict each other."""
    count, good = int(evidence.doubted.sum()), int((evidence.doubted & agrees).sum())
    if count == 0:
        return []
    found = []
    if count < FEWEST_TOUCHES and evidence.doubted.all():
        found.append(
            (Status.LOW_COVERAGE, f"{count} touches, at least {FEWEST_TOUCHES} are needed")
        )
    if good < ENOUGH_AGREE * count:
        found.append(
            (
                Status.AMBIGUOUS,
                f"only {good} of {count} touches agree with the patch found: wrong channels, "
                "a probe that is off, or another link",
            )
        )
    return found


def _ambiguous(minima: list[Minimum], spacing: float) -> list[tuple[Status, str]]:
    best = minima[0]
    for other in minima[1:]:
        apart = np.linalg.norm(other.state.positions - best.state.positions, axis=1)
        if other.cost <= RIVAL * best.cost and np.median(apart) > spacing / 2:
            return [
                (
                    Status.AMBIGUOUS,
                    f"another place fits as well (cost {other.cost:.1f} against {best.cost:.1f}), "
                    f"{1e3 * np.median(apart):.1f} mm away: add an anchor where they differ most, "
                    f"at taxel {int(np.argmax(apart))}",
                )
            ]
    return []


def _contradictions(missed: FloatArray, strain: FloatArray) -> list[tuple[Status, str]]:
    found = []
    if missed.size and np.mean(missed**2) > CONTRADICTION:
        worst = int(np.argmax(np.linalg.norm(missed, axis=1)))
        found.append(
            (
                Status.AMBIGUOUS,
                f"the anchors miss their taxels by {np.sqrt(np.mean(missed**2)):.1f} times what "
                f"was expected, anchor {worst} the most: wrong taxel, or a larger sigma",
            )
        )
    if np.sqrt(np.mean(strain**2)) > STRETCHED:
        found.append(
            (
                Status.AMBIGUOUS,
                f"lengths are stretched by {100 * np.sqrt(np.mean(strain**2)):.1f} % rms to fit: "
                "another board, or anchors on wrong taxels",
            )
        )
    return found


def _unobservable(
    positions: FloatArray, covariance: FloatArray, spacing: float
) -> list[tuple[Status, str]]:
    sd = np.sqrt(np.einsum("nii->n", covariance))
    if np.median(sd) <= spacing / 2:
        return []
    return [
        (
            Status.UNOBSERVABLE,
            f"taxels are known to {1e3 * np.median(sd):.1f} mm only, half a pitch is "
            f"{1e3 * spacing / 2:.1f} mm; the patch {weak_direction(positions, covariance)}",
        )
    ]


def _weakest(positions: FloatArray, covariance: FloatArray) -> str:
    sd = 1e3 * np.sqrt(np.linalg.eigvalsh(covariance.mean(axis=0))[-1])
    return f"most easily the patch {weak_direction(positions, covariance)}, by {sd:.1f} mm (sd)"


def weak_direction(positions: FloatArray, covariance: FloatArray) -> str:
    """How a patch is free to move, in words: along its long axis, across it, or in and out."""
    _, vectors = np.linalg.eigh(covariance.mean(axis=0))
    weakest = vectors[:, -1]
    _, _, axes = np.linalg.svd(positions - positions.mean(axis=0), full_matrices=False)
    words = ("slides along its long axis", "slides across its long axis", "lifts off the link")
    return words[int(np.argmax(np.abs(axes @ weakest)))]

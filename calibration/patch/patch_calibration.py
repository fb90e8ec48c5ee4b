"""Result of a patch calibration: taxel positions, their covariance, and whether to trust them.

Leave-one-out errors in closed form: each piece of evidence predicted by all the others.

For least squares the fit without one observation follows from the fit with it: with the share h
that an observation has in its own prediction, what it misses by without itself is (I - h)^-1 times
what it misses by (Cook and Weisberg, "Residuals and Influence in Regression", 1982, section 2.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from calibration.patch.sheet_model import Evidence
from skinmap.arrays import FloatArray, Frozen, IntArray, check_finite, freeze
from skinmap.summary import Summary, listed, millimetres

LARGEST_SHARE = 0.999  # of an observation that nothing else controls: its error is unknown


@dataclass(frozen=True, eq=False, slots=True)
class LeftOut(Frozen):
    """What each anchor or touch misses by where all but it are used.

    Attributes
    ----------
    distance : (k,) float
        From the measured point to the predicted one [m].
    expected : (k,) float
        Root of the mean square that is expected of it: its own error and that of the rest [m].
    misfit : (k,) float
        Mean square of a coordinate over what is expected, of the two along the skin or of all
        three, whichever is larger; about 1 on average, above 6.5 it contradicts. A point on the
        wrong taxel is off along the skin alone: the third coordinate would only add noise.
    missed : (k,) float
        What it misses by where it is used too [m].
    """

    distance: FloatArray
    expected: FloatArray
    misfit: FloatArray
    missed: FloatArray

    @classmethod
    def nothing(cls) -> LeftOut:
        """No evidence at all."""
        return cls(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))

    def __len__(self) -> int:
        return len(self.distance)


def leave_one_out(
    joint: FloatArray, evidence: Evidence, missed: FloatArray, normals: FloatArray
) -> LeftOut:
    """Errors of evidence that the rest predicts.

    Parameters
    ----------
    joint : (n, 3, n, 3) float
        Joint covariance of the taxels with all evidence [m2].
    evidence : Evidence
    missed : (k, 3) float
        From each point to the sheet there [m].
    normals : (n, 3) float
        Of the taxels.
    """
    _, weight = evidence.loss(missed)
    own = np.einsum("kn,niml,km->kil", evidence.blend, joint, evidence.blend, optimize=True)
    share, axes = np.linalg.eigh(weight[:, None, None] * own)
    rest = 1.0 / (1.0 - np.clip(share, 0.0, LARGEST_SHARE))
    turned = np.einsum("kji,kj->ki", axes, missed)
    error = rest * turned
    variance = evidence.sigma[:, None] ** 2 + rest * share / weight[:, None]
    whole = (error**2 / variance).sum(axis=1)
    return LeftOut(
        np.asarray(np.linalg.norm(error, axis=1)),
        np.asarray(np.sqrt(variance.sum(axis=1))),
        np.maximum(whole / 3.0, _along(axes, error, variance, evidence.blend @ normals) / 2.0),
        np.linalg.norm(missed, axis=1),
    )


def _along(
    axes: FloatArray, error: FloatArray, variance: FloatArray, normals: FloatArray
) -> FloatArray:
    """(k,) squared errors along the skin over what is expected of them, two coordinates each.

    Of the marginal distribution of a normal one: the whole, less the share along the direction
    that is projected out, in the metric of the variance.
    """
    across = np.einsum("kji,kj->ki", axes, normals)
    whole = (error**2 / variance).sum(axis=1)
    inner = (across * error / variance).sum(axis=1)
    return np.asarray(whole - inner**2 / (across**2 / variance).sum(axis=1))


class Status(StrEnum):
    """Whether a calibration may be used as it is."""

    OK = "ok"
    LOW_COVERAGE = "low_coverage"
    AMBIGUOUS = "ambiguous"
    UNOBSERVABLE = "unobservable"
    NOT_SETTLED = "not_settled"


class Doubt(StrEnum):
    """What makes a patch doubtful, more closely than its status."""

    MISFIT = "an anchor is not where the others predict it"
    STRETCHED = "lengths do not fit"
    FOLDED = "the sheet is folded or inside out"
    OVERLAP = "the board lies on itself"
    EDGE = "the sheet turns round an edge beyond the evidence"
    SCALE = "another scale"
    DISAGREE = "touches contradict each other"
    RIVAL = "another place fits as well"
    WIDE = "taxels are known too roughly"
    COVERAGE = "the evidence covers too little"
    FEW = "too few touches"
    UNSETTLED = "the search ended before it settled"


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class PatchCalibration(Summary):
    """Calibrated taxels of one patch, in the frame of the mesh that they were laid on.

    Attributes
    ----------
    positions : (n, 3) float
        [m].
    normals : (n, 3) float
        Unit, outward.
    covariance : (n, 3, 3) float
        Of each position [m2].
    status : Status
        `ok`, or what is doubtful.
    reasons : tuple of str
        Why, in words; empty where it is ok.
    doubts : tuple of Doubt
        What each of the reasons that a check gave is about.
    residuals : mapping of str to (k, 3) or (k,) float
        By kind of evidence, divided by what was expected of them.
    left_out : LeftOut
        What each anchor or touch misses by where all others predict it.
    strain : (p,) float
        Of each held pair of taxels against the layout, as found.
    expected_strain : (p,) float
        The same as it is expected of a flat map of where the patch lies.
    pairs : (p, 2) int
        Those pairs.
    mirrored : bool
        Whether the layout shows the board from its other side: said by the caller, or found out.
    cost : float
        Of the solution: smaller fits better.
    scale : float
        Of the body's lengths against the layout's.
    height : float
        Mean height of the taxels above the wrapped mesh [m].
    coverage : float
        Share of the patch inside the hull of its evidence.
    weakest : str
        How the patch could still move most easily, in words.
    next_taxels : (k,) int
        Taxels whose place would tell most if it was measured next, the best first.
    """

    positions: FloatArray
    normals: FloatArray
    covariance: FloatArray
    status: Status
    reasons: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    residuals: Mapping[str, FloatArray] = field(default_factory=dict)
    left_out: LeftOut = field(default_factory=LeftOut.nothing)
    strain: FloatArray = field(default_factory=lambda: np.zeros(0))
    expected_strain: FloatArray = field(default_factory=lambda: np.zeros(0))
    pairs: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    mirrored: bool = False
    cost: float = 0.0
    scale: float = 1.0
    height: float = 0.0
    coverage: float = 1.0
    weakest: str = ""
    next_taxels: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        n = len(self.positions)
        freeze(
            self,
            positions=check_finite(self.positions, "positions", (n, 3)),
            normals=check_finite(self.normals, "normals", (n, 3)),
            covariance=check_finite(self.covariance, "covariance", (n, 3, 3)),
            next_taxels=np.asarray(self.next_taxels, np.int64),
            strain=self.strain,
            expected_strain=self.expected_strain,
            pairs=self.pairs,
        )

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def predicted_sd(self) -> FloatArray:
        """(n,) predicted error of each position: the root of its covariance's trace [m]."""
        return np.asarray(np.sqrt(np.einsum("nii->n", self.covariance)))

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        error = np.sqrt(np.mean(self.predicted_sd**2)) if len(self) else 0.0
        return {
            "status": self.status.value,
            "taxels": len(self),
            "expected_error": millimetres(float(error)),
            "reasons": listed(self.reasons),
        }

"""Result of a patch calibration: taxel positions, their covariance, and whether to trust them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from calibration.patch.leave_one_out import LeftOut
from skinmap.arrays import FloatArray, IntArray, check_finite, freeze
from skinmap.summary import Summary, listed, millimetres


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

"""What calibrations print: a status with its reasons, and how errors spread."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, cast

import msgspec

from skinmap.report.result import Verdict

if TYPE_CHECKING:
    from calibration.patch.patch_calibration import Status
    from skinmap.arrays import FloatArray

MM = 1e3
Grade = Literal["ok", "low_coverage", "ambiguous", "unobservable", "not_settled", "faulty"]
Matrix = list[list[float]]


def grade(status: Status | str) -> Grade:
    """A status as its word."""
    return cast("Grade", str(status))


@dataclass(frozen=True, kw_only=True, slots=True)
class Spread:
    """Spread of a figure over its values.

    Attributes
    ----------
    median
        Half of them are below.
    p95
        95 % of them are below.
    max
        Largest of the values.
    """

    median: float
    p95: float
    max: float

    @classmethod
    def of(cls, values: FloatArray) -> Spread:
        """From all of them."""
        import numpy as np

        median, p95 = np.percentile(values, [50, 95]).tolist()
        return cls(median=median, p95=p95, max=float(values.max()))


@dataclass(frozen=True, kw_only=True, slots=True)
class Calibrated:
    """What all calibrations say first.

    Attributes
    ----------
    status
        `ok`, or in a word why the result is not to be used.
    reasons
        Why, the most telling first.
    files
        Names of the files inside `--out`.
    """

    status: Grade
    reasons: list[str]
    files: list[str] = field(default_factory=list)

    def verdict(self, *, accept: bool) -> Verdict:
        """Whether it may be used."""
        return Verdict(self.status, self.reasons, accept)


def judged(result: Calibrated) -> Iterator[str]:
    """The first lines for people: the status, and why."""
    yield result.status
    yield from (f"  {reason}" for reason in result.reasons)


@dataclass(frozen=True, kw_only=True, slots=True)
class EvidenceRow:
    """One anchor or touch.

    Attributes
    ----------
    channel
        Of the taxel that it is of most.
    missed_mm
        Distance from what was found.
    leave_one_out_mm
        Distance from what all others predict.
    expected_mm
        Root of the expected mean square of the former.
    misfit
        Square of the one over that of the other, a coordinate along the skin: above 6.5 it
        contradicts.
    """

    channel: int
    missed_mm: float
    leave_one_out_mm: float
    expected_mm: float
    misfit: float


@dataclass(frozen=True, kw_only=True, slots=True)
class PatchResult(Calibrated):
    """A board laid on its link.

    Attributes
    ----------
    reasons
        The mistake that explains what does not fit comes first.
    mirrored
        Whether the layout shows the board from its other side: detected, or given by
        `--mirror` and not contradicted.
    taxels
        Total number of taxels.
    predicted_mm, predicted_sd_mm
        Predicted error of the taxels (one figure under two names).
    leave_one_out_mm
        Error of anchors or touches, each predicted by all others.
    leave_one_out_expected_mm
        The same as it is expected.
    cross_validation_mm
        The former in one figure: root mean square of anchors, median of touches; null for fewer
        than 4 anchors or 8 touches.
    strain_percent
        Root mean square over pairs of near taxels.
    expected_strain_percent
        Of a flat map of where the patch lies.
    unexpected_strain_percent
        Difference between the measured and the expected strain.
    coverage
        Share of the patch inside the hull of its evidence.
    scale
        Of the body against the layout.
    height_mm
        Mean height above the link.
    weakest
        Least certain motion of the patch, in words.
    next
        Channels to measure next, the best first.
    evidence
        Anchors, or touches where there are any.
    mesh_notes
        Faults of the mesh that wrapping it mended.
    touches
        Number of touches, with `--touches`.
    seconds
        CPU time of the solution, the link's wrap included.
    """

    mirrored: bool
    taxels: int
    predicted_mm: Spread
    predicted_sd_mm: Spread
    leave_one_out_mm: Spread
    leave_one_out_expected_mm: Spread
    cross_validation_mm: float | None
    strain_percent: float
    expected_strain_percent: float
    unexpected_strain_percent: float
    coverage: float
    scale: float
    height_mm: float
    weakest: str
    next: list[int]
    evidence: list[EvidenceRow]
    mesh_notes: list[str]
    touches: int | msgspec.UnsetType = msgspec.UNSET
    seconds: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Probe:
    """A fingertip without taxels.

    Attributes
    ----------
    on
        Link that carries the probe.
    tip_mm
        Fitted place of the tip, in the frame of that link.
    assumed_tip_mm
        First guess of the tip; null where none was given.
    radius_mm
        Of its tip; null for a point.
    """

    on: str
    tip_mm: list[float]
    assumed_tip_mm: list[float] | None
    radius_mm: float | None

"""What the commands of patches share: the work, its result, and the files that come of it.

The interactive way ends here too, so that the same anchors give the same bits.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.commands.mount_jobs import spread
from calibration.commands.patch_report import write_patch_report
from calibration.files.tables import BoardTable, write_calibrated, write_icub_table
from calibration.patch.mesh_faults import mesh_notes
from calibration.patch.patch_calibration import PatchCalibration, Status
from calibration.patch.solver_budget import FULL, Effort
from calibration.patch.touch import Touch, locate_by_touch
from calibration.patch.wrap import wrap_layout
from skinmap.arrays import FloatArray, IntArray

MM = 1e3
REFUSED = "refused.html"  # the report of a result that is not ok and was not accepted
FEWEST_ANCHORS, FEWEST_TOUCHES = 4, 8  # fewer leave too little over to predict one by the others


@dataclass(frozen=True, slots=True)
class EvidenceRow:
    """One anchor or touch.

    Attributes
    ----------
    channel : int
        Of the taxel that it is of most.
    missed_mm : float
        Distance from what was found.
    leave_one_out_mm, expected_mm : float
        Distance from what all others predict, and the root of its expected mean square.
    misfit : float
        Square of the one over that of the other, a coordinate: above 6 it contradicts.
    """

    channel: int
    missed_mm: float
    leave_one_out_mm: float
    expected_mm: float
    misfit: float


@dataclass(frozen=True, slots=True)
class PatchResult:
    """What the commands of patches print as JSON, but for the names of their files.

    Attributes
    ----------
    status : str
    reasons : tuple of str
    mirrored : bool
        Whether the layout shows the board from its other side: found out, or said by --mirror
        and not contradicted.
    taxels : int
    predicted_mm, predicted_sd_mm : {median, p95, max}
        Predicted error of the taxels (one figure under two names).
    leave_one_out_mm, leave_one_out_expected_mm : {median, p95, max}
        Error of anchors or touches that all others predict, and the same as expected.
    cross_validation_mm : float or None
        The first in one figure: root mean square of anchors, median of touches; None where
        there are too few to leave any out.
    strain_percent, expected_strain_percent, unexpected_strain_percent : float
        Root mean square over pairs of near taxels: found, expected of a flat map of where the
        patch lies, and the difference.
    coverage : float
        Share of the patch inside the hull of its evidence.
    scale : float
    height_mm : float
    weakest : str
    next : tuple of int
        Channels to measure next.
    evidence : tuple of EvidenceRow
    mesh_notes : tuple of str
        Faults of the mesh that wrapping it mended.
    seconds : float
        CPU.
    """

    status: str
    reasons: tuple[str, ...]
    mirrored: bool
    taxels: int
    predicted_mm: dict[str, float]
    predicted_sd_mm: dict[str, float]
    leave_one_out_mm: dict[str, float]
    leave_one_out_expected_mm: dict[str, float]
    cross_validation_mm: float | None
    strain_percent: float
    expected_strain_percent: float
    unexpected_strain_percent: float
    coverage: float
    scale: float
    height_mm: float
    weakest: str
    next: tuple[int, ...]
    evidence: tuple[EvidenceRow, ...]
    mesh_notes: tuple[str, ...]
    seconds: float


@dataclass(frozen=True, eq=False, slots=True)
class PatchTask:
    """A board, a link, and anchors or touches or both.

    Attributes
    ----------
    title : str
        What is laid on what.
    board : BoardTable
    link : (v, 3) array of float [m], (f, 3) array of int
    anchors : (k,) int
        Rows of the board.
    points : (k, 3) float
        Where they are [m].
    sigma : (k,) float
        Standard deviation of each coordinate [m].
    touches : tuple of Touch
        None for a wrap by anchors alone.
    mirror : bool
        Whether the board is drawn from its other side.
    effort : Effort
    """

    title: str
    board: BoardTable
    link: tuple[FloatArray, IntArray]
    anchors: IntArray
    points: FloatArray
    sigma: FloatArray
    touches: tuple[Touch, ...] = ()
    mirror: bool = False
    effort: Effort = FULL

    def solve(self, seed: int) -> tuple[PatchCalibration, float]:
        """The patch, and the seconds of CPU that it took."""
        start = time.process_time()
        board, rng = self.board, np.random.default_rng(seed)
        how: dict[str, Any] = {
            "anchor_sigma": self.sigma, "modules": board.rigid_modules, "channels": board.channels,
            "mirror": self.mirror, "effort": self.effort, "rng": rng,
        }  # fmt: skip
        if self.touches:
            anchors = (self.anchors, self.points) if len(self.anchors) else None
            found = locate_by_touch(board.layout, *self.link, self.touches, anchors=anchors, **how)
        else:
            found = wrap_layout(board.layout, *self.link, self.anchors, self.points, **how)
        return found, time.process_time() - start

    def result(self, found: PatchCalibration, seconds: float) -> PatchResult:
        """Result in words and millimetres."""
        rows = self._rows(found)
        left = MM * found.left_out.distance[: len(rows)]
        predicted = spread(MM * found.predicted_sd)
        enough = len(rows) >= (FEWEST_TOUCHES if self.touches else FEWEST_ANCHORS)
        # Of touches the median: those that are wrong are wrong by any length.
        rms = float(np.median(left) if self.touches else np.sqrt(np.mean(left**2)))
        return PatchResult(
            status=str(found.status), reasons=found.reasons, mirrored=found.mirrored,
            taxels=len(found), predicted_mm=predicted, predicted_sd_mm=predicted,
            leave_one_out_mm=spread(left),
            leave_one_out_expected_mm=spread(MM * found.left_out.expected[: len(rows)]),
            cross_validation_mm=rms if enough else None,
            strain_percent=_rms_percent(found.strain),
            expected_strain_percent=_rms_percent(found.expected_strain),
            unexpected_strain_percent=_rms_percent(found.residuals["strain"]),
            coverage=found.coverage, scale=found.scale, height_mm=MM * found.height,
            weakest=found.weakest, next=tuple(self.board.channels[found.next_taxels].tolist()),
            evidence=rows, mesh_notes=mesh_notes(*self.link), seconds=seconds,
        )  # fmt: skip

    def _rows(self, found: PatchCalibration) -> tuple[EvidenceRow, ...]:
        """Touches where there are any, which come first in what was solved; else anchors."""
        if self.touches:
            felt = [int(touch.channels[np.argmax(touch.values)]) for touch in self.touches]
            sigma = np.array([touch.sigma for touch in self.touches])
            missed = sigma * np.linalg.norm(found.residuals["touches"], axis=1)
        else:
            felt = self.anchors.tolist()
            missed = np.linalg.norm(found.positions[self.anchors] - self.points, axis=1)
        left, names = found.left_out, self.board.channels
        return tuple(
            EvidenceRow(
                int(names[taxel]), MM * float(missed[row]), MM * float(left.distance[row]),
                MM * float(left.expected[row]), float(left.misfit[row]),
            )
            for row, taxel in enumerate(felt)
        )  # fmt: skip

    def write(
        self,
        stage: Path,
        found: PatchCalibration,
        seconds: float,
        *,
        formats: Sequence[str] = (),
        accept: bool = False,
    ) -> dict[str, Any]:
        """Tables and report, or only the report of why not; what the command prints."""
        result = self.result(found, seconds)
        good = accept or found.status is Status.OK
        files = ["report.html" if good else REFUSED]
        kind = "touches" if self.touches else "anchors"
        board = self.board
        if self.mirror:
            board = replace(board, layout=board.layout * [-1.0, 1.0])
        write_patch_report(self.title, result, found, board, self.link, kind, stage / files[0])
        if good:
            write_calibrated(board, found, stage / "taxels.csv")
            files.insert(0, "taxels.csv")
            if "icub" in formats:
                link = self.title.split(" on ")[-1]
                write_icub_table(board, found, stage / "taxels.txt", link)
                files.insert(1, "taxels.txt")
        return {**asdict(result), "files": files}


def _rms_percent(strain: FloatArray) -> float:
    return 100.0 * float(np.sqrt(np.mean(strain**2)))

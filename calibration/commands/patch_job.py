"""What the commands of patches share: what they print, which files they write, and the wrap itself.

The interactive way ends here too, so that the same anchors give the same bits.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.commands.patch_report import EvidenceRows, write_patch_report
from calibration.files.tables import BoardTable, write_calibrated, write_icub_table
from calibration.patch.held_out import held_out_errors
from calibration.patch.mesh_faults import mesh_notes
from calibration.patch.patch_calibration import PatchCalibration, Status
from calibration.patch.solver_budget import FULL, Effort
from calibration.patch.wrap import wrap_layout
from skinmap.arrays import FloatArray, IntArray

MM = 1e3
REFUSED = "refused.html"  # the report of a result that is not ok and was not accepted


@dataclass(frozen=True, eq=False, slots=True)
class WrapTask:
    """A board, a link and anchors.

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
    effort : Effort
    """

    title: str
    board: BoardTable
    link: tuple[FloatArray, IntArray]
    anchors: IntArray
    points: FloatArray
    sigma: FloatArray
    effort: Effort = FULL

    def solve(self, seed: int) -> tuple[PatchCalibration, float]:
        """The wrapped patch, and the seconds of CPU that it took."""
        start = time.process_time()
        found = wrap_layout(
            self.board.layout, *self.link, self.anchors, self.points, anchor_sigma=self.sigma,
            effort=self.effort, rng=np.random.default_rng(seed),
        )  # fmt: skip
        return found, time.process_time() - start

    def held_out(self, found: PatchCalibration) -> FloatArray:
        """(k,) distances of anchors from wraps without them [m]; empty for three."""
        return held_out_errors(
            found, self.board.layout, *self.link, self.anchors, self.points,
            anchor_sigma=self.sigma, effort=self.effort,
        )  # fmt: skip

    def write(
        self,
        stage: Path,
        found: PatchCalibration,
        held_out: FloatArray,
        seconds: float,
        *,
        formats: Sequence[str] = (),
        accept: bool = False,
    ) -> dict[str, Any]:
        """Write tables and report into a folder; what the command prints."""
        rms = float(np.sqrt(np.mean(held_out**2))) if len(held_out) else None
        missed = np.linalg.norm(found.positions[self.anchors] - self.points, axis=1)
        rows = EvidenceRows("anchors", self.anchors, missed, held_out)
        result = summary(found, self.board.channels, rms, seconds)
        return result | write_results(
            stage, self.title, result, found, self.board, self.link, rows, formats, accept
        )


def write_results(
    stage: Path,
    title: str,
    result: dict[str, Any],
    found: PatchCalibration,
    board: BoardTable,
    link: tuple[FloatArray, IntArray],
    rows: EvidenceRows,
    formats: Sequence[str],
    accept: bool,
) -> dict[str, list[str]]:
    """Tables and report, or only the report of why not; their names, and what ails the mesh."""
    good = accept or found.status is Status.OK
    report = "report.html" if good else REFUSED
    write_patch_report(title, result, found, board, link, rows, stage / report)
    files = [report]
    if good:
        write_calibrated(board, found, stage / "taxels.csv")
        files.insert(0, "taxels.csv")
        if "icub" in formats:
            write_icub_table(board, found, stage / "taxels.txt", title.split(" on ")[-1])
            files.insert(1, "taxels.txt")
    return {"files": files, "mesh_notes": list(mesh_notes(*link))}


def summary(
    found: PatchCalibration, channels: IntArray, held_out: float | None, seconds: float
) -> dict[str, Any]:
    """What the commands print as JSON, but for their files."""
    sd = MM * found.predicted_sd
    return {
        "status": str(found.status),
        "reasons": list(found.reasons),
        "taxels": len(found),
        "predicted_sd_mm": {
            "median": float(np.median(sd)),
            "p95": float(np.percentile(sd, 95)),
            "max": float(sd.max()),
        },
        "cross_validation_mm": None if held_out is None else MM * held_out,
        "coverage": found.coverage,
        "scale": found.scale,
        "height_mm": MM * found.height,
        "weakest": found.weakest,
        "next": channels[found.next_taxels].tolist(),
        "seconds": seconds,
    }

"""What all commands of patches do: files in, a board laid on its link, its result and files out.

The interactive way ends here too, so that the same anchors give the same bits.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from calibration.commands.calibration_options import SIGMA, PatchFiles
from calibration.commands.results import MM, EvidenceRow, PatchResult, Spread, grade
from calibration.files.tables import (
    Anchor,
    BoardTable,
    read_anchor_table,
    read_board,
    read_touches,
    write_taxels,
)
from calibration.patch.link_surface import mesh_notes
from calibration.patch.patch_calibration import PatchCalibration
from calibration.patch.placing import Touch, locate_by_touch, wrap_layout
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.io.robots.mesh_file import read_mesh
from skinmap.io.text import UNITS
from skinmap.report.present import write_files

FEWEST_ANCHORS, FEWEST_TOUCHES = 4, 8  # fewer leave too little over to predict one by the others


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
    """

    title: str
    board: BoardTable
    link: tuple[FloatArray, IntArray]
    anchors: IntArray
    points: FloatArray
    sigma: FloatArray
    touches: tuple[Touch, ...] = ()
    mirror: bool = False

    @classmethod
    def load(cls, files: PatchFiles) -> PatchTask:
        """What is in the files.

        Raises
        ------
        MissingFileError, DataFormatError
            A file that is missing or not what it should be (names the line).
        """
        unit = UNITS[files.units]
        board = read_board(files.layout, unit)
        anchors = [] if files.anchors is None else read_anchor_table(files.anchors, board)
        touches: Sequence[Touch] = ()
        if files.touches is not None:
            touches = read_touches(files.touches, board, unit, sigma=SIGMA)
        link = load_link(files.mesh, unit)
        task = cls.of(files.title, board, link, anchors, unit=unit, mirror=files.mirror)
        return replace(task, touches=tuple(touches))

    @classmethod
    def of(
        cls,
        title: str,
        board: BoardTable,
        link: tuple[FloatArray, IntArray],
        anchors: Sequence[Anchor],
        *,
        unit: float,
        mirror: bool = False,
    ) -> PatchTask:
        """Anchors in `unit` metres as a task in metres; `SIGMA` where they do not say."""
        stated = [anchor.sigma for anchor in anchors if anchor.sigma is not None]
        whole = len(stated) == len(anchors)
        spread = np.array(stated) * unit if whole else np.full(len(anchors), SIGMA)
        points = np.array([anchor.point for anchor in anchors]).reshape(-1, 3) * unit
        taxels = np.array([anchor.taxel for anchor in anchors], np.int64)
        return cls(title, board, link, taxels, points, spread, mirror=mirror)

    @property
    def kind(self) -> str:
        """What the patch is judged by: touches where there are any, else anchors."""
        return "touches" if self.touches else "anchors"

    def solve(self, seed: int = 0) -> SolvedPatch:
        """The patch, with the seconds of CPU that it took."""
        start = time.process_time()
        board, rng = self.board, np.random.default_rng(seed)
        how: dict[str, Any] = {
            "anchor_sigma": self.sigma, "modules": board.rigid_modules, "channels": board.channels,
            "mirror": self.mirror, "rng": rng,
        }  # fmt: skip
        try:
            if self.touches:
                anchors = (self.anchors, self.points) if len(self.anchors) else None
                found = locate_by_touch(
                    board.layout, *self.link, self.touches, anchors=anchors, **how
                )
            else:
                found = wrap_layout(board.layout, *self.link, self.anchors, self.points, **how)
        except np.linalg.LinAlgError as error:
            raise InvalidArrayError(
                f"board, link and measured places have no answer: {error}"
            ) from error
        return SolvedPatch(self, found, self._result(found, time.process_time() - start))

    def _result(self, found: PatchCalibration, seconds: float) -> PatchResult:
        """Result in words and millimetres."""
        rows = self._rows(found)
        left = MM * found.left_out.distance[: len(rows)]
        predicted = Spread.of(MM * found.predicted_sd)
        enough = len(rows) >= (FEWEST_TOUCHES if self.touches else FEWEST_ANCHORS)
        # Of touches the median: those that are wrong are wrong by any length.
        rms = float(np.median(left) if self.touches else np.sqrt(np.mean(left**2)))
        return PatchResult(
            status=grade(found.status), reasons=list(found.reasons), mirrored=found.mirrored,
            taxels=len(found), predicted_mm=predicted, predicted_sd_mm=predicted,
            leave_one_out_mm=Spread.of(left),
            leave_one_out_expected_mm=Spread.of(MM * found.left_out.expected[: len(rows)]),
            cross_validation_mm=rms if enough else None,
            strain_percent=_rms_percent(found.strain),
            expected_strain_percent=_rms_percent(found.expected_strain),
            unexpected_strain_percent=_rms_percent(found.residuals["strain"]),
            coverage=found.coverage, scale=found.scale, height_mm=MM * found.height,
            weakest=found.weakest, next=self.board.channels[found.next_taxels].tolist(),
            evidence=rows, mesh_notes=list(mesh_notes(*self.link)), seconds=seconds,
            touches=len(self.touches) or msgspec.UNSET,
        )  # fmt: skip

    def _rows(self, found: PatchCalibration) -> list[EvidenceRow]:
        """Touches where there are any, which come first in what was solved; else anchors."""
        felt = self.anchors.tolist()
        if self.touches:
            felt = [int(touch.channels[np.argmax(touch.values)]) for touch in self.touches]
        left, names = found.left_out, self.board.channels
        return [
            EvidenceRow(
                channel=int(names[taxel]), missed_mm=MM * float(left.missed[row]),
                leave_one_out_mm=MM * float(left.distance[row]),
                expected_mm=MM * float(left.expected[row]), misfit=float(left.misfit[row]),
            )
            for row, taxel in enumerate(felt)
        ]  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class SolvedPatch:
    """A task, the patch that was found, and its figures."""

    task: PatchTask
    found: PatchCalibration
    result: PatchResult

    @property
    def board(self) -> BoardTable:
        """The board as seen from outside."""
        board = self.task.board
        return replace(board, layout=board.layout * [-1.0, 1.0]) if self.task.mirror else board

    def lines(self, result: PatchResult) -> Iterator[str]:
        """What people read of it."""
        yield from patch_lines(result)
        every = MM * np.array([*self.task.sigma, *(touch.sigma for touch in self.task.touches)])
        low, high = f"{every.min():.3g}", f"{every.max():.3g}"
        span = low if low == high else f"{low} to {high}"
        yield f"sigma of measured places: {span} mm ({MM * SIGMA:g} mm where a file has none)"

    def write(self, folder: Path) -> list[str]:
        """Write the table; its name."""
        board, found = self.board, self.found
        order = np.argsort(board.channels, kind="stable")
        name = write_taxels(
            board.channels[order], found.positions[order], found.covariance[order],
            folder / "taxels.csv", modules=board.modules[order], normals=found.normals[order],
        )  # fmt: skip
        return [name]

    def page(self) -> str:
        """The report."""
        from calibration.commands.pages import (
            PLACED,
            board_picture,
            evidence_table,
            judged_page,
            places_picture,
        )

        task, result, board = self.task, self.result, self.board
        rows = {int(channel): row for row, channel in enumerate(board.channels)}
        taxels = np.array([rows[one.channel] for one in result.evidence], np.int64)
        drawn = board_picture(self.found, board.layout, board.channels, task.kind, taxels)
        pictures = [
            ("On the link", places_picture(self.found.positions, self.found.predicted_sd), PLACED),
            ("On the board", drawn, "Coloured by predicted error, with what to measure next."),
        ]
        evidence = evidence_table(result, task.kind)
        return judged_page(task.title, result, patch_lines(result), pictures, evidence)

    def save(self, folder: Path, *, accept: bool) -> PatchResult:
        """Write tables and report, of a refused patch only the report of why not."""
        refused = self.result.verdict(accept=accept).refused
        files = write_files(folder, refused, self.write, lambda _: self.page())
        return replace(self.result, files=files)


def load_link(path: Path, unit: float) -> tuple[FloatArray, IntArray]:
    """Vertices (v, 3) [m] and faces (f, 3) of a mesh file whose lengths are in `unit` metres."""
    vertices, faces = read_mesh(path)
    return vertices * unit, faces


def patch_lines(result: PatchResult) -> Iterator[str]:
    """What people read of a patch."""
    sd, left = result.predicted_sd_mm, result.leave_one_out_mm
    yield f"{result.taxels} taxels, {100 * result.coverage:.0f} % inside the hull of the evidence"
    yield from result.mesh_notes
    yield f"predicted error: median {sd.median:.2f} mm, worst {sd.max:.2f} mm"
    yield (
        f"each predicted from all others: off by {left.median:.2f} mm (median; "
        f"{result.leave_one_out_expected_mm.median:.2f} mm expected), {left.max:.2f} mm at most"
    )
    yield result.weakest
    yield f"measure next: channels {', '.join(map(str, result.next))}, in this order"


def _rms_percent(strain: FloatArray) -> float:
    return 100.0 * float(np.sqrt(np.mean(strain**2)))

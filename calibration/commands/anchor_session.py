"""Anchors picked one by one: a taxel on the flat board, its point on the link, solve, undo, save.

No picture in it: whoever draws (a window, a page) tells what was clicked and reads what to show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from calibration.commands.calibration_options import SIGMA, Outputs, PatchFiles
from calibration.commands.patch_task import PatchTask, SolvedPatch, load_link
from calibration.commands.results import MM
from calibration.files.tables import (
    Anchor,
    BoardTable,
    read_anchor_table,
    read_board,
    write_anchor_table,
)
from calibration.patch.patch_calibration import PatchCalibration
from calibration.patch.patch_evidence import FEWEST
from skinmap.arrays import FloatArray, IntArray, check_finite
from skinmap.errors import InvalidArrayError, SkinError
from skinmap.geometry.proximity import median_spacing
from skinmap.io.output import staged_folder
from skinmap.io.text import UNITS
from skinmap.report.present import drop_refusal

REACH = 0.75  # pitches: how far beside a taxel a click still means it
ANCHORS, REFUSED_ANCHORS = "anchors.csv", "refused_anchors.csv"
NOTHING_YET = "choose a taxel on the board, or a point on the link"


@dataclass(frozen=True, slots=True)
class Step:
    """What undo brings back: anchors, and what was chosen without its counterpart."""

    anchors: tuple[Anchor, ...] = ()
    taxel: int | None = None
    point: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Solution:
    """Result of some anchors: a patch, or the reason for none."""

    anchors: tuple[Anchor, ...]
    solved: SolvedPatch | None
    problem: str = ""

    @property
    def found(self) -> PatchCalibration | None:
        """The patch."""
        return None if self.solved is None else self.solved.found


class AnchorSession:
    """A board, a link, and the anchors picked so far.

    Parameters
    ----------
    board : BoardTable
    link : (v, 3) array of float [m], (f, 3) array of int
    anchors : sequence of Anchor
        To go on from, in `unit`.
    unit : float
        Of anchors in files, in metres; all else is in metres.
    title : str
        What is laid on what.
    mirror : bool
        Whether the board is drawn from its other side.

    Attributes
    ----------
    message : str
        What happened last, or what to do now.
    solution : Solution or None
        The last one; of earlier anchors until `solve` is called again (see `stale`).
    """

    def __init__(
        self,
        board: BoardTable,
        link: tuple[FloatArray, IntArray],
        anchors: Sequence[Anchor] = (),
        *,
        unit: float = 1.0,
        title: str = "board on link",
        mirror: bool = False,
    ) -> None:
        self.board, self.link = board, link
        self.unit, self.title, self.mirror = unit, title, mirror
        # A file without sigmas stays one: what is picked follows the same option as the rest.
        silent = any(anchor.sigma is None for anchor in anchors)
        self._stated = None if silent else SIGMA / unit
        self._steps = [Step(tuple(anchors))]
        self.solution: Solution | None = None
        self.reach = REACH * median_spacing(board.layout)
        self.message = self.advice()

    @classmethod
    def load(cls, files: PatchFiles) -> AnchorSession:
        """A session from files, as `skinmap calibrate wrap` reads them.

        Raises
        ------
        MissingFileError, DataFormatError
            A file that is missing or not what it should be (names the line).
        """
        unit = UNITS[files.units]
        board = read_board(files.layout, unit)
        return cls(
            board,
            load_link(files.mesh, unit),
            [] if files.anchors is None else read_anchor_table(files.anchors, board),
            unit=unit,
            title=files.title,
            mirror=files.mirror,
        )

    @property
    def anchors(self) -> tuple[Anchor, ...]:
        """Anchors picked so far."""
        return self._steps[-1].anchors

    @property
    def taxel(self) -> int | None:
        """Row of the taxel chosen, whose point is still missing."""
        return self._steps[-1].taxel

    @property
    def point(self) -> FloatArray | None:
        """(3,) point chosen, whose taxel is still missing [m]."""
        place = self._steps[-1].point
        return None if place is None else self.unit * np.array(place)

    @property
    def found(self) -> PatchCalibration | None:
        """The patch of the last solution, if there was one."""
        return None if self.solution is None else self.solution.found

    @property
    def stale(self) -> bool:
        """Whether anchors have changed since the last solution."""
        return self.solution is None or self.solution.anchors != self.anchors

    @property
    def ready(self) -> bool:
        """Whether there are enough anchors that were not solved yet."""
        return len(self.anchors) >= FEWEST and self.stale

    def channel(self, taxel: int) -> int:
        """What a taxel is called on the board."""
        return int(self.board.channels[taxel])

    def task(self) -> PatchTask:
        """The anchors as `skinmap calibrate wrap` would read them."""
        return PatchTask.of(
            self.title, self.board, self.link, self.anchors, unit=self.unit, mirror=self.mirror
        )

    def pick_board(self, place: ArrayLike) -> bool:
        """Choose the taxel nearest to a place (2,) on the board [m]; False where none is near."""
        away = np.linalg.norm(self.board.layout - check_finite(place, "place", (2,)), axis=1)
        nearest = int(np.argmin(away))
        if away[nearest] > self.reach:
            self.message = "no taxel there: click on one"
            return False
        self.pick_taxel(nearest)
        return True

    def pick_taxel(self, taxel: int) -> None:
        """Choose a taxel by its row; with a point chosen before, that is an anchor.

        Raises
        ------
        InvalidArrayError
            The board has no such taxel.
        """
        if not 0 <= taxel < len(self.board.layout):
            raise InvalidArrayError(
                f"taxel {taxel} of a board with taxels 0..{len(self.board.layout) - 1}"
            )
        self._pick(replace(self._steps[-1], taxel=int(taxel)))

    def pick_point(self, point: ArrayLike | None) -> None:
        """Choose a point (3,) on the link [m], None for a click beside it."""
        if point is None:
            self.message = "that missed the link: click on it"
            return
        x, y, z = (check_finite(point, "point", (3,)) / self.unit).tolist()
        self._pick(replace(self._steps[-1], point=(x, y, z)))

    def _pick(self, step: Step) -> None:
        if step.taxel is None or step.point is None:
            self._steps.append(step)
            self.message = self.advice()
            return
        name = self.channel(step.taxel)
        others = tuple(anchor for anchor in step.anchors if anchor.taxel != step.taxel)
        again = len(others) < len(step.anchors)
        self._steps.append(Step((*others, Anchor(step.taxel, step.point, self._stated))))
        done = f"taxel {name} has a new place" if again else f"taxel {name} is an anchor"
        self.message = f"{done}; {self.advice()}"

    def undo(self) -> bool:
        """Take back what was picked or removed last; False where there is nothing."""
        if len(self._steps) == 1:
            self.message = "nothing to take back"
            return False
        self._steps.pop()
        self.message = f"taken back; {self.advice()}"
        return True

    def remove(self, taxel: int | None = None) -> bool:
        """Remove the anchor of a taxel, of the one chosen by default; False if it has none."""
        taxel = self.taxel if taxel is None else taxel
        if taxel is None:
            self.message = "choose the taxel of an anchor first, then remove it"
            return False
        others = tuple(anchor for anchor in self.anchors if anchor.taxel != taxel)
        if len(others) == len(self.anchors):
            self.message = f"taxel {self.channel(taxel)} is not an anchor"
            return False
        self._steps.append(Step(others))
        self.message = f"anchor of taxel {self.channel(taxel)} removed; {self.advice()}"
        return True

    def advice(self) -> str:
        """What to do now."""
        if self.taxel is not None:
            return f"now click on the link where taxel {self.channel(self.taxel)} is"
        if self.point is not None:
            return "now click on the taxel of that point, on the board"
        missing = FEWEST - len(self.anchors)
        if missing > 0:
            more = "anchors" if missing > 1 else "anchor"
            return f"{NOTHING_YET}: {missing} {more} more to go"
        return NOTHING_YET

    def solve(self) -> Solution:
        """Lay the board on the link by the anchors there are, and keep what comes of it.

        A refused solution leaves no patch to show.
        """
        self.solution = solution = self._solved()
        found = solution.found
        self.message = solution.problem
        if found is not None:
            sd = MM * float(np.median(found.predicted_sd))
            verdict = f"{found.status}, {sd:.2f} mm predicted (median)"
            if found.reasons:
                verdict = f"{found.status}: {found.reasons[0]}"
            self.message = f"{verdict}; {self.advice()}"
        return solution

    def _solved(self) -> Solution:
        anchors = self.anchors
        if len(anchors) < FEWEST:
            return Solution(anchors, None, f"{len(anchors)} anchors, at least {FEWEST} are needed")
        try:
            return Solution(anchors, self.task().solve())
        except SkinError as error:
            return Solution(anchors, None, str(error))
        except (np.linalg.LinAlgError, ArithmeticError) as error:
            return Solution(anchors, None, f"these anchors cannot be solved: {error}")

    def save(self, output: Outputs) -> tuple[str, ...]:
        """Write what `skinmap calibrate wrap` writes, and the anchors; the names of the files.

        Where the status is not ok and not accepted, or there is no solution, earlier results
        stay as they are: only `refused.html` and `refused_anchors.csv` are written.

        Raises
        ------
        OutputError
            The folder cannot be written to.
        """
        out = cast("Path", output.out)
        solution = self.solution
        if solution is None or self.stale:
            solution = self.solve()
        with staged_folder(out) as stage:
            solved = solution.solved
            files = [] if solved is None else solved.save(stage, accept=output.accept).files
            good = "taxels.csv" in files
            if self.anchors:
                files = [*files, ANCHORS if good else REFUSED_ANCHORS]
                write_anchor_table(self.anchors, self.board, stage / files[-1])
        drop_refusal(out, files)
        reasons = [solution.problem] if solved is None else solved.result.reasons
        first = reasons[0] if reasons else ""
        self.message = f"saved in {out}" if good else f"not accepted, anchors kept: {first}"
        return tuple(files)

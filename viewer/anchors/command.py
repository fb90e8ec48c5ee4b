"""`skinmap anchors`: click taxels and their points, and see the wrapped patch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from calibration.commands.calibration_options import (
    FILE,
    NO_EFFORT,
    NO_SEED,
    Outputs,
    PatchFiles,
    board_options,
)
from calibration.commands.results import Grade
from skinmap.commands.options import PICTURE, file_option, out_folder, prints
from skinmap.commands.retired import retired
from skinmap.report.present import present
from skinmap.report.result import OK, Verdict

if TYPE_CHECKING:
    from calibration.commands.anchor_session import AnchorSession, SavedAnchors

BY_WRAP = "save the anchors and give them to `skinmap calibrate wrap`"


@dataclass(frozen=True, kw_only=True, slots=True)
class AnchorsResult:
    """A patch that was calibrated by hand.

    Attributes
    ----------
    status
        As of `calibrate wrap`; null where nothing was solved.
    reasons
        Why the patch is not to be used, or why there is none.
    anchors
        Number of picked anchors.
    refused
        Whether saving was asked for and the status not accepted.
    files
        Paths of what was written.
    """

    status: Grade | None
    reasons: list[str]
    anchors: int
    refused: bool
    files: list[str]


@click.command("anchors", short_help="Click where taxels are, and see the patch wrapped.")
@click.option(
    "--anchors", "anchors_file", type=FILE,
    help="To go on from: CSV `channel,x,y,z[,sigma]`, as `w` saves it.",
)  # fmt: skip
@file_option("--screenshot", PICTURE, "Solve, write a picture and end: needs no display.")
@board_options()
@out_folder("taxels.csv, report.html and anchors.csv")
@retired(**NO_EFFORT, format=BY_WRAP, accept=BY_WRAP, seed=NO_SEED)
@prints(AnchorsResult)
def anchors(files: PatchFiles, out: Path | None, screenshot: Path | None, as_json: bool) -> None:
    """Calibrate a patch by hand: click a taxel of the board, then its point on the link.

    From three anchors on the patch is wrapped and coloured by its predicted error; lines show how
    far anchors are missed, rings which taxels to measure next. `w` saves what `skinmap calibrate
    wrap` would write for the same anchors, and the anchors.

    \b
    Example:  skinmap anchors --layout board.csv --mesh link.stl -o out
    """
    from skinmap.display import has_display, require_opengl

    require_opengl()
    if screenshot is None and not has_display():
        raise click.UsageError("there is no display here: give --anchors and --screenshot")
    from calibration.commands.anchor_session import AnchorSession

    session, output = AnchorSession.load(files), Outputs(out=out)
    if screenshot is None:
        result = _by_hand(session, output)
    else:
        result = _picture(session, screenshot, output)
    verdict = Verdict("refused" if result.refused else OK)
    present(
        result,
        lambda found: [found.status or "not solved", *found.reasons],
        as_json=as_json,
        verdict=verdict,
    )


def _by_hand(session: AnchorSession, output: Outputs) -> AnchorsResult:
    from viewer.anchors.view import CalibrationView, run

    view = CalibrationView(session, off_screen=False, output=output)
    run(view)
    return _result(session, view.saved, output.out)


def _picture(session: AnchorSession, screenshot: Path, output: Outputs) -> AnchorsResult:
    import imageio.v3 as iio

    from skinmap.io.output import staged_file
    from viewer.anchors.view import CalibrationView

    with staged_file(screenshot) as path:
        view = CalibrationView(session, output=output)
        try:
            if session.anchors:
                view.solve_now()
            if output.out is not None:
                view.save()
                view.refresh()
            iio.imwrite(path, view.frame())
        finally:
            view.shut()
    result = _result(session, view.saved, output.out)
    return replace(result, files=[*result.files, str(screenshot)])


def _result(session: AnchorSession, saved: SavedAnchors | None, out: Path | None) -> AnchorsResult:
    """Status, reasons, anchors and files; refused where results were wanted and not written."""
    solution = session.solution
    solved = None if solution is None else solution.solved
    problem = "" if solution is None else solution.problem
    names = () if saved is None else saved.files
    return AnchorsResult(
        status=None if solved is None else solved.result.status,
        reasons=([problem] if problem else []) if solved is None else solved.result.reasons,
        anchors=len(session.anchors),
        refused=saved is not None and not saved.good,
        files=[str((out or Path()) / name) for name in names],
    )

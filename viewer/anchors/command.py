"""`skinmap anchors`: click taxels and their points, and see the wrapped patch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibration.commands.options import (
    FILE,
    accept_option,
    effort_options,
    format_option,
    layout_option,
    mesh_option,
    mirror_option,
    out_option,
    sigma_option,
    units_option,
)
from skinmap.commands.options import json_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.report.present import emit

if TYPE_CHECKING:
    from calibration.commands.anchor_session import AnchorSession


@click.command("anchors", short_help="Click where taxels are, and see the patch wrapped.")
@layout_option
@mesh_option
@click.option(
    "--anchors", "anchors_file", type=FILE,
    help="To go on from: CSV `channel,x,y,z[,sigma]`, as `w` saves it.",
)  # fmt: skip
@mirror_option
@units_option("all files")
@sigma_option("an anchor")
@out_option("taxels.csv, report.html and anchors.csv", required=False)
@format_option()
@click.option("--screenshot", type=FILE, help="Solve, write a picture and end: needs no display.")
@accept_option("With --screenshot: write whatever the status.")
@effort_options
@seed_option
@profile_option("calibrate")
@json_option
def anchors(
    layout_file: Path,
    mesh_file: Path,
    anchors_file: Path | None,
    mirror: bool,
    units: str,
    sigma_mm: float,
    out: Path | None,
    formats: tuple[str, ...],
    screenshot: Path | None,
    accept: bool,
    starts: int,
    steps: int,
    wrap_detail_mm: float,
    seed: int,
    as_json: bool,
) -> None:
    """Calibrate a patch by hand: click a taxel of the board, then its point on the link.

    From three anchors on the patch is wrapped and coloured by its predicted error; lines show how
    far anchors are missed, rings which taxels to measure next. `w` saves what `skinmap calibrate
    wrap` would write for the same anchors, and the anchors.

    \b
    Example:  skinmap anchors --layout board.csv --mesh link.stl -o out
    """
    from viewer.display import has_display, require_opengl

    require_opengl()
    if screenshot is None and not has_display():
        raise click.UsageError("there is no display here: give --anchors and --screenshot")
    from calibration.commands.anchor_session import AnchorSession
    from calibration.patch.solver_budget import Effort

    session = AnchorSession.load(
        layout_file, mesh_file, anchors_file,
        units=units, sigma_mm=sigma_mm, seed=seed, mirror=mirror,
        effort=Effort(starts, steps, 1e-3 * wrap_detail_mm),
    )  # fmt: skip
    if screenshot is None:
        result = _by_hand(session, out, formats)
    else:
        result = _picture(session, screenshot, out, formats, accept)
    if as_json:
        emit(result)
    else:
        for line in (result["status"] or "not solved", *result["reasons"], *result["files"]):
            click.echo(line)
    if result["refused"]:
        raise SystemExit(3)


def _by_hand(session: AnchorSession, out: Path | None, formats: tuple[str, ...]) -> dict[str, Any]:
    from viewer.anchors.view import CalibrationView
    from viewer.anchors.window import run

    view = CalibrationView(session, off_screen=False, out=out, formats=formats)
    run(view)
    return _result(session, view.saved, out)


def _picture(
    session: AnchorSession,
    screenshot: Path,
    out: Path | None,
    formats: tuple[str, ...],
    accept: bool,
) -> dict[str, Any]:
    import imageio.v3 as iio

    from skinmap.io.output import staged_file
    from viewer.anchors.view import CalibrationView

    with staged_file(screenshot) as path:
        view = CalibrationView(session, out=out, formats=formats)
        try:
            if session.anchors:
                view.solve_now()
            saved = None
            if out is not None:
                view.save(accept=accept)
                saved = view.saved
                view.refresh()
            iio.imwrite(path, view.frame())
        finally:
            view.shut()
    result = _result(session, saved, out)
    result["files"].append(str(screenshot))
    return result


def _result(
    session: AnchorSession, saved: dict[str, Any] | None, out: Path | None
) -> dict[str, Any]:
    """Status, reasons, anchors and files; refused where results were wanted and not written."""
    solution = session.solution
    found = None if solution is None else solution.found
    files = [str((out or Path()) / name) for name in (saved or {}).get("files", [])]
    problem = "" if solution is None else solution.problem
    return {
        "status": None if found is None else str(found.status),
        "reasons": list(found.reasons) if found is not None else [problem] if problem else [],
        "anchors": len(session.anchors),
        "refused": saved is not None and "taxels.csv" not in saved["files"],
        "files": files,
    }

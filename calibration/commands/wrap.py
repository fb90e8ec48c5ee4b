"""`skinmap calibrate wrap` and `touch`: a flat board on its link, by anchors or by touches."""

from __future__ import annotations

import click

from calibration.commands.options import FILE, PatchFiles, PatchOptions, patch_options
from calibration.commands.results import PatchResult
from skinmap.commands.options import prints
from skinmap.commands.progress import progress


@click.command("wrap")
@click.option(
    "--anchors", "anchors_file", type=FILE, required=True,
    help="Known places: CSV `channel,x,y,z[,sigma]`, at least three taxels.",
)  # fmt: skip
@patch_options("taxels.csv and report.html", of="all three files")
@prints(PatchResult)
def wrap(files: PatchFiles, options: PatchOptions, as_json: bool) -> None:
    """Lay a flat board on its link so that lengths hold and the anchors are where they were found.

    Writes taxels.csv (metres, in the frame of the mesh, with covariances) and report.html. Where
    the status is not ok, only refused.html is written and the exit code is 3, unless --accept.

    \b
    Example:  skinmap calibrate wrap --layout board.csv --mesh link.stl --anchors anchors.csv -o out
    """
    _calibrate(files, options, as_json)


@click.command("touch")
@click.option(
    "--touches", "touches_file", type=FILE, required=True,
    help="CSV `touch,x,y,z,channel,value[,sigma]`, a row for each channel that felt a touch.",
)  # fmt: skip
@click.option(
    "--anchors", "anchors_file", type=FILE, help="Known places: CSV `channel,x,y,z[,sigma]`."
)
@patch_options("taxels.csv and report.html", sigma="the probe or an anchor")
@prints(PatchResult)
def touch(files: PatchFiles, options: PatchOptions, as_json: bool) -> None:
    """Lay a flat board on its link so that lengths hold and touches are where the probe was.

    Some wrong touches and dead taxels do little harm. Says which taxels to touch next: run it
    again with those. Where the status is not ok, only refused.html is written and the exit code
    is 3, unless --accept.

    \b
    Example:  skinmap calibrate touch --layout board.csv --mesh link.stl --touches t.csv -o out
    """
    _calibrate(files, options, as_json)


def _calibrate(files: PatchFiles, options: PatchOptions, as_json: bool) -> None:
    from calibration.commands.patch_task import PatchTask

    with progress(1, "calibrate") as advance:
        task = PatchTask.load(files, options.effort)
        advance("by touches" if task.touches else "by anchors")
        solved = task.solve(options.seed)
    solved.present(options, as_json)

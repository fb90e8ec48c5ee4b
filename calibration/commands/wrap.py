"""`skinmap calibrate wrap`: a flat board on its link, by anchors, by touches or by both."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

import click

from calibration.commands.calibration_options import FILE, Outputs, PatchFiles, mesh_option, outputs
from calibration.commands.results import PatchResult
from skinmap.commands.options import PICTURE, prints, units_option
from skinmap.commands.overwriting import guard
from skinmap.commands.progress import progress

WINDOWS = "skinmap.anchor_windows"  # entry points: (files, output, picture or None) -> None
HERE = "(window)"


def _picture(ctx: click.Context, param: click.Parameter, value: str | None) -> str | Path | None:
    """A picture's path, checked; words that ask for no window or for one as they are."""
    if value in (None, HERE):
        return value
    return guard(ctx, param, PICTURE.convert(value, param, ctx))


@click.command("wrap")
@click.option(
    "--anchors", "anchors_file", type=FILE,
    help="Known places: CSV `channel,x,y,z[,sigma]`, at least three taxels without --touches.",
)  # fmt: skip
@click.option(
    "--touches", "touches_file", type=FILE,
    help="Touches with a tracked probe: CSV `touch,x,y,z,channel,value[,sigma]`, a row for each "
    "channel that felt a touch.",
)  # fmt: skip
@click.option(
    "--window",
    metavar="[PICTURE]",
    is_flag=False,
    flag_value=HERE,
    callback=_picture,
    help="Click taxels and their points in a window, where evidence is optional; with the name "
    "of a picture, write what the window shows instead.",
)
@click.option(
    "--layout", "layout_file", type=FILE, required=True,
    help="Board: CSV `channel,x,y[,module]`.",
)  # fmt: skip
@mesh_option
@click.option(
    "--mirror", is_flag=True, help="The board is drawn from its other side: mirror the drawing."
)
@units_option("all files")
@outputs("taxels.csv and report.html", required=True)
@prints(PatchResult)
def wrap(
    layout_file: Path,
    mesh_file: Path,
    anchors_file: Path | None,
    touches_file: Path | None,
    units: str,
    mirror: bool,
    window: str | Path | None,
    output: Outputs,
) -> None:
    """Lay a flat board on its link so that lengths hold, by anchors, by touches or by both.

    Anchors and touches stay where they were found. Some wrong touches and dead taxels do little
    harm, and the result names the taxels to touch next: run it again with those.

    Writes taxels.csv (metres, in the frame of the mesh, with covariances) and report.html. Where
    the status is not ok, only refused.html is written and the exit code is 3, unless --accept.

    The window colours the patch by its predicted error from three anchors on; lines show how far
    anchors are missed, rings the taxels to measure next. `w` saves, with the anchors.

    \b
    Example:  skinmap calibrate wrap --layout board.csv --mesh link.stl --anchors anchors.csv -o out
              skinmap calibrate wrap --layout board.csv --mesh link.stl --touches t.csv -o out
              skinmap calibrate wrap --layout board.csv --mesh link.stl --window -o out
    """
    files = PatchFiles(
        layout=layout_file, mesh=mesh_file, anchors=anchors_file, touches=touches_file,
        units=units, mirror=mirror,
    )  # fmt: skip
    if window is not None:
        if files.touches is not None:
            raise click.UsageError("--window takes anchors; leave out --touches")
        found = list(entry_points(group=WINDOWS, name="window"))
        if not found:
            raise click.UsageError("--window needs the viewer, which is not installed")
        found[0].load()(files, output, None if window == HERE else window)
        return
    if files.anchors is None and files.touches is None:
        raise click.UsageError("give --anchors or --touches, or --window to click anchors")
    from calibration.commands.patch_task import PatchTask

    with progress(1, "calibrate") as advance:
        task = PatchTask.load(files)
        advance("by touches" if task.touches else "by anchors")
        solved = task.solve()
    output.finish(solved.result, solved.lines, solved.write, solved.page)

"""`skinmap calibrate wrap`: a flat board on its link, by a few anchors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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
from skinmap.commands.progress import progress
from skinmap.report.present import emit

STEPS = 3
REFUSED = "refused.html"  # as in patch_job, which a command imports only when it runs


@click.command("wrap")
@layout_option
@mesh_option
@click.option(
    "--anchors", "anchors_file", type=FILE, required=True,
    help="Known places: CSV `channel,x,y,z[,sigma]`, at least three taxels.",
)  # fmt: skip
@mirror_option
@units_option("all three files")
@sigma_option("an anchor")
@out_option("taxels.csv and report.html")
@format_option()
@accept_option("Write taxels and exit 0 whatever the status.")
@effort_options
@seed_option
@profile_option("calibrate")
@json_option
def command(
    layout_file: Path,
    mesh_file: Path,
    anchors_file: Path,
    mirror: bool,
    units: str,
    sigma_mm: float,
    out: Path,
    formats: tuple[str, ...],
    accept: bool,
    starts: int,
    steps: int,
    wrap_detail_mm: float,
    seed: int,
    as_json: bool,
) -> None:
    """Lay a flat board on its link so that lengths hold and the anchors are where they were found.

    Writes taxels.csv (metres, in the frame of the mesh, with covariances) and report.html. Where
    the status is not ok, only refused.html is written and the exit code is 3, unless --accept.

    \b
    Example:  skinmap calibrate wrap --layout board.csv --mesh link.stl --anchors anchors.csv -o out
    """
    from calibration.files.anchor_table import load_wrap
    from calibration.patch.solver_budget import Effort
    from skinmap.io.output import staged_folder

    effort = Effort(starts, steps, 1e-3 * wrap_detail_mm)
    with staged_folder(out) as stage, progress(STEPS, "calibrate") as advance:
        task = load_wrap(
            layout_file, mesh_file, anchors_file, units=units, sigma_mm=sigma_mm, mirror=mirror,
            effort=effort,
        )  # fmt: skip
        advance("wrap")
        found, seconds = task.solve(seed)
        advance("report")
        result = task.write(stage, found, seconds, formats=formats, accept=accept)
    show(result, out, as_json)


def show(result: dict[str, Any], out: Path, as_json: bool) -> None:
    """One JSON object, or a few lines for people; exit 3 where the result was refused."""
    if as_json:
        emit(result)
    else:
        _tell(result, out)
    if REFUSED in result["files"]:
        raise SystemExit(3)


def _tell(result: dict[str, Any], out: Path) -> None:
    sd, left = result["predicted_mm"], result["leave_one_out_mm"]
    click.echo(f"{result['status']}: {result['taxels']} taxels")
    for reason in result["reasons"]:
        click.echo(f"  {reason}")
    for note in result["mesh_notes"]:
        click.echo(f"  {note}")
    click.echo(f"predicted error: median {sd['median']:.2f} mm, worst {sd['max']:.2f} mm")
    expected = result["leave_one_out_expected_mm"]["median"]
    click.echo(
        f"left out, one is missed by {left['median']:.2f} mm (median; {expected:.2f} mm expected), "
        f"{left['max']:.2f} mm at most"
    )
    click.echo(f"measure next: channels {', '.join(map(str, result['next']))}")
    for file in result["files"]:
        click.echo(str(out / file))

"""`skinmap calibrate touch`: a flat board on its link, by touches with a known probe."""

from __future__ import annotations

from pathlib import Path

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
from calibration.commands.wrap import STEPS, show
from skinmap.commands.options import json_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress


@click.command("touch")
@layout_option
@mesh_option
@click.option(
    "--touches", "touches_file", type=FILE, required=True,
    help="CSV `touch,x,y,z,channel,value[,sigma]`, a row for each channel that felt a touch.",
)  # fmt: skip
@click.option(
    "--anchors", "anchors_file", type=FILE, help="Known places: CSV `channel,x,y,z[,sigma]`."
)
@mirror_option
@units_option("all files")
@sigma_option("the probe or an anchor")
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
    touches_file: Path,
    anchors_file: Path | None,
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
    """Lay a flat board on its link so that lengths hold and touches are where the probe was.

    Some wrong touches and dead taxels do little harm. Says which taxels to touch next: run it
    again with those. Where the status is not ok, only refused.html is written and the exit code
    is 3, unless --accept.

    \b
    Example:  skinmap calibrate touch --layout board.csv --mesh link.stl --touches t.csv -o out
    """
    import numpy as np

    from calibration.commands.patch_job import PatchTask
    from calibration.files.anchor_table import load_link
    from calibration.files.tables import read_anchors, read_board, read_touches
    from calibration.patch.solver_budget import Effort
    from skinmap.io.output import staged_folder
    from skinmap.io.units import UNITS

    with staged_folder(out) as stage, progress(STEPS, "calibrate") as advance:
        unit = UNITS[units]
        board = read_board(layout_file, unit)
        touches = read_touches(touches_file, board, unit, sigma=1e-3 * sigma_mm)
        taxels, points, stated = np.zeros(0, np.int64), np.zeros((0, 3)), None
        if anchors_file is not None:
            taxels, points, stated = read_anchors(anchors_file, board, unit)
        task = PatchTask(
            f"{layout_file.stem} on {mesh_file.stem}", board, load_link(mesh_file, unit),
            taxels, points, np.full(len(taxels), 1e-3 * sigma_mm) if stated is None else stated,
            tuple(touches), mirror, Effort(starts, steps, 1e-3 * wrap_detail_mm),
        )  # fmt: skip
        advance("locate")
        found, seconds = task.solve(seed)
        advance("report")
        result = task.write(stage, found, seconds, formats=formats, accept=accept)
    show(result | {"touches": len(touches)}, out, as_json)

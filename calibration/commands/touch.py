"""`skinmap calibrate touch`: a flat board on its link, by touches with a known probe."""

from __future__ import annotations

import time
from pathlib import Path

import click

from calibration.commands.options import (
    FILE,
    accept_option,
    effort_options,
    format_option,
    layout_option,
    mesh_option,
    out_option,
    sigma_option,
    units_option,
)
from calibration.commands.wrap import STEPS, show
from skinmap.cli.common import json_option, profile_option, progress, seed_option


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

    from calibration.commands.patch_job import summary, write_results
    from calibration.commands.patch_report import EvidenceRows
    from calibration.files.tables import UNITS as METRES
    from calibration.files.tables import read_anchors, read_board, read_touches
    from calibration.patch.held_out import held_out_touches
    from calibration.patch.solver_budget import Effort
    from calibration.patch.touch import locate_by_touch
    from skinmap.io.output import staged_folder
    from skinmap.io.urdf import read_mesh

    effort = Effort(starts, steps, 1e-3 * wrap_detail_mm)
    with staged_folder(out) as stage, progress(STEPS, "calibrate") as advance:
        unit = METRES[units]
        board = read_board(layout_file, unit)
        touches = read_touches(touches_file, board, unit, sigma=1e-3 * sigma_mm)
        vertices, faces = read_mesh(mesh_file)
        link = (vertices * unit, faces)
        anchors, spread = None, np.array(1e-3 * sigma_mm)
        if anchors_file is not None:
            taxels, points, stated = read_anchors(anchors_file, board, unit)
            anchors, spread = (taxels, points), spread if stated is None else stated
        advance("locate")
        start = time.process_time()
        found = locate_by_touch(
            board.layout, *link, touches, anchors=anchors, anchor_sigma=spread,
            effort=effort, rng=np.random.default_rng(seed),
        )  # fmt: skip
        seconds = time.process_time() - start
        advance("cross-validation")
        held_out = held_out_touches(found, board.layout, *link, touches, effort=effort)
        advance("report")
        centre = np.array([touch.channels[np.argmax(touch.values)] for touch in touches])
        sigma = np.array([touch.sigma for touch in touches])
        missed = sigma * np.linalg.norm(found.residuals["touches"], axis=1)
        rows = EvidenceRows("touches", centre, missed, held_out)
        # The median: touches that are wrong are wrong by any length.
        median = float(np.median(held_out)) if len(held_out) else None
        result = summary(found, board.channels, median, seconds) | {"touches": len(touches)}
        title = f"{layout_file.stem} on {mesh_file.stem}"
        result |= write_results(stage, title, result, found, board, link, rows, formats, accept)
    show(result, out, as_json)

"""`skinmap calibrate batch`: many flat boards on their links, each by a few anchors."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import click

from calibration.commands.options import (
    FILE,
    accept_option,
    effort_options,
    format_option,
    out_option,
    sigma_option,
    units_option,
)
from skinmap.commands.options import json_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress
from skinmap.commands.workers import worker_options, workers_options
from skinmap.report.present import emit
from skinmap.report.table import table

NOT_OK = 3


@click.command("batch")
@click.argument("table_file", metavar="TABLE", type=FILE)
@units_option("files, where the table does not say")
@sigma_option("an anchor")
@out_option("a folder with taxels.csv and report.html for each patch")
@format_option()
@accept_option("Write taxels and exit 0 whatever the status.")
@effort_options
@workers_options
@seed_option
@profile_option("calibrate")
@json_option
def command(
    table_file: Path,
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
    **options: Any,
) -> None:
    """Lay many boards on their links, each as `calibrate wrap` does.

    TABLE is a CSV `name,layout,mesh,anchors[,units,sigma_mm,mirror]`, a row for each patch, with
    files as seen from its folder. A patch that cannot be calibrated does not stop the others: it is
    listed as failed, with the reason. The exit code is 3 where not all patches are ok. With
    --resume FOLDER an interrupted run goes on where it ended.

    \b
    Example:  skinmap calibrate batch patches.csv --jobs 4 --resume patches.resume -o patches
    """
    from calibration.commands.batch_job import batch_tasks, calibrate_batch, read_batch
    from calibration.patch.solver_budget import Effort
    from skinmap.io.output import staged_folder

    spread = worker_options(options)
    rows = read_batch(table_file, units, sigma_mm)
    effort = Effort(starts, steps, 1e-3 * wrap_detail_mm)
    tasks = batch_tasks(rows, seed=seed, formats=formats, accept=accept, effort=effort)
    with (
        staged_folder(out) as stage,
        spread.open("calibrate batch") as workers,
        progress(len(rows), "calibrate") as advance,
    ):
        patches = calibrate_batch(tasks, stage, workers=workers, progress=advance)
    counts = Counter(patch["status"] for patch in patches)
    if as_json:
        emit({"statuses": counts, "patches": patches, "seed": seed})
    else:
        _tell(patches)
    if set(counts) - {"ok"} and not (accept and "failed" not in counts):
        raise SystemExit(NOT_OK)


def _tell(patches: list[dict[str, Any]]) -> None:
    table(
        ["patch", "status", "taxels", "predicted error mm", "why"],
        [
            [
                patch["patch"],
                patch["status"],
                patch.get("taxels", 0),
                patch["predicted_sd_mm"]["median"] if "predicted_sd_mm" in patch else "-",
                "; ".join(patch["reasons"])[:100],
            ]
            for patch in patches
        ],
    )

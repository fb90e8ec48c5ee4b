"""`skinmap calibrate wrap`: a flat board on its link, by a few anchors."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.cli.common import emit, json_option, progress, seed_option

if TYPE_CHECKING:
    from calibration.patch import PatchCalibration
    from calibration.report import EvidenceRows
    from calibration.tables import BoardTable
    from skinmap.arrays import FloatArray, IntArray

FILE = click.Path(path_type=Path, dir_okay=False)
UNITS = ("m", "cm", "mm", "inch")
STEPS = 4
REFUSED = "refused.html"  # the report of a result that is not ok and was not accepted


@click.command("wrap")
@click.option(
    "--layout", "layout_file", type=FILE, required=True, help="Board: CSV `channel,x,y[,module]`."
)
@click.option("--mesh", "mesh_file", type=FILE, required=True, help="Link: STL, OBJ, PLY ...")
@click.option(
    "--anchors", "anchors_file", type=FILE, required=True,
    help="Known places: CSV `channel,x,y,z[,sigma]`, at least three taxels.",
)  # fmt: skip
@click.option(
    "--units", type=click.Choice(UNITS), default="m", show_default=True,
    help="Unit of all three files.",
)  # fmt: skip
@click.option(
    "--sigma-mm", type=click.FloatRange(min=0, min_open=True), default=1.0, show_default=True,
    help="Error of an anchor's coordinate, where the file does not say [mm].",
)  # fmt: skip
@click.option(
    "-o", "--out", type=click.Path(path_type=Path, file_okay=False), required=True,
    help="Folder for taxels.csv and report.html.",
)  # fmt: skip
@click.option(
    "--format", "formats", type=click.Choice(["csv", "icub"]), multiple=True,
    help="Also write the iCub's positions, as taxels.txt.",
)  # fmt: skip
@click.option("--accept", is_flag=True, help="Write taxels and exit 0 whatever the status.")
@seed_option
@json_option
def command(
    layout_file: Path,
    mesh_file: Path,
    anchors_file: Path,
    units: str,
    sigma_mm: float,
    out: Path,
    formats: tuple[str, ...],
    accept: bool,
    seed: int,
    as_json: bool,
) -> None:
    """Lay a flat board on its link so that lengths hold and the anchors are where they were found.

    Writes taxels.csv (metres, in the frame of the mesh, with covariances) and report.html. Where
    the status is not ok, only refused.html is written and the exit code is 3, unless --accept.

    \b
    Example:  skinmap calibrate wrap --layout board.csv --mesh link.stl --anchors anchors.csv -o out
    """
    import numpy as np

    from calibration.held_out import held_out_errors
    from calibration.report import EvidenceRows
    from calibration.tables import UNITS as METRES
    from calibration.tables import read_anchors, read_board
    from calibration.wrap import wrap_layout
    from skinmap.io.output import staged_folder
    from skinmap.io.urdf import read_mesh

    with staged_folder(out) as stage, progress(STEPS, "calibrate") as advance:
        unit = METRES[units]
        board = read_board(layout_file, unit)
        anchors, points, sigma = read_anchors(anchors_file, board, unit)
        vertices, faces = read_mesh(mesh_file)
        link = (vertices * unit, faces)
        spread = np.full(len(points), 1e-3 * sigma_mm) if sigma is None else sigma
        advance("wrap")
        start = time.process_time()
        found = wrap_layout(
            board.layout, *link, anchors, points, anchor_sigma=spread,
            rng=np.random.default_rng(seed),
        )  # fmt: skip
        seconds = time.process_time() - start
        advance("cross-validation")
        held_out = held_out_errors(found, board.layout, *link, anchors, points, anchor_sigma=spread)
        advance("report")
        rms = float(np.sqrt(np.mean(held_out**2))) if len(held_out) else None
        missed = np.linalg.norm(found.positions[anchors] - points, axis=1)
        rows = EvidenceRows("anchors", anchors, missed, held_out)
        result = summary(found, board.channels, rms, seconds)
        title = f"{layout_file.stem} on {mesh_file.stem}"
        result |= write_results(stage, title, result, found, board, link, rows, formats, accept)
    show(result, out, as_json)


def write_results(
    stage: Path,
    title: str,
    result: dict[str, Any],
    found: PatchCalibration,
    board: BoardTable,
    link: tuple[FloatArray, IntArray],
    rows: EvidenceRows,
    formats: tuple[str, ...],
    accept: bool,
) -> dict[str, list[str]]:
    """Tables and report, or only the report of why not; their names."""
    from calibration.patch import Status
    from calibration.report import write_patch_report
    from calibration.tables import write_calibrated, write_icub_table

    good = accept or found.status is Status.OK
    report = "report.html" if good else REFUSED
    write_patch_report(title, result, found, board, link, rows, stage / report)
    files = [report]
    if good:
        write_calibrated(board, found, stage / "taxels.csv")
        files.insert(0, "taxels.csv")
        if "icub" in formats:
            write_icub_table(board, found, stage / "taxels.txt", title.split(" on ")[-1])
            files.insert(1, "taxels.txt")
    return {"files": files}


def summary(
    found: PatchCalibration, channels: IntArray, held_out: float | None, seconds: float
) -> dict[str, Any]:
    """What the command prints as JSON, but for its files."""
    import numpy as np

    sd = 1e3 * found.predicted_sd
    return {
        "status": str(found.status),
        "reasons": list(found.reasons),
        "taxels": len(found),
        "predicted_sd_mm": {
            "median": float(np.median(sd)),
            "p95": float(np.percentile(sd, 95)),
            "max": float(sd.max()),
        },
        "cross_validation_mm": None if held_out is None else 1e3 * held_out,
        "coverage": found.coverage,
        "scale": found.scale,
        "height_mm": 1e3 * found.height,
        "weakest": found.weakest,
        "next": channels[found.next_taxels].tolist(),
        "seconds": seconds,
    }


def show(result: dict[str, Any], out: Path, as_json: bool) -> None:
    """One JSON object, or a few lines for people; exit 3 where the result was refused."""
    if as_json:
        emit(result)
    else:
        _tell(result, out)
    if REFUSED in result["files"]:
        raise SystemExit(3)


def _tell(result: dict[str, Any], out: Path) -> None:
    sd = result["predicted_sd_mm"]
    click.echo(f"{result['status']}: {result['taxels']} taxels")
    for reason in result["reasons"]:
        click.echo(f"  {reason}")
    click.echo(f"predicted error: median {sd['median']:.2f} mm, worst {sd['max']:.2f} mm")
    if result["cross_validation_mm"] is not None:
        click.echo(f"what is left out is missed by {result['cross_validation_mm']:.2f} mm")
    click.echo(f"measure next: {', '.join(map(str, result['next']))}")
    for file in result["files"]:
        click.echo(str(out / file))

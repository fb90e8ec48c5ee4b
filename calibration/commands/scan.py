"""`skinmap calibrate scan`: a 3D scan of a covered link, registered to the link's mesh."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibration.commands.options import (
    FILE,
    accept_option,
    format_option,
    mesh_option,
    out_option,
    units_option,
)
from skinmap.commands.options import json_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.report.present import emit
from skinmap.report.result import plain

if TYPE_CHECKING:
    from calibration.scan.registration import ScanRegistration

REFUSED = "refused.html"


@click.command("scan")
@click.option(
    "--scan", "scan_file", type=FILE, required=True,
    help="Points: CSV `x,y,z`, or a mesh file (STL, PLY with triangles ...) for its vertices.",
)  # fmt: skip
@mesh_option
@click.option(
    "--anchors", "anchors_file", type=FILE,
    help="The same points in both: CSV `x,y,z,mesh_x,mesh_y,mesh_z`, three or more.",
)  # fmt: skip
@click.option(
    "--initial", "initial_file", type=FILE,
    help="Rough pose that takes the scan to the mesh: CSV of four rows of four [m].",
)  # fmt: skip
@units_option("scan, mesh and anchors")
@click.option(
    "--taxels", "taxels_file", type=FILE,
    help="Taxels seen in the scan, in its frame: CSV `channel,x,y,z[,sigma]`.",
)  # fmt: skip
@out_option("pose.json and report.html")
@format_option("With --taxels: also write the iCub's positions, as taxels.txt.")
@accept_option("Write the pose and exit 0 whatever the status.")
@seed_option
@profile_option("calibrate")
@json_option
def command(
    scan_file: Path,
    mesh_file: Path,
    anchors_file: Path | None,
    initial_file: Path | None,
    units: str,
    taxels_file: Path | None,
    out: Path,
    formats: tuple[str, ...],
    accept: bool,
    seed: int,
    as_json: bool,
) -> None:
    """Register a scan of a link to its mesh, from a pose within 30 degrees and 30 mm.

    The start is --initial, or --anchors; without either, the frames are taken as equal. Where
    the status is not ok, only refused.html is written and the exit code is 3, unless --accept.
    With --taxels, taxels.csv holds them in the frame of the mesh.

    \b
    Example:  skinmap calibrate scan --scan scan.csv --mesh link.stl --anchors pairs.csv -o out
    """
    import json

    import numpy as np

    from calibration.commands.scan_report import write_scan_report
    from calibration.files.mount_files import write_tables
    from calibration.files.tables import read_numbers, read_placed, read_points
    from calibration.patch.patch_calibration import Status
    from calibration.scan.registration import carried, register_scan
    from skinmap.io.output import staged_folder
    from skinmap.io.robots.urdf import read_mesh
    from skinmap.io.units import UNITS

    with staged_folder(out) as stage:
        unit = UNITS[units]
        points = read_points(scan_file) * unit
        vertices, faces = read_mesh(mesh_file)
        vertices = vertices * unit
        names = ("x", "y", "z", "mesh_x", "mesh_y", "mesh_z")
        pairs = None if anchors_file is None else read_numbers(anchors_file, names) * unit
        taxels = None if taxels_file is None else read_placed(taxels_file, unit)
        initial = None if initial_file is None else read_numbers(initial_file, None)
        start = time.process_time()
        found = register_scan(
            points, vertices, faces, initial=initial,
            anchors=None if pairs is None else (pairs[:, :3], pairs[:, 3:]),
            rng=np.random.default_rng(seed),
        )  # fmt: skip
        result = _summary(found, time.process_time() - start)
        good = accept or found.status is Status.OK
        report = "report.html" if good else REFUSED
        result["files"] = ["pose.json", report] if good else [report]
        title = f"{scan_file.stem} on {mesh_file.stem}"
        write_scan_report(title, result, found, points, (vertices, faces), stage / report)
        if good:
            kept = {key: result[key] for key in ("status", "T_mesh_scan", "covariance")}
            (stage / "pose.json").write_text(json.dumps(plain(kept), indent=2) + "\n")
            if taxels is not None:
                channels, places, sigma = taxels
                moved, covariance = carried(found, points, places, sigma)
                write_tables(channels, moved, covariance, stage / "taxels.csv", formats=formats)
                tables = sorted(path.name for path in stage.glob("taxels.*"))
                result["files"] = [*result["files"], *tables]
    if as_json:
        emit(result)
    else:
        click.echo(f"{result['status']}: {result['rms_mm']:.2f} mm from the mesh (rms)")
        for line in (*result["reasons"], *(str(out / file) for file in result["files"])):
            click.echo(line)
    if not good:
        raise SystemExit(3)


def _summary(found: ScanRegistration, seconds: float) -> dict[str, Any]:
    return {
        "status": str(found.status),
        "reasons": list(found.reasons),
        "rms_mm": 1e3 * found.rms,
        "share_on_mesh": found.share,
        "free_directions": list(found.free_directions),
        "T_mesh_scan": found.T_mesh_scan,
        "covariance": found.covariance,
        "runner_up": found.runner_up,
        "runner_up_cost": found.runner_up_cost,
        "seconds": seconds,
    }

"""`skinmap calibrate scan`: a 3D scan of a covered link, registered to the link's mesh."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibration.commands.calibration_options import FILE, Outputs, mesh_option, outputs
from calibration.commands.results import MM, Calibrated, Matrix, grade
from skinmap.commands.options import prints, units_option
from skinmap.report.result import plain

if TYPE_CHECKING:
    from calibration.scan.registration import ScanRegistration
    from skinmap.arrays import FloatArray, IntArray

PAIRS = ("x", "y", "z", "mesh_x", "mesh_y", "mesh_z")
FAR = 3e-3  # end of the colour scale of the page [m]
MAX_DRAWN = 4_000  # points on the page


@dataclass(frozen=True, kw_only=True, slots=True)
class ScanResult(Calibrated):
    """Pose of a scan on a mesh.

    Attributes
    ----------
    rms_mm
        Distance of the scan from the mesh once it stands off, of what lies on it, root mean square.
    standoff_mm, standoff_sd_mm
        How far the scan lies above the mesh, as where a skin covers it, and the standard deviation.
    share_on_mesh
        Of the scan's points.
    free_directions
        Motions that the shape leaves free, in words.
    T_mesh_scan
        Takes points of the scan to the frame of the mesh [m].
    covariance
        Of a rotation vector [rad] about the scan's middle, then of a shift [m].
    """

    rms_mm: float
    standoff_mm: float
    standoff_sd_mm: float
    share_on_mesh: float
    free_directions: list[str]
    T_mesh_scan: Matrix
    covariance: Matrix


@dataclass(frozen=True, eq=False, slots=True)
class ScanFiles:
    """A scan and its mesh, in metres.

    Attributes
    ----------
    title : str
        What is on what.
    points : (n, 3) float
        Of the scan.
    link : (v, 3) array of float, (f, 3) array of int
    anchors : (k, 3) float, (k, 3) float or None
        The same points in the scan and on the mesh.
    taxels : (n,) int, (n, 3) float, (n,) float or None
        Channels, places in the scan, and sigmas.
    """

    title: str
    points: FloatArray
    link: tuple[FloatArray, IntArray]
    anchors: tuple[FloatArray, FloatArray] | None
    taxels: tuple[IntArray, FloatArray, FloatArray] | None


@click.command("scan")
@click.argument("scan_file", metavar="SCAN", type=FILE)
@mesh_option
@click.option(
    "--anchors", "anchors_file", type=FILE,
    help="The same points in both: CSV `x,y,z,mesh_x,mesh_y,mesh_z`, three or more.",
)  # fmt: skip
@units_option("scan, mesh and anchors")
@click.option(
    "--taxels", "taxels_file", type=FILE,
    help="Taxels seen in the scan, in its frame: CSV `channel,x,y,z[,sigma]`.",
)  # fmt: skip
@outputs("pose.json and report.html", required=True)
@prints(ScanResult)
def scan(output: Outputs, **given: Any) -> None:
    """Register a scan of a link to its mesh, from a pose within 30 degrees and 30 mm.

    SCAN holds points: CSV `x,y,z`, or a mesh file (STL, PLY with triangles ...) for its vertices.
    The start is --anchors; without them, the frames are taken as equal. Where
    the status is not ok, only refused.html is written and the exit code is 3, unless --accept.
    With --taxels, taxels.csv holds them in the frame of the mesh.

    \b
    Example:  skinmap calibrate scan scan.csv --mesh link.stl --anchors pairs.csv -o out
    """
    output.of("scan", lambda: work(_load(**given)), _lines, _write, _page)


def _load(
    scan_file: Path,
    mesh_file: Path,
    anchors_file: Path | None,
    units: str,
    taxels_file: Path | None,
) -> ScanFiles:
    from calibration.files.tables import read_numbers, read_placed, read_points
    from skinmap.io.robots.mesh_file import read_mesh
    from skinmap.io.text import UNITS

    unit = UNITS[units]
    points = read_points(scan_file) * unit
    vertices, faces = read_mesh(mesh_file)
    pairs = None if anchors_file is None else read_numbers(anchors_file, PAIRS) * unit
    taxels = None if taxels_file is None else read_placed(taxels_file, unit)
    anchors = None if pairs is None else (pairs[:, :3], pairs[:, 3:])
    title = f"{scan_file.stem} on {mesh_file.stem}"
    return ScanFiles(title, points, (vertices * unit, faces), anchors, taxels)


def work(files: ScanFiles) -> tuple[ScanResult, ScanFiles, ScanRegistration]:
    """Register the scan."""
    import numpy as np

    from calibration.scan.registration import register_scan

    rng = np.random.default_rng(0)
    found = register_scan(files.points, *files.link, anchors=files.anchors, rng=rng)
    result = ScanResult(
        status=grade(found.status),
        reasons=list(found.reasons),
        rms_mm=MM * found.rms,
        standoff_mm=MM * found.standoff,
        standoff_sd_mm=MM * found.standoff_sd,
        share_on_mesh=found.share,
        free_directions=list(found.free_directions),
        T_mesh_scan=found.T_mesh_scan.tolist(),
        covariance=found.covariance.tolist(),
    )
    return result, files, found


def _write(files: ScanFiles, found: ScanRegistration, folder: Path) -> list[str]:
    import numpy as np

    from calibration.files.tables import write_taxels
    from calibration.scan.registration import carried

    kept = {key: getattr(found, key) for key in ("status", "T_mesh_scan", "covariance")}
    (folder / "pose.json").write_text(json.dumps(plain(kept), indent=2) + "\n", encoding="utf-8")
    if files.taxels is None:
        return ["pose.json"]
    channels, places, sigma = files.taxels
    sigma = np.where(sigma > 0.0, sigma, found.rms)  # no better than the scan itself
    moved, covariance = carried(found, files.points, places, sigma)
    return ["pose.json", write_taxels(channels, moved, covariance, folder / "taxels.csv")]


def _page(files: ScanFiles, found: ScanRegistration, result: ScanResult) -> str:
    import numpy as np

    from calibration.commands.pages import judged_page, places_picture
    from skinmap.geometry.proximity import closest_on_mesh
    from skinmap.geometry.rigid import transform_points

    some = files.points[:: max(1, len(files.points) // MAX_DRAWN)]
    here = transform_points(found.T_mesh_scan, some)
    off = np.minimum(closest_on_mesh(here, *files.link)[0], FAR)
    words = f"distance from the mesh, at most {MM * FAR:.0f} [mm]"
    link = files.link[0][:: max(1, len(files.link[0]) // MAX_DRAWN)]
    png = places_picture(here, off, words, most=FAR, behind=link)
    words = "Points from two sides, coloured by their distance from the mesh, its corners in grey."
    pictures = [("Points of the scan", png, words)]
    return judged_page(files.title, result, _lines(result), pictures)


def _lines(result: ScanResult) -> Iterator[str]:
    above = f"{result.standoff_mm:.2f} mm above the mesh"
    share = f"{100 * result.share_on_mesh:.0f} % of the scan on the mesh"
    yield f"{result.rms_mm:.2f} mm (rms) from {above}, {share}"

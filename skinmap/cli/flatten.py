"""`skinmap flatten`: flat maps of the skin and what they distort."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.cli.common import (
    emit,
    json_option,
    open_robot,
    out_option,
    part_option,
    robot_argument,
    table,
)

if TYPE_CHECKING:
    from skinmap.arrays import FloatArray
    from skinmap.flat.flat_map import Chart, FlatMap


MOST_GEODESIC = 20_000  # vertices: exact geodesics of more take minutes
MESHES = (".stl", ".obj", ".ply", ".off", ".dae", ".glb")


@click.command("flatten")
@robot_argument
@part_option
@click.option("--method", default="balanced", show_default=True, help="Flattening method.")
@out_option
@json_option
def command(
    robot: str, parts: tuple[str, ...], method: str, out: Path | None, as_json: bool
) -> None:
    """Lay every patch of a robot's skin, or any triangle mesh, flat and measure the distortion.

    ROBOT is a built-in name (default: icub), the path of a manifest, or a mesh file.

    \b
    Example:  skinmap flatten icub --part torso --method bff --out maps
    """
    from skinmap.flat.flat_map import flatten
    from skinmap.flat.methods import flatteners
    from skinmap.surface.surface_mesh import build_surface

    flatteners.get(method)
    if Path(robot).suffix.lower() in MESHES:
        _flatten_file(Path(robot), method, as_json)
        return
    loaded, names = open_robot(robot, parts)
    maps = {name: flatten(build_surface(loaded.skin(name)), method=method) for name in names}
    rows = [
        patch_row(name, chart, flat.mesh.vertices[chart.taxels])
        for name, flat in maps.items()
        for chart in flat.charts
    ]
    files = write_maps(maps, out) if out is not None else []
    if as_json:
        seconds = sum(row["seconds"] for row in rows)
        emit({"robot": loaded.name, "patches": rows, "seconds": seconds, "files": files})
        return
    _print(rows)
    for file in files:
        click.echo(str(Path(out or ".") / file))


def _flatten_file(path: Path, method: str, as_json: bool) -> None:
    from skinmap.errors import MissingFileError
    from skinmap.flat.geodesic import geodesic_stress
    from skinmap.flat.mesh_charts import flatten_mesh
    from skinmap.io.urdf import read_mesh

    if not path.is_file():
        raise MissingFileError(path, "a mesh file")
    vertices, faces = read_mesh(path)
    charts = flatten_mesh(vertices, faces, method=method)
    rows = [
        {
            "part": path.name,
            "patch": number,
            "vertices": len(chart.vertices),
            "faces": len(chart.faces),
            "holes": chart.holes,
            "cut_mm": 1e3 * chart.seam_length,
            "method": chart.method,
            "fallback": chart.fallback,
            **chart.distortion.summary(),
            "geodesic_stress": geodesic_stress(vertices[chart.vertices], chart.faces, chart.uv)
            if len(chart.vertices) <= MOST_GEODESIC
            else None,
            "seconds": chart.seconds,
        }
        for number, chart in enumerate(charts)
    ]
    if as_json:
        seconds = sum(chart.seconds for chart in charts)
        emit({"robot": path.name, "patches": rows, "seconds": seconds, "files": []})
    else:
        _print(rows)


def _print(rows: list[dict[str, Any]]) -> None:
    table(
        ["part", "patch", "vertices", "holes", "method", "flips", "edge rms %", "area sd", "angle"],
        [
            [
                row["part"],
                row["patch"],
                row["vertices"],
                row["holes"],
                row["method"],
                row["flips"],
                row["edge_rms_percent"],
                row["area_sd"],
                row["quasi_conformal"]["mean"],
            ]
            for row in rows
        ],
    )


def patch_row(part: str, chart: Chart, vertices: FloatArray) -> dict[str, Any]:
    """The numbers of one chart with vertices (k, 3) [m], ready for JSON."""
    from skinmap.flat.geodesic import geodesic_stress

    return {
        "part": part,
        "patch": chart.patch,
        "vertices": len(chart.taxels),
        "faces": len(chart.faces),
        "holes": chart.holes,
        "cut_mm": 1e3 * chart.seam_length,
        "method": chart.method,
        "fallback": chart.fallback,
        **chart.distortion.summary(),
        "geodesic_stress": geodesic_stress(vertices, chart.faces, chart.uv),
        "seconds": chart.seconds,
    }


def write_maps(maps: dict[str, FlatMap], out: Path) -> list[str]:
    """One picture a part; returns the names written."""
    from skinmap.cli.figures import flat_map_figure
    from skinmap.io.output import staged_folder

    with staged_folder(out) as stage:
        for name, flat in maps.items():
            flat_map_figure(flat, stage / f"{name}.png")
    return [f"{name}.png" for name in maps]

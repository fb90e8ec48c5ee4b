"""`skinmap flatten`: flat maps of the skin and what they distort."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.commands.options import (
    json_option,
    open_robot,
    outside_option,
    part_option,
    seed_option,
)
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress
from skinmap.commands.workers import worker_options, workers_options
from skinmap.report.present import emit
from skinmap.report.table import table

if TYPE_CHECKING:
    from skinmap.cli.flatten.job import FlatJob

MESHES = (".stl", ".obj", ".ply", ".off", ".dae", ".glb", ".gltf", ".3mf")
SEAM_HELP = "Channels that seams keep away from, as 3,8,20-31; may be repeated."
COMPARE_HELP = "Methods to compare with, and `drawing` for a hand-drawn map: bff,slim,drawing."


@click.command("flatten")
@click.argument("robots", nargs=-1, metavar="[ROBOT|MESH...]")
@outside_option
@part_option
@click.option("--method", help="Flattening method; balanced, or auto where a budget is given.")
@click.option("--max-seconds", type=float, help="CPU time for the maps of a part [s], for auto.")
@click.option("--max-edge-rms", type=float, help="Edge error to reach [%], for auto.")
@click.option("--meshing", default="consensus", show_default=True, help="Surface meshing method.")
@click.option("--iterations", type=int, help="Of arap, balanced, slim or dirichlet.")
@click.option(
    "--precision",
    default="float64",
    show_default=True,
    help="Of the sparse solves: float64, or float32 for half the memory.",
)
@click.option("--compare", default="", metavar="M2,M3|drawing", help=COMPARE_HELP)
@click.option(
    "--drawing", type=click.Path(path_type=Path), help="Drawing (iCubSkinGui .ini) of the part."
)
@click.option("--metric", default="edge_strain", show_default=True, help="What colours the maps.")
@click.option("--seam-away", multiple=True, metavar="CHANNELS", help=SEAM_HELP)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for pictures, OBJ and VTP with texture coordinates, and report.html.",
)
@workers_options
@seed_option
@profile_option("flatten")
@json_option
def command(robots: tuple[str, ...], out: Path | None, as_json: bool, **options: Any) -> None:
    """Lay every patch of a robot's skin, or any triangle mesh, flat and measure the distortion.

    ROBOT is a built-in name (default: icub), the path of a manifest, or a mesh file (OBJ, STL,
    PLY, OFF, ...), or several mesh files.
    Methods are tutte, harmonic, lscm, bff, arap, slim, dirichlet, or by
    price fast, balanced, accurate, auto; meshing is consensus, fast or accurate. Triangles are
    coloured by edge_strain, area, quasi_conformal, symmetric_dirichlet, stretch_l2 or arap_energy.

    \b
    Example:  skinmap flatten icub --part torso --out maps
              skinmap flatten icub --part left_arm --compare bff,lscm --json
              skinmap flatten bunny.obj --method accurate --json
              skinmap flatten scans/*.stl --jobs 4 --resume scans.resume --json
    """
    from skinmap.cli.flatten.job import run_job

    spread = worker_options(options)
    job = _job(robots or ("icub",), **options)
    title = "flatten"
    with spread.open(title) as workers, progress(len(job.surfaces), title) as advance:
        result, maps, others, drawn = run_job(job, workers=workers, progress=advance)
    files: list[str] = []
    if out is not None:
        from skinmap.cli.flatten.files import write_all

        with progress(len(maps), "drawing") as advance:
            files = write_all(result, maps, others, drawn, job.metric, out, advance)
    if as_json:
        emit({**result, "files": files})
        return
    _print(result)
    for file in files:
        click.echo(str(Path(out or ".") / file))


def _job(
    robots: tuple[str, ...],
    *,
    parts: tuple[str, ...],
    method: str | None,
    max_seconds: float | None,
    max_edge_rms: float | None,
    meshing: str,
    iterations: int | None,
    precision: str,
    compare: str,
    drawing: Path | None,
    metric: str,
    seam_away: tuple[str, ...],
    seed: int,
) -> FlatJob:
    """What was asked for, every name and number checked before any work is done."""
    from skinmap.cli.flatten.job import (
        FlatJob,
        check_budget,
        check_compare,
        check_meshing,
        read_channels,
    )
    from skinmap.errors import UnknownNameError
    from skinmap.flat.face_metrics import face_metric
    from skinmap.flat.flat_map import DEFAULT
    from skinmap.flat.methods import check_effort, flatteners

    budgets = max_seconds is not None or max_edge_rms is not None
    method = method or ("auto" if budgets else DEFAULT)
    flatteners.get(method)
    check_meshing(meshing)
    check_effort(method, iterations, precision)
    others, with_drawing = check_compare(compare)
    job = FlatJob(
        name=robots[0],
        method=method,
        metric_name=metric,
        metric=face_metric(metric),
        others=others,
        drawing=drawing,
        with_drawing=with_drawing or drawing is not None,
        away=read_channels(seam_away),
        budgets=check_budget(method, max_seconds, max_edge_rms),
        meshing=meshing,
        seed=seed,
        iterations=iterations,
        precision=precision,
    )
    paths = [Path(robot) for robot in robots]
    if all(path.suffix.lower() in MESHES for path in paths):
        if parts:
            raise UnknownNameError("part", parts[0], ())
        return job.for_meshes(list(dict.fromkeys(paths)))
    if len(robots) > 1:
        raise click.UsageError("several mesh files, or one robot: not " + " ".join(robots)[:200])
    loaded, names = open_robot(robots[0], parts)
    return job.for_robot(loaded, names)


def _print(result: dict[str, Any]) -> None:
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
            for row in result["patches"]
        ],
    )
    if result["compare"]:
        table(
            ["part", "patch", "compared with", "flips", "edge rms %", "area sd"],
            [
                [row["part"], row["patch"], row["with"]]
                + ["-" if row[key] is None else row[key] for key in
                   ("flips", "edge_rms_percent", "area_sd")]
                for row in result["compare"]
            ],
        )  # fmt: skip

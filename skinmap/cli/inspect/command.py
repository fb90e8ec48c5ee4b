"""`skinmap inspect`: what a robot's skin is made of, and whether it fits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from skinmap.commands.options import json_option, open_robot, part_option, robot_argument
from skinmap.commands.profiles import profile_option
from skinmap.report.present import emit
from skinmap.report.table import table

TABLES = (".txt", ".csv")


@click.command("inspect")
@robot_argument
@part_option
@click.option("--module", help="Module layout of a bare table (triangle_10pad, a .toml, a .csv).")
@click.option("--fit", is_flag=True, help="Fit each part rigidly to its link, and report.")
@click.option("--skip", "skipped", multiple=True, help="Repair step to leave out; may be repeated.")
@click.option(
    "--html", type=click.Path(path_type=Path, dir_okay=False), help="Report with pictures."
)
@profile_option()
@json_option
def command(
    robot: str,
    parts: tuple[str, ...],
    module: str | None,
    fit: bool,
    skipped: tuple[str, ...],
    html: Path | None,
    as_json: bool,
) -> None:
    """Show the parts of a robot: taxels, repairs, distance to the body, pitch, modules, verdict.

    ROBOT is a built-in name (default: icub), the path of a manifest, or a bare taxel table.
    Repair steps are units, thermal, collapsed and normals.

    \b
    Example:  skinmap inspect icub --part right_forearm --json
    """
    from skinmap.cli.inspect.inspection import inspect_part, inspect_table, repair_steps

    steps = repair_steps(skipped)
    if Path(robot).suffix.lower() in TABLES:
        rows = [inspect_table(Path(robot), module, steps)]
        name, loaded = Path(robot).name, None
    else:
        loaded, names = open_robot(robot, parts)
        loaded.steps = steps
        rows = [inspect_part(loaded, name, fit=fit) for name in names]
        name = loaded.name
    if html is not None:
        from skinmap.cli.inspect.report import write_inspection
        from skinmap.io.output import staged_file

        with staged_file(html) as stage:
            write_inspection(name, rows, loaded, stage)
    if as_json:
        files = [] if html is None else [html]
        taxels = sum(row["taxels"] for row in rows)
        emit({"robot": name, "parts": rows, "taxels": taxels, "files": files})
        return
    _print(rows)


def _print(rows: list[dict[str, Any]]) -> None:
    columns = ["part", "link", "taxels", "modules", "distance mm", "max", "pitch mm"]
    table(
        [*columns, "rebuilt", "inward", "covered", "verdict"],
        [
            [
                row["name"],
                row["link"],
                row["taxels"],
                row["modules"],
                row["distance_mm"]["median"] if row["distance_mm"] else "-",
                row["distance_mm"]["max"] if row["distance_mm"] else "-",
                row["pitch_mm"]["median"],
                row["rebuilt"],
                row.get("inward", "-"),
                row.get("covered", "-"),
                row["verdict"],
            ]
            for row in rows
        ],
    )
    for row in rows:
        for warning in row["warnings"]:
            click.echo(f"{row['name']}: {warning}")
        if "fit" in row:
            fit = row["fit"]
            click.echo(
                f"{row['name']}: mean distance {fit['mean_before_mm']:.2f} mm, "
                f"{fit['mean_after_mm']:.2f} mm after {fit['shift_mm']:.1f} mm and "
                f"{fit['angle_deg']:.1f} deg"
            )

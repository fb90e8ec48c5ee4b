"""`skinmap inspect`: what a robot's skin is made of, and whether it fits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
from msgspec import UnsetType

from skinmap.cli.inspect.result import InspectResult
from skinmap.commands.options import PAGE, open_robot, outside_option, part_option, prints
from skinmap.commands.profiles import profile_option
from skinmap.report.present import present
from skinmap.report.result import given
from skinmap.report.table import Cell, Table

TABLES = (".txt", ".csv", ".json")


@click.command("inspect")
@click.argument("robots", nargs=-1, metavar="[ROBOT|TABLE...]")
@outside_option
@part_option
@click.option(
    "--module",
    metavar="LAYOUT",
    help="Module layout of a bare table (triangle_10pad, a .toml, a .csv).",
)
@click.option("--fit", is_flag=True, help="Fit each part rigidly to its link, and report.")
@click.option(
    "--skip",
    "skipped",
    metavar="STEP",
    multiple=True,
    help="Repair step to leave out; may be repeated.",
)
@click.option("--html", type=PAGE, help="Report with pictures.")
@profile_option()
@prints(InspectResult)
def command(
    robots: tuple[str, ...],
    parts: tuple[str, ...],
    module: str | None,
    fit: bool,
    skipped: tuple[str, ...],
    html: Path | None,
    as_json: bool,
) -> None:
    """Show the parts of a robot: taxels, repairs, distance to the body, pitch, modules, verdict.

    ROBOT is a built-in name (default: icub), the path of a manifest, or one or several bare taxel
    tables; of CySkin files (.json) every fault is named, those that they have together too.
    Repair steps are units, thermal, collapsed and normals.

    \b
    Example:  skinmap inspect icub --part right_forearm --json
              skinmap inspect ur10e-cyskin
    """
    result = work(robots or ("icub",), parts, module, fit, skipped, html)
    present(result, _lines, as_json=as_json)


def work(
    robots: tuple[str, ...],
    parts: tuple[str, ...],
    module: str | None,
    fit: bool,
    skipped: tuple[str, ...],
    html: Path | None,
) -> InspectResult:
    """Measure all parts, and write the page if one was asked for."""
    from skinmap.cli.inspect.inspection import (
        file_faults_of,
        inspect_part,
        inspect_table,
        repair_steps,
        write_inspection,
    )
    from skinmap.io.output import staged_file

    steps = repair_steps(skipped)
    tables = list(dict.fromkeys(Path(robot) for robot in robots))
    if all(path.suffix.lower() in TABLES for path in tables):
        if parts:
            raise click.UsageError(f"--part is for a robot; {robots[0]} is a bare table")
        if fit:
            raise click.UsageError(f"--fit is for a robot; {robots[0]} is a bare table")
        faults = file_faults_of(tables)
        rows = [inspect_table(path, module, steps, faults.get(path, ())) for path in tables]
        name, loaded = ", ".join(path.name for path in tables), None
    elif len(robots) > 1:
        raise click.UsageError("several tables, or one robot: not " + " ".join(robots)[:200])
    elif module is not None:
        raise click.UsageError(f"--module is for bare tables; {robots[0]} is a robot")
    else:
        loaded, names = open_robot(robots[0], parts)
        loaded.steps = steps
        rows = [inspect_part(loaded, name, fit=fit) for name in names]
        name = loaded.name
    taxels = sum(row.taxels for row in rows)
    files = [] if html is None else [str(html)]
    result = InspectResult(robot=name, parts=rows, taxels=taxels, files=files)
    if html is not None:
        with staged_file(html) as stage:
            write_inspection(result, loaded, stage)
    return result


def _lines(result: InspectResult) -> Iterator[str | Table]:
    columns = ["part", "link", "taxels", "modules", "distance mm", "max", "pitch mm"]
    rows: list[list[Cell]] = [
        [
            row.name, row.link, row.taxels, row.modules,
            None if row.distance_mm is None else row.distance_mm.median,
            None if row.distance_mm is None else row.distance_mm.max,
            row.pitch_mm.median, row.rebuilt, given(row.inward), given(row.covered), row.verdict,
        ]
        for row in result.parts
    ]  # fmt: skip
    yield Table([*columns, "rebuilt", "inward", "covered", "verdict"], rows)
    for row in result.parts:
        yield from (f"{row.name}: {warning}" for warning in row.warnings)
        if not isinstance(row.fit, UnsetType):
            yield (
                f"{row.name}: mean distance {row.fit.mean_before_mm:.2f} mm, "
                f"{row.fit.mean_after_mm:.2f} mm after {row.fit.shift_mm:.1f} mm and "
                f"{row.fit.angle_deg:.1f} deg"
            )

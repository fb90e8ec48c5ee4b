"""`skinmap inspect`: what a robot's skin is made of, and whether it fits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from skinmap.cli.inspect.inspect_result import InspectResult, PartRow
from skinmap.commands.options import open_robot, part_option, prints, word, words
from skinmap.report.present import present
from skinmap.report.result import given
from skinmap.report.table import Table

TABLES = (".txt", ".csv", ".json")


@click.command("inspect")
@click.argument("robots", nargs=-1, metavar="[ROBOT|TABLE...]")
@part_option
@word("--module", "LAYOUT", "Module layout of a bare table (triangle_10pad, a .toml, a .csv).")
@words("--skip", "skipped", "STEP", "Repair step to leave out; may be repeated.")
@prints(InspectResult)
def command(robots: tuple[str, ...], as_json: bool, **asked: Any) -> None:
    """Show the parts of a robot: taxels, repairs, distance to the body, pitch, modules, verdict.

    ROBOT is a built-in name (default: icub), the path of a manifest, or one or several bare taxel
    tables; of CySkin files (.json) every fault is named, those that they have together too.
    Repair steps are units, thermal, collapsed and normals.

    \b
    Example:  skinmap inspect icub --part right_forearm --json
              skinmap inspect ur10e-cyskin
    """
    names = robots or ("icub",)
    result = work(names, **asked)
    present(result, lambda one: [*_lines(one), _next(one, names)], as_json=as_json)


def work(
    robots: tuple[str, ...], parts: tuple[str, ...], module: str | None, skipped: tuple[str, ...]
) -> InspectResult:
    """Measure all parts."""
    from skinmap.cli.inspect.inspection import (
        file_faults_of,
        inspect_part,
        inspect_table,
        repair_steps,
    )

    steps = repair_steps(skipped)
    tables = list(dict.fromkeys(Path(robot) for robot in robots))
    if all(path.suffix.lower() in TABLES for path in tables):
        if parts:
            raise click.UsageError(f"--part is for a robot; {robots[0]} is a bare table")
        faults = file_faults_of(tables)
        rows = [inspect_table(path, module, steps, faults.get(path, ())) for path in tables]
        name = ", ".join(path.name for path in tables)
    elif len(robots) > 1:
        raise click.UsageError("several tables, or one robot: not " + " ".join(robots)[:200])
    elif module is not None:
        raise click.UsageError(f"--module is for bare tables; {robots[0]} is a robot")
    else:
        loaded, names = open_robot(robots[0], parts)
        loaded.steps = steps
        rows = [inspect_part(loaded, name) for name in names]
        name = loaded.name
    taxels = sum(row.taxels for row in rows)
    return InspectResult(robot=name, parts=rows, taxels=taxels)


def _lines(result: InspectResult) -> Iterator[str | Table]:
    shown = (
        "name=part link taxels modules distance_mm.median=distance_mm distance_mm.max "
        "pitch_mm.median=pitch_mm rebuilt inward covered verdict"
    )
    yield Table.of(PartRow, result.parts, shown)
    if any(row.rebuilt or given(row.inward) or given(row.covered) for row in result.parts):
        yield "rebuilt: set apart from one place; inward: normals into the body; covered: below it"
    for row in result.parts:
        yield from (f"{row.name}: {warning}" for warning in row.warnings)


def _next(result: InspectResult, names: Sequence[str]) -> str:
    """The verdict in one line, and the command that goes on from there."""
    odd: dict[str, list[str]] = {}
    for row in result.parts:
        if row.verdict != "ok":
            odd.setdefault(row.verdict, []).append(row.name)
    found = "; ".join(f"{verdict} ({', '.join(parts)})" for verdict, parts in odd.items())
    told = f"verdict: {found or 'ok'}"
    if Path(names[0]).suffix.lower() in TABLES:
        return f"{told}; next: skinmap new ROBOT.urdf --taxels {' '.join(names)} -o robot.toml"
    if odd:
        part = next(iter(odd.values()))[0]
        return f"{told}; next: skinmap view {names[0]} --part {part}"
    return f"{told}; next: skinmap flatten {names[0]} --out maps"

"""`skinmap checkup`: a minute of touches, and the cable, board or taxel that is at fault."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

import click

from calibration.wiring.findings import CheckupResult, findings, lines, with_changes
from skinmap.commands.options import open_robot, out_file, part_option, prints, robot_option
from skinmap.commands.overwriting import protect
from skinmap.report.present import present
from skinmap.report.result import OK, Verdict

if TYPE_CHECKING:
    from calibration.wiring.examination import Examination, Marker
    from skinmap.live.sources.source import Source
    from skinmap.skin.robot import Robot

MARKERS = "skinmap.checkup_markers"  # entry points of what shows the next place on the body
PAGE = "checkup.pdf"
SIMULATED = "benchmarks.calibration.person"


@click.command("checkup", short_help="Is this skin sound? A minute of touches, and a page.")
@click.argument("source")
@robot_option
@part_option
@click.option(
    "--places",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Where a recording's touches were asked for [m]: CSV `touch,x,y,z`.",
)
@click.option("--plant", multiple=True, metavar="FAULT",
              help="Fault of SOURCE sim: swap:3,7, mute:4, turn:5,120, weak:88,40 ...; may be "
                   "repeated.")  # fmt: skip
@click.option(
    "--history",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder that keeps this check-up, and compares it with those before.",
)
@out_file("Page (.pdf), corrected map (.csv), or a folder for both.", folder=True, guarded=False)
@click.option("--web", is_flag=True, help="Show the next place on the body, in a browser.")
@prints(CheckupResult)
def checkup(
    source: str,
    robot: str | None,
    parts: tuple[str, ...],
    places: Path | None,
    plant: tuple[str, ...],
    history: Path | None,
    output: Path | None,
    web: bool,
    as_json: bool,
) -> None:
    """Check a skin: five seconds at rest, then the strokes and pokes that tell most.

    SOURCE is lsl:NAME, zmq:HOST:PORT, a plug-in's name, a recording's file, or sim. Finds swapped,
    turned, mirrored and mute modules, cables, and dead, noisy or stuck taxels. Exit code 3:
    the answers do not fit the places.

    \b
    Example:  skinmap checkup lsl:skin --part right_forearm --history checkups -o today.pdf
    """
    from calibration.wiring.examination import Plan, examine_live, examine_recording
    from calibration.wiring.history import earlier_checkups, keep_checkup

    loaded, names = open_robot(robot, parts)
    simulated, recorded = source == "sim", source != "sim" and _is_file(source)
    if simulated and not parts:
        names = parts = names[:1]
    if places is not None and not recorded:
        raise click.UsageError("--places belongs to a recording: SOURCE is not a file")
    if plant and not simulated:
        raise click.UsageError("--plant belongs to the simulated skin: SOURCE is not sim")
    if simulated and len(parts) > 1:
        raise click.UsageError("sim has one part: give one --part")
    if output is not None:
        _protect(output, names)
    before = [] if history is None else earlier_checkups(history)
    told = partial(click.echo, err=as_json)
    markers: list[Marker] = []
    plan = Plan(told=told, markers=markers, covers=history is not None)
    with ExitStack() as opened:
        if not recorded:
            live = opened.enter_context(closing(_opened(source, loaded, parts, plant, len(before))))
        if web:
            markers.append(opened.enter_context(closing(_marker(loaded, names, told))))
        if simulated:
            markers.append(live)  # type: ignore[arg-type]  # a person, who touches where it is shown
        if recorded:
            examined = examine_recording(Path(source), loaded, parts, plan, places=places)
        else:
            examined = examine_live(live, loaded, parts, plan)
    when = examined.recorded or datetime.now(UTC)
    result = findings(examined)
    if history is not None:
        kept = keep_checkup(history, before, examined, result, when)
        result = with_changes(result, examined.cases, kept)
    if output is not None:
        written = list(_written(output, result, examined, loaded, when))
        nowhere = [] if written else ["no map was written: no channel is known to be elsewhere"]
        result = replace(result, files=[*written, *result.files], notes=[*result.notes, *nowhere])
    bad = result.status == "inconsistent"
    present(result, lines, as_json=as_json, verdict=Verdict(result.status if bad else OK))


def _protect(output: Path, parts: tuple[str, ...]) -> None:
    """Refuse files that are there before any work is done."""
    from calibration.wiring.boards import map_files

    suffix = output.suffix.lower()
    if suffix not in ("", ".csv", ".pdf"):
        raise click.UsageError(f"-o takes a .pdf, a .csv or a folder, not {output.suffix!r}")
    # Of the parts that one table is for the source decides.
    for one in [output] if suffix else map_files(parts, output).values():
        protect(one, data=suffix != ".pdf")
    if not suffix:
        protect(output / PAGE)


def _opened(
    source: str, robot: Robot, parts: tuple[str, ...], plant: tuple[str, ...], seed: int
) -> Source:
    """The live source, or the simulated person of the benchmarks."""
    from skinmap.live.sources.open_source import open_source

    if source != "sim":
        return open_source(source, robot=robot, parts=parts or None)
    import sys

    clone = str(Path(__file__).resolve().parents[2])
    if clone not in sys.path:
        sys.path.append(clone)  # benchmarks are not installed
    try:
        simulated: Source = import_module(SIMULATED).SimulatedSkin(robot, parts[0], plant, seed)
    except ModuleNotFoundError:
        raise click.UsageError(
            "sim needs the simulated person in benchmarks/, which is in a clone of the repository"
        ) from None
    return simulated


def _written(
    output: Path, result: CheckupResult, examined: Examination, robot: Robot, when: datetime
) -> Iterator[str]:
    """Write the page and the corrected maps; the files' names."""
    from calibration.wiring.boards import corrected, map_files
    from calibration.wiring.history import write_page
    from skinmap.io.output import staged_file
    from skinmap.io.taxels.taxel_table import write_csv

    suffix = output.suffix.lower()
    if not suffix:
        output.mkdir(parents=True, exist_ok=True)
    if suffix != ".csv":
        page = output if suffix else output / PAGE
        with staged_file(page) as stage:
            write_page(stage, result, examined.cases, robot, f"{when:%d %B %Y, %H:%M} UTC")
        yield str(page)
    if suffix == ".pdf":
        return
    files = map_files([case.part for case in examined.cases], output)
    for case in examined.cases:
        table, moved = corrected(case.boards, case.doctor.wiring)
        if len(moved) and case.doctor.status != "inconsistent":
            with staged_file(files[case.part]) as stage:
                write_csv(table, stage)
            yield str(files[case.part])


def _is_file(source: str) -> bool:
    from skinmap.errors import MissingFileError
    from skinmap.live.sources.open_source import FILES, sources

    kind, _, _ = source.partition(":")
    if kind in sources.names():
        if kind == "sim":
            raise click.UsageError("the simulated skin of a check-up is `sim` alone, with --part")
        return False
    path = Path(source)
    if not path.exists() and (path.suffix.lower() in FILES or path.name != source):
        raise MissingFileError(path, "a recording")
    return path.exists()


def _marker(robot: Robot, parts: tuple[str, ...], told: object) -> Marker:
    found = list(entry_points(group=MARKERS, name="web"))
    if not found:
        raise click.UsageError("--web needs the viewer, which is not installed")
    marker: Marker = found[0].load()(robot, parts, told)
    return marker

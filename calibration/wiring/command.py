"""`skinmap wiring`: where to touch next, and which cable is in the wrong socket."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

import click

from calibration.wiring.findings import WiringResult, findings, lines
from skinmap.commands.options import (
    open_robot,
    out_file,
    part_option,
    prints,
    robot_option,
    units_option,
)
from skinmap.commands.overwriting import protect
from skinmap.commands.retired import NO_PROFILE, retired
from skinmap.report.present import present
from skinmap.report.result import OK, Verdict

if TYPE_CHECKING:
    from calibration.wiring.examination import Examination, Marker, Plan
    from skinmap.skin.robot import Robot

MARKERS = "skinmap.wiring_markers"  # entry points of what shows the next place on the body


@click.command("wiring", short_help="Touch where it says: swapped, turned and mute modules.")
@click.argument("source")
@robot_option
@part_option
@click.option(
    "--touch", "how", type=click.Choice(["poke", "stroke"]), default="poke",
    show_default=True, help="How the skin is touched.",
)  # fmt: skip
@click.option("--places", type=click.Path(path_type=Path, dir_okay=False),
              help="Where a recording's touches were asked for: CSV `touch,x,y,z`.")  # fmt: skip
@units_option("--places")
@out_file("Corrected map: a new .csv, or a folder for several parts.", folder=True, guarded=False)
@click.option("--web", is_flag=True, help="Show the next place on the body, in a browser.")
@retired(
    plant="faults are planted by benchmarks/calibration/wiring.py alone",
    chain="a chain has 16 modules",
    patience="a live touch is waited for 30 s",
    seed="nothing is random",
    max_touches="it asks for 30 at most; Ctrl-C ends it and judges by those until then",
    profile=NO_PROFILE,
)
@prints(WiringResult)
def wiring(
    source: str,
    robot: str | None,
    parts: tuple[str, ...],
    how: str,
    places: Path | None,
    units: str,
    output: Path | None,
    web: bool,
    as_json: bool,
) -> None:
    """Find swapped cables and modules, turned, mirrored and mute ones, by touching the skin.

    SOURCE is a recording's file, lsl:NAME, zmq:HOST:PORT or a plug-in's name. Names the next
    place to touch, and writes a corrected map with -o. Exit code 3: the answers do not fit the
    places.

    \b
    Example:  skinmap wiring lsl:skin --part right_forearm -o corrected.csv
    """
    from calibration.wiring.channel_map import map_files
    from calibration.wiring.examination import Plan
    from skinmap.io.units import UNITS

    loaded, names = open_robot(robot, parts)
    recorded = _is_file(source)
    if places is not None and not recorded:
        raise click.UsageError("--places belongs to a recording: SOURCE is not a file")
    if output is not None:
        # Of the parts that one table is for the source decides.
        table = output.suffix.lower() == ".csv"
        for file in [output] if table else map_files(names, output).values():
            protect(file, data=True)

    def told(line: str) -> None:
        click.echo(line, err=as_json)

    started = time.process_time()
    marker = _marker(loaded, names, told) if web else None
    plan = Plan(how=how, told=told, marker=marker)
    try:
        if recorded:
            from calibration.wiring.examination import examine_recording

            examined = examine_recording(
                Path(source), loaded, parts, plan, places=places, unit=UNITS[units]
            )
        else:
            examined = _live(source, loaded, parts, plan)
    finally:
        if marker is not None:
            marker.close()
    result = findings(examined, output)
    result = replace(result, seconds=time.process_time() - started)
    bad = result.status == "inconsistent"
    present(result, lines, as_json=as_json, verdict=Verdict(result.status if bad else OK))


def _live(source: str, robot: Robot, parts: tuple[str, ...], plan: Plan) -> Examination:
    from calibration.wiring.examination import examine_live
    from skinmap.live.sources.open_source import open_source

    opened = open_source(source, robot=robot, parts=parts or None)
    try:
        return examine_live(opened, robot, parts, plan)
    finally:
        opened.close()


def _is_file(source: str) -> bool:
    from skinmap.errors import MissingFileError
    from skinmap.live.sources.open_source import FILES, sources

    if source.partition(":")[0] == "sim":
        raise click.UsageError("a simulated skin does not answer where it is asked to be touched")
    if source.partition(":")[0] in sources.names():
        return False
    path = Path(source)
    if not path.exists() and (path.suffix.lower() in FILES or path.name != source):
        raise MissingFileError(path, "a recording")
    return path.exists()


def _marker(robot: Robot, parts: tuple[str, ...], told: Callable[[str], None]) -> Marker:
    found = list(entry_points(group=MARKERS, name="web"))
    if not found:
        raise click.UsageError("--web needs the viewer, which is not installed")
    marker: Marker = found[0].load()(robot, parts, told)
    return marker

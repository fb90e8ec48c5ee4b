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
    MAX_SECONDS,
    Number,
    open_robot,
    part_option,
    prints,
    robot_option,
    seed_option,
    units_option,
)
from skinmap.commands.profiles import profile_option
from skinmap.report.present import present
from skinmap.report.verdict import OK, Verdict

if TYPE_CHECKING:
    from calibration.wiring.examination import Examination, Marker, Plan
    from skinmap.skin.robot import Robot

MARKERS = "skinmap.wiring_markers"  # entry points of what shows the next place on the body
USUAL_TOUCHES = 30


@click.command("wiring", short_help="Touch where it says: swapped, turned and mute modules.")
@click.argument("source", default="sim")
@robot_option
@part_option
@click.option(
    "--touch", "how", type=click.Choice(["poke", "stroke", "hand"]), default="poke",
    show_default=True, help="How the skin is touched.",
)  # fmt: skip
@click.option("--max-touches", type=click.IntRange(1, 10_000), default=USUAL_TOUCHES,
              show_default=True, help="Ask for so many at most.")  # fmt: skip
@click.option("--places", type=click.Path(path_type=Path, dir_okay=False),
              help="Where a recording's touches were asked for: CSV `touch,x,y,z`.")  # fmt: skip
@units_option("--places")
@click.option("--plant", "planted", multiple=True, metavar="FAULT",
              help="Of `sim`: swap:3,7 turn:5,120 mirror:5 mute:4 chains:0,1 reverse:0 "
              "mute-chain:1 channels:24,25; may be repeated.")  # fmt: skip
@click.option("--chain", type=click.IntRange(1, 10_000), default=16, show_default=True,
              help="Modules on one connector.")  # fmt: skip
@click.option("--patience", type=Number(1.0, MAX_SECONDS), default=30.0, show_default=True,
              help="Seconds that a live touch is waited for.")  # fmt: skip
@click.option("-o", "--out", type=click.Path(path_type=Path), metavar="FILE|FOLDER",
              help="Corrected map: a new .csv, or a folder for several parts.")  # fmt: skip
@click.option("--web", is_flag=True, help="Show the next place on the body, in a browser.")
@seed_option
@profile_option()
@prints(WiringResult)
def wiring(
    source: str,
    robot: str | None,
    parts: tuple[str, ...],
    how: str,
    max_touches: int,
    places: Path | None,
    units: str,
    planted: tuple[str, ...],
    chain: int,
    patience: float,
    out: Path | None,
    web: bool,
    seed: int,
    as_json: bool,
) -> None:
    """Find swapped cables and modules, turned, mirrored and mute ones, by touching the skin.

    SOURCE is sim (a simulated skin and person, with faults by --plant), a recording's file,
    lsl:NAME, zmq:HOST:PORT or a plug-in's name. Says where to touch next, and writes a corrected
    map with -o, never over another file. Exit code 3: the answers do not fit the places.

    \b
    Example:  skinmap wiring sim --part right_forearm --plant swap:3,7 -o corrected.csv
    """
    from calibration.wiring.channel_map import check_out
    from calibration.wiring.examination import Plan
    from skinmap.io.units import UNITS

    loaded, names = open_robot(robot, parts)
    _check(source, planted, places)
    if out is not None:
        check_out(names, out)

    def told(line: str) -> None:
        click.echo(line, err=as_json)

    started = time.process_time()
    marker = _marker(loaded, names, told) if web else None
    plan = Plan(how=how, most=max_touches, patience=patience, chain=chain, seed=seed, told=told,
                marker=marker)  # fmt: skip
    try:
        if source == "sim":
            from calibration.wiring.person import examine_simulated

            examined = examine_simulated(loaded, names, planted, plan)
        elif _is_file(source):
            from calibration.wiring.examination import examine_recording

            examined = examine_recording(
                Path(source), loaded, parts, plan, places=places, unit=UNITS[units]
            )
        else:
            examined = _live(source, loaded, parts, plan)
    finally:
        if marker is not None:
            marker.close()
    result = findings(examined, seed, out)
    result = replace(result, seconds=time.process_time() - started)
    bad = result.status == "inconsistent"
    present(result, lines, as_json=as_json, verdict=Verdict(result.status if bad else OK))


def _live(source: str, robot: Robot, parts: tuple[str, ...], plan: Plan) -> Examination:
    from calibration.wiring.person import examine_live
    from skinmap.live.sources.open_source import open_source

    opened = open_source(source, robot=robot, parts=parts or None, seed=plan.seed)
    try:
        return examine_live(opened, robot, parts, plan)
    finally:
        opened.close()


def _check(source: str, planted: tuple[str, ...], places: Path | None) -> None:
    simulated = source == "sim"
    recording = not simulated and _is_file(source)
    if planted and not simulated:
        raise click.UsageError("--plant puts faults into the simulated skin: SOURCE must be sim")
    if places is not None and not recording:
        raise click.UsageError("--places says where a recording was touched: SOURCE is no file")


def _is_file(source: str) -> bool:
    from skinmap.errors import MissingFileError
    from skinmap.live.sources.open_source import FILES, sources

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

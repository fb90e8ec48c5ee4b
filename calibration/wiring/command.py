"""`skinmap wiring`: where to touch next, and which cable is in the wrong socket."""

from __future__ import annotations

import time
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.commands.options import json_option, open_robot, part_option, robot_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.report.present import emit

if TYPE_CHECKING:
    from calibration.wiring.job import Examination, Marker
    from skinmap.skin.robot import Robot

MARKERS = "skinmap.wiring_markers"  # entry points of what shows the next place on the body
MOST = 30
WORDS = {
    "healthy": "the wiring is as the map has it",
    "faulty": "the wiring is not as the map has it",
    "undecided": "not certain yet: touch more",
    "inconsistent": "the answers do not come from where the touches were asked for: the places "
    "belong to another part, order or unit, or more is wrong than one thing at a time",
}
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}


@click.command("wiring", short_help="Touch where it says: swapped, turned and mute modules.")
@click.argument("source", default="sim")
@robot_option
@part_option
@click.option(
    "--touch", "how", type=click.Choice(["poke", "stroke", "hand"]), default="poke",
    show_default=True, help="How the skin is touched.",
)  # fmt: skip
@click.option("--max-touches", type=click.IntRange(min=1), default=MOST, show_default=True,
              help="Ask for so many at most.")  # fmt: skip
@click.option("--places", type=click.Path(path_type=Path, dir_okay=False),
              help="Where a recording's touches were asked for: CSV `touch,x,y,z`.")  # fmt: skip
@click.option("--units", type=click.Choice(tuple(UNITS)), default="m", show_default=True,
              help="Of --places.")  # fmt: skip
@click.option("--plant", "planted", multiple=True, metavar="FAULT",
              help="Of `sim`: swap:3,7 turn:5,120 mirror:5 mute:4 chains:0,1 reverse:0 "
              "mute-chain:1 channels:24,25; may be repeated.")  # fmt: skip
@click.option("--chain", type=click.IntRange(min=1), default=16, show_default=True,
              help="Modules on one connector.")  # fmt: skip
@click.option("--patience", type=click.FloatRange(min=1.0), default=30.0, show_default=True,
              help="Seconds that a live touch is waited for.")  # fmt: skip
@click.option("-o", "--out", type=click.Path(path_type=Path),
              help="Corrected map: a new .csv, or a folder for several parts.")  # fmt: skip
@click.option("--web", is_flag=True, help="Show the next place on the body, in a browser.")
@seed_option
@profile_option()
@json_option
def wiring(
    source: str,
    robot: str,
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
    from calibration.wiring.job import check_out, summary, write_maps

    loaded, names = open_robot(robot, parts)
    simulated = source == "sim"
    recording = not simulated and _is_file(source)
    _check(simulated, recording, planted, places)
    if out is not None:
        check_out(names, out)

    def told(line: str) -> None:
        click.echo(line, err=as_json)

    started = time.process_time()
    marker = _marker(loaded, names, told) if web else None
    try:
        examined = _examine(
            source, loaded, parts, names, marker, told,
            how=how, most=max_touches, places=places, unit=UNITS[units], planted=planted,
            chain=chain, patience=patience, seed=seed,
        )  # fmt: skip
    finally:
        if marker is not None:
            marker.close()
    files = [] if out is None else write_maps(examined, out)
    result = summary(examined, seed, time.process_time() - started, files)
    if as_json:
        emit(result)
    else:
        for line in lines(result):
            click.echo(line)
    if result["status"] == "inconsistent":
        raise SystemExit(3)


def _check(simulated: bool, recording: bool, planted: tuple[str, ...], places: Path | None) -> None:
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


def _marker(robot: Robot, parts: tuple[str, ...], told: Any) -> Marker:
    found = list(entry_points(group=MARKERS, name="web"))
    if not found:
        raise click.UsageError("--web needs the viewer, which is not installed")
    marker: Marker = found[0].load()(robot, parts, told)
    return marker


def _examine(
    source: str,
    robot: Robot,
    parts: tuple[str, ...],
    names: tuple[str, ...],
    marker: Marker | None,
    told: Any,
    *,
    how: str,
    most: int,
    places: Path | None,
    unit: float,
    planted: tuple[str, ...],
    chain: int,
    patience: float,
    seed: int,
) -> Examination:
    from calibration.wiring import job

    if source == "sim":
        return job.examine_simulated(
            robot, names, planted, how=how, most=most, seed=seed, chain=chain, told=told,
            marker=marker,
        )  # fmt: skip
    if _is_file(source):
        return job.examine_recording(
            Path(source), robot, parts, how=how, places=places, unit=unit, chain=chain, told=told
        )
    from skinmap.live.sources.open_source import open_source

    opened = open_source(source, robot=robot, parts=parts or None, seed=seed)
    try:
        return job.examine_live(
            opened, robot, parts, how=how, most=most, patience=patience, chain=chain, told=told,
            marker=marker,
        )  # fmt: skip
    finally:
        opened.close()


def lines(result: dict[str, Any]) -> list[str]:
    """What people read at the end."""
    rows = [f"{result['status']}: {WORDS[result['status']]}"]
    for fault in result["faults"]:
        rows.append(f"  {fault['part']}: {fault['words']} ({100 * fault['confidence']:.1f} %)")
        rows += [f"    or {other['words']} ({100 * other['confidence']:.1f} %)"
                 for other in fault["alternatives"]]  # fmt: skip
    if result["status"] != "healthy":
        rows += [f"  perhaps {one['part']}: {one['words']} ({100 * one['confidence']:.1f} %)"
                 for one in result["suspects"]]  # fmt: skip
    for part, rest in result["rest"].items():
        rows += _rest_lines(part, rest)
    for part in result["parts"]:
        chance = f"nothing (else) wrong: {100 * part['healthy']:.1f} %"
        rows.append(f"  {part['part']}: {part['touches']} touches, {chance}")
        if part["mute_taxels"]:
            rows.append(f"    channels that never answered: {_some(part['mute_taxels'])}")
    rows += [f"  note: {note}" for note in result["notes"]]
    if result["next"] is not None and result["status"] in ("undecided", "faulty"):
        rows.append(f"  next: {result['next']['words']}")
    return [*rows, *result["files"]]


def _rest_lines(part: str, rest: dict[str, Any] | None) -> list[str]:
    if rest is None:
        return [f"  {part}: no rest was recorded, so it says nothing"]
    if not rest["tells"]:
        return [f"  {part}: at rest too few channels change to tell anything"]
    rows = []
    if rest["stuck"]:
        rows.append(f"  {part}: stuck channels: {_some(rest['stuck'])}")
    if rest["given_twice"]:
        pairs = [f"{a} = {b}" for a, b in rest["given_twice"]]
        rows.append(f"  {part}: given twice: {_some(pairs)}")
    return rows


def _some(values: list[Any]) -> str:
    words = ", ".join(map(str, values[:12]))
    return words + (f" and {len(values) - 12} more" if len(values) > 12 else "")

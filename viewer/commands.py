"""The viewer's commands; everything heavy is imported when they run."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from skinmap.commands.options import (
    MAX_SECONDS,
    PAGE,
    PICTURE,
    Number,
    Written,
    file_option,
    open_robot,
    out_folder,
    part_option,
    prints,
    response_option,
    seconds_option,
    seed_option,
    shown_argument,
    speed_option,
)
from skinmap.commands.progress import progress
from skinmap.report.present import present
from viewer.results import LAYERS, DemoResult, ViewFiles, ViewPage, ViewWindow

RECORDINGS = (".mcap", ".npz", ".xdf", ".log", ".db3")
MOST_COUNTED = 20_000_000  # bytes of a recording that touches are counted in unasked
ANYWHERE = "127.0.0.1:0"
PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("demo", short_help="The whole thread on the real iCub: start here.")
@out_folder("pictures, movie, report and numbers", default="skinmap-demo")
@part_option
@seed_option
@prints(DemoResult)
def demo(out: Path, parts: tuple[str, ...], seed: int, as_json: bool) -> None:
    """From the iCub's files to named touches on its body.

    Trains classifiers on simulated touches of some parts, names simulated touches on the others,
    and writes robot.png, flatmaps/, structures.png, replay.mp4, report.html and demo.json.

    \b
    Example:  skinmap demo --out demo --seed 1
    """
    from skinmap.display import require_opengl
    from viewer.demo import STEPS, demo_lines, run_demo

    require_opengl()
    robot, names = open_robot("icub", parts)
    if len(names) < 2:
        raise click.UsageError("the demo trains on one part and tests on another: give two --part")
    with progress(STEPS + 3 * len(names), "demo") as advance:
        result = run_demo(robot, names, out, seed=seed, advance=advance)
    present(result, demo_lines, as_json=as_json, inside=out)


@click.command("view", short_help="Touches on the body: window, browser, picture or movie.")
@shown_argument
@part_option
@click.option(
    "--source",
    metavar="SOURCE",
    default="sim",
    show_default=True,
    help="Source of samples: sim, a recording's file, lsl:NAME, zmq:HOST:PORT, mujoco:FILE or a "
    "plug-in's name.",
)
@click.option(
    "--model", type=PATH, help="Model that names the touches.  [default: the shipped one]"
)
@click.option("--layer", metavar="LAYER", help=f"Layer of the skin: {', '.join(LAYERS)}.")
@click.option(
    "--calibration",
    "calibrations",
    multiple=True,
    metavar="[PART=]FILE",
    help="Calibrated taxels, for the layer uncertainty, a load calibration, for forces in "
    "newtons, or a folder of check-ups, for the layer changed; may be repeated.",
)
@response_option
@click.option(
    "--view-file",
    type=FILE,
    help="View to begin with (camera, style, links, pose, size, ranges); the window saves "
    "its view there.",
)
@file_option(
    "--screenshot",
    Written(*PICTURE.suffixes, ".svg", ".pdf", ".glb"),
    "Write a picture, a figure for a paper (.svg or .pdf, 180 mm wide) or the scene for 3D "
    "programs (.glb); needs no screen.",
)
@click.option(
    "--beside",
    metavar="RECORDING|SECONDS|MODEL|CALIBRATION|SOURCE",
    help="Another recording (or folder of some, with --layer touched), or another moment, model "
    "or calibration of this one, or a live source, beside it, and the difference of both (in "
    "window and page a layer); not with --movie and --html.",
)
@file_option("--movie", Written(".mp4", ".gif"), "Write a movie (.mp4 or .gif); needs no screen.")
@file_option("--html", PAGE, "Write the scene as a page that needs nothing else.")
@click.option(
    "--at",
    type=Number(0.0, MAX_SECONDS),
    help="Time of the picture [s].  [default: the moment with the clearest touches]",
)
@seconds_option("Stop after this time [s]; a movie lasts so long.")
@speed_option("recorded", endless=False)
@click.option(
    "--web",
    metavar="[HOST:PORT]",
    is_flag=False,
    flag_value=ANYWHERE,
    help="Serve the scene to a browser, at a free port of this machine or at an address.",
)
@seed_option
@prints(ViewFiles, ViewWindow, ViewPage)
def view(**options: Any) -> None:
    """Show touches on the robot's body, with the flat map of the touched part beside it.

    Opens a window; press h in it for all keys. Pictures, movies and files need no screen.
    A recording in place of ROBOT is played on the robot that it was made on, else on the iCub; a
    folder of recordings shows where they were touched, with --layer touched.

    \b
    Example:  skinmap view icub --part torso --part left_arm --source sim
              skinmap view touches.mcap --screenshot touches.png
              skinmap view a.mcap --beside b.mcap --screenshot difference.png
              skinmap view recordings --layer touched --screenshot touched.png
    """
    present(run_view(options), lambda _: (), as_json=options["as_json"])


def run_view(options: Mapping[str, Any]) -> ViewFiles | ViewWindow | ViewPage:
    """Check the options and show what they ask for.

    Raises
    ------
    SkinError, click.UsageError
        Bad input, in one line.
    """
    options = _with_recording(options)
    _check(options)
    from skinmap.display import require_opengl

    require_opengl()
    from viewer.export.beside import write_beside
    from viewer.inputs import checked_pose, checked_ranges, parse_address, read_token
    from viewer.interaction.view_file import Settings, has_camera, load_settings, load_view
    from viewer.view_files import Wanted, shown_files, write_files
    from viewer.view_options import Look
    from viewer.window import open_window

    path: Path | None = options["view_file"]
    there = path is not None and path.exists()
    settings = load_settings(path) if path is not None and there else Settings()
    session = _session(options)
    look = Look(
        layer=options["layer"] or settings.layer,
        style=settings.style,
        angles=checked_pose(settings.pose, session.robot),
        links=() if settings.links == "none" else settings.links,
        size=settings.size,
        ranges=checked_ranges(settings.ranges),
        view=load_view(path) if path is not None and there and has_camera(path) else None,
    )
    wanted = Wanted(*(options[one] for one in ("screenshot", "movie", "html", "at", "seconds")))
    other, later, named = None, 0.0, ""
    if options["beside"] is not None:
        other, then, named = _other(session, options)
        if (picture := wanted.screenshot) is not None:
            moment, beside = write_beside(
                session, other, look, picture, wanted.at, then=then, named=named
            )
            return replace(shown_files(session, moment, [picture]), beside=beside)
        later = then or 0.0
    if wanted.files:
        return write_files(session, look, wanted)
    if options["web"]:
        from viewer.web.server import serve_web

        host, port = parse_address(options["web"])
        return serve_web(
            session, look, host=host, port=port, seconds=wanted.seconds, token=read_token(),
            other=other, later=later,
        )  # fmt: skip
    return open_window(
        session, look, seconds=wanted.seconds, view_file=path, other=other, later=later
    )


def _other(session: Any, options: Mapping[str, Any]) -> tuple[Any, float | None, str]:
    """The session beside, its own moment [s] if it has one, and what it differs in."""
    name, kind = options["beside"], _beside_kind(options["beside"])
    if kind == "recording":
        given = _with_recording({**options, "robot": name, "source": "sim"})
        other = _session({**given, "parts": (), "responses": (), "calibrations": ()})
        if options["parts"]:
            skins = {part: skin for part, skin in other.skins.items() if part in options["parts"]}
            other.skins = skins or other.skins
            other.parts = tuple(other.skins)
    elif kind == "calibration":
        other = _session({**options, "calibrations": (name,)})
    else:
        other = replace(session, origin=math.nan)
        other.model = Path(name) if kind == "model" else session.model
        other.source = name if kind == "live" else session.source
    named = Path(name).name if kind in ("model", "calibration") else ""
    return other, float(name) if kind == "moment" else None, named


def _beside_kind(name: str) -> str:
    """What stands beside: a "recording", "moment", "model", "calibration" or "live" source."""
    from skinmap.live.sources.open_source import sources

    path = Path(name)
    if re.fullmatch(r"[-+.\deE]+", name) and not path.exists():
        return "moment"
    if name.partition(":")[0] in sources.names():
        return "live"
    if path.suffix == ".skinmodel" and path.is_file():
        return "model"
    given = path if path.exists() else Path(name.partition("=")[2] or name)
    if given.suffix == ".csv" or given != path or _is_load(given):
        return "calibration"
    return "recording"


def _is_moment(name: str) -> bool:
    try:
        return 0.0 <= float(name) <= MAX_SECONDS
    except ValueError:
        return False


def _is_load(path: Path) -> bool:
    """Whether `calibrate load` wrote it; a recording may end in .npz too, or be a folder."""
    from skinmap.errors import SkinError
    from skinmap.touch.load_calibration import LoadCalibration

    try:
        LoadCalibration.read(path)
    except SkinError:
        return False
    return True


def _check_beside(options: Mapping[str, Any]) -> None:
    """Refuse what `--beside` cannot do."""
    from skinmap.errors import MissingFileError

    name, picture = options["beside"], options["screenshot"]
    kind, path = _beside_kind(name), Path(name)
    if kind == "recording" and not path.exists():
        raise MissingFileError(path, "a recording, a moment [s], a model or a source, for --beside")
    if kind == "recording" and not path.is_dir() and not _is_recording(path):
        raise click.UsageError(f"--beside takes a recording ({', '.join(RECORDINGS)}), got {path}")
    if kind == "moment" and not _is_moment(name):
        raise click.UsageError(f"--beside {name}: not a moment, which is 0 seconds or more")
    if any(options[one] for one in ("movie", "html")):
        raise click.UsageError("--beside is for --screenshot, the window and --web")
    if picture is not None and picture.suffix.lower() in (".svg", ".pdf", ".glb"):
        raise click.UsageError(f"--beside is a picture of pixels, as {picture.with_suffix('.png')}")


def _with_recording(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options, with a recording in place of the robot as their source."""
    given = {**options, "touched_in": None}
    path = Path(given["robot"] or "")
    folder = path.is_dir() and not _is_recording(path)
    if given["robot"] is not None and (folder or _is_recording(path)):
        if given["source"] != "sim":
            raise click.UsageError(f"two sources: {path} and --source {given['source']}")
        from skinmap.live.touched_taxels import recordings_of, robot_of
        from viewer.inputs import are_checkups

        if are_checkups(str(path)):
            raise click.UsageError(
                f"{path} is a folder of check-ups: write ROBOT --calibration {path} --layer changed"
            )
        several = recordings_of(path)
        if folder and not _counts(given["layer"]):
            raise click.UsageError(
                f"{path} is a folder of {len(several)} recordings: name one, or write "
                "--layer touched"
            )
        given["robot"] = robot_of(several) if folder else None
        given["source"], given["touched_in"] = str(several[0]), path
        click.get_current_context().params["source"] = given["source"]
    elif Path(given["source"]).exists():
        given["touched_in"] = Path(given["source"])
    if given["touched_in"] is not None and not _counts(given["layer"]):
        large = sum(one.stat().st_size for one in [Path(given["source"])] if one.is_file())
        given["touched_in"] = None if large > MOST_COUNTED else given["touched_in"]
    return given


def _is_recording(path: Path) -> bool:
    from skinmap.io.recordings.touch_files import is_foreign
    from skinmap.io.ros2.bag import METADATA

    known = path.suffix.lower() in RECORDINGS
    known = known or any((path / one).is_file() for one in ("data.log", METADATA))
    return known or (path.is_file() and is_foreign(path))


def _counts(layer: str | None) -> bool:
    return (layer or "").partition(":")[0] == "touched"


def _session(options: Mapping[str, Any]) -> Any:
    """The robot, its parts and all that was named for them."""
    from skinmap.live.response.pressures import load_responses
    from viewer.inputs import are_checkups, is_load, read_covariances
    from viewer.view_options import Session

    given = options["calibrations"]
    histories = [name for name in given if are_checkups(name)]
    if len(histories) > 1 or not all(Path(one).is_dir() for one in histories):
        raise click.UsageError("--calibration takes one folder of check-ups, without PART=")
    loads = [name for name in given if is_load(name) and name not in histories]
    tables = [name for name in given if name not in (*loads, *histories)]
    robot, parts = open_robot(options["robot"], options["parts"])
    session = Session(
        robot,
        parts,
        source=options["source"],
        model=options["model"],
        seed=options["seed"],
        speed=options["speed"],
        covariances=read_covariances(tables, robot, parts),
        loads=loads,
        checkups=Path(histories[0]) if histories else None,
        touched_in=options["touched_in"],
    )
    session.prepare()
    session.responses = load_responses(options["responses"], session.skins)
    return session


def _check(options: Mapping[str, Any]) -> None:
    """What can be told to be wrong before anything is loaded."""
    from skinmap.display import has_display
    from skinmap.errors import MissingFileError, OutputError, UnknownNameError

    if options["layer"] is not None and options["layer"].partition(":")[0] not in LAYERS:
        raise UnknownNameError("layer", options["layer"], LAYERS)
    if options["beside"] is not None:
        _check_beside(options)
    files = [path for one in ("screenshot", "movie", "html") if (path := options[one]) is not None]
    for path in files:
        if not path.parent.is_dir():
            raise OutputError(f"cannot write {str(path)!r}: no folder {str(path.parent)!r}")
    view_file = options["view_file"]
    if files and view_file is not None and not view_file.exists():  # a window would write it
        raise MissingFileError(view_file, "a view saved by the viewer (key v)")
    if options["web"] and files:
        raise click.UsageError("--web serves the scene, and files are asked for: one of them")
    if not options["web"] and not files and not has_display():
        raise click.UsageError("no display was found: give --screenshot, --movie, --html or --web")

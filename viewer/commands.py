"""The viewer's commands; everything heavy is imported when they run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from skinmap.commands.options import (
    MAX_SECONDS,
    PAGE,
    PICTURE,
    Number,
    Written,
    open_robot,
    part_option,
    prints,
    response_option,
    seconds_option,
    seed_option,
    shown_argument,
    speed_option,
)
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress
from skinmap.report.present import present
from viewer.results import DemoResult, ViewFiles, ViewPage, ViewWindow

VIEWS = ("auto", "window", "none")
# As `viewer.layers` has them, which takes a second to import; a test compares.
LAYERS = (
    "pressure", "raw", "binary", "structures", "uncertainty", "distortion", "health", "patches",
)  # fmt: skip
MOVIES = (".mp4", ".gif")
PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("demo", short_help="The whole thread on the real iCub: start here.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    default=Path("skinmap-demo"),
    show_default=True,
    help="Folder for pictures, movie, report and numbers.",
)
@part_option
@seed_option
@click.option(
    "--view",
    type=click.Choice(VIEWS),
    default="auto",
    show_default=True,
    help="Open the live window at the end: where there is a display, always, never.",
)
@profile_option("view")
@prints(DemoResult)
def demo(out: Path, parts: tuple[str, ...], seed: int, view: str, as_json: bool) -> None:
    """From the iCub's files to named touches on its body.

    Trains classifiers on simulated touches of some parts, names simulated touches on the others,
    and writes robot.png, flatmaps/, structures.png, replay.mp4, report.html and demo.json.

    \b
    Example:  skinmap demo --out demo --seed 1
    """
    from viewer.demo import STEPS, demo_lines, run_demo, show_window
    from viewer.display import has_display, require_opengl

    require_opengl()
    robot, names = open_robot("icub", parts)
    if len(names) < 2:
        raise click.UsageError("the demo trains on one part and tests on another: give two --part")
    if view == "window" and not has_display():
        raise click.UsageError("--view window needs a display")
    with progress(STEPS + 4 * len(names), "demo") as advance:
        result, stage = run_demo(robot, names, out, seed=seed, advance=advance)
    present(result, demo_lines, as_json=as_json, inside=out)
    if view == "window" or (view == "auto" and has_display()):
        show_window(stage)


@click.command("view", short_help="Touches on the body: window, browser, picture or movie.")
@shown_argument
@part_option
@click.option(
    "--source",
    metavar="SOURCE",
    default="sim",
    show_default=True,
    help="What is shown: sim, a recording's file, lsl:NAME, zmq:HOST:PORT, mujoco:FILE or a "
    "plug-in's name.",
)
@click.option(
    "--model", type=PATH, help="Names the touches; without, the one that comes with Skinmap."
)
@click.option("--layer", metavar="LAYER", help=f"What the skin shows: {', '.join(LAYERS)}.")
@click.option(
    "--style", metavar="STYLE", help="How: surface (interpolated) or discs (one a taxel)."
)
@click.option(
    "--calibration",
    "calibrations",
    multiple=True,
    metavar="[PART=]FILE",
    help="Calibrated taxels, for the layer uncertainty; may be repeated.",
)
@response_option
@click.option("--pose", metavar="JOINT=DEG,...", help="Joint angles; the natural pose without.")
@click.option(
    "--links",
    type=click.Choice(("all", "skin", "none")),
    default="all",
    show_default=True,
    help="What is drawn of the body: all, links with the parts' skin, nothing.",
)
@click.option("--size", metavar="WxH", help="Width and height of the picture [px], as 1200x800.")
@click.option(
    "--range",
    "ranges",
    multiple=True,
    metavar="[LAYER=]LOW:HIGH",
    help="Values of the first and last colour, or auto: from the data. May be repeated.",
)
@click.option(
    "--unit",
    "units",
    multiple=True,
    type=click.Choice(("%", "um", "cm")),
    help="Pressures in % of full scale, lengths in um or cm.",
)
@click.option(
    "--detail",
    type=Number(0.1, 100.0),
    metavar="PX",
    help="Vertices of links are drawn so far apart, in pixels; 1.5 without. More is quicker.",
)
@click.option(
    "--contour-rate",
    type=Number(0.1, 1000.0),
    metavar="HZ",
    help="How often contours of touches are found anew; with each sample without.",
)
@click.option("--view-file", type=FILE, help="Saved view to begin with; the window saves there.")
@click.option("--screenshot", type=PICTURE, help="Write a picture; needs no screen.")
@click.option(
    "--movie", type=Written(".mp4", ".gif"), help="Write a movie (.mp4 or .gif); needs no screen."
)
@click.option("--gltf", type=Written(".glb"), help="Write the scene for 3D programs (.glb).")
@click.option(
    "--html",
    type=PAGE,
    help="Write the scene as a page that needs nothing else.",
)
@click.option(
    "--at",
    type=Number(0.0, MAX_SECONDS),
    help="Of the picture [s]; by default what shows most.",
)
@seconds_option("Stop after so long; a movie lasts so long.")
@speed_option("than recorded", endless=False)
@click.option("--loop", is_flag=True, help="Play a recording over and over.")
@click.option("--follow", is_flag=True, help="Let a movie's camera turn to the touches.")
@click.option("--web", is_flag=True, help="Serve the scene to a browser.")
@click.option(
    "--host", metavar="HOST", default="127.0.0.1", show_default=True, help="Address for --web."
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port; 0: a free one.")
@click.option(
    "--token", metavar="TOKEN", help="First part of --web's address; a random one without."
)
@seed_option
@profile_option("view")
@prints(ViewFiles, ViewWindow, ViewPage)
def view(**options: Any) -> None:
    """Show touches on the robot's body, with the flat map of the touched part beside it.

    Opens a window; press h in it for all keys. Pictures, movies and files need no screen.
    Without ROBOT it is the one that was recorded, else the iCub.

    \b
    Example:  skinmap view icub --part torso --part left_arm --source sim
              skinmap view --source touches.npz --screenshot touches.png
    """
    present(run_view(options), lambda _: (), as_json=options["as_json"])


def run_view(options: Mapping[str, Any]) -> ViewFiles | ViewWindow | ViewPage:
    """Check the options and show what they ask for.

    Raises
    ------
    SkinError, click.UsageError
        Bad input, in one line.
    """
    _check(options)
    from viewer.display import require_opengl

    require_opengl()
    from viewer.drawing.skin.taxel_drawing import check_style
    from viewer.interaction.view_file import load_view
    from viewer.view_files import Wanted, write_files
    from viewer.view_options import Look
    from viewer.window import open_window

    if options["style"] is not None:
        check_style(options["style"])
    view_file: Path | None = options["view_file"]
    view = load_view(view_file) if view_file is not None and view_file.exists() else None
    session = _session(options)
    from viewer.inputs import parse_pose, parse_ranges, parse_size

    look = Look(
        layer=options["layer"],
        style=options["style"],
        angles=parse_pose(options["pose"], session.robot),
        links=options["links"],
        size=parse_size(options["size"]),
        ranges=parse_ranges(options["ranges"], options["layer"] or "pressure"),
        units=options["units"],
        view=view,
        follow=options["follow"],
        **{name: options[name] for name in ("detail", "contour_rate") if options[name] is not None},
    )
    wanted = Wanted(
        screenshot=options["screenshot"],
        movie=options["movie"],
        gltf=options["gltf"],
        html=options["html"],
        at=options["at"],
        seconds=options["seconds"],
    )
    if wanted.files:
        return write_files(session, look, wanted)
    if options["web"]:
        from viewer.web.serving import serve_web

        return serve_web(
            session,
            look,
            host=options["host"],
            port=options["port"],
            seconds=wanted.seconds,
            token=options["token"],
        )
    return open_window(session, look, seconds=wanted.seconds, view_file=view_file)


def _session(options: Mapping[str, Any]) -> Any:
    """The robot, its parts and all that was named for them."""
    from viewer.inputs import read_covariances, read_responses
    from viewer.view_options import Session

    robot, parts = open_robot(options["robot"], options["parts"])
    session = Session(
        robot,
        parts,
        source=options["source"],
        model=options["model"],
        seed=options["seed"],
        speed=options["speed"],
        loop=options["loop"],
        responses=read_responses(options["responses"], robot, parts),
        covariances=read_covariances(options["calibrations"], robot, parts),
    )
    session.prepare()
    return session


def _check(options: Mapping[str, Any]) -> None:
    """What can be told to be wrong before anything is loaded."""
    from skinmap.errors import OutputError, UnknownNameError
    from viewer.display import has_display

    if options["layer"] is not None and options["layer"] not in LAYERS:
        raise UnknownNameError("layer", options["layer"], LAYERS)
    files = {name: options[name] for name in ("screenshot", "movie", "gltf", "html")}
    for name, path in files.items():
        if path is not None and not path.parent.is_dir():
            raise OutputError(f"cannot write {str(path)!r}: no folder {str(path.parent)!r}")
        if path is not None and name == "movie" and path.suffix not in MOVIES:
            raise click.UsageError(f"--movie ends in .mp4 or .gif, got {str(path)!r}")
    if options["web"] and any(files.values()):
        raise click.UsageError("--web serves the scene, and files are asked for: one of them")
    if not options["web"] and not any(files.values()) and not has_display():
        raise click.UsageError(
            "there is no display here: give --screenshot, --movie, --gltf, --html or --web"
        )

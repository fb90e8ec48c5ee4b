"""The viewer's commands; everything heavy is imported when they run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from skinmap.commands.options import (
    json_option,
    open_robot,
    part_option,
    robot_argument,
    seed_option,
)
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress
from skinmap.report.present import emit

VIEWS = ("auto", "window", "none")
# As `viewer.layers` has them, which takes a second to import; a test compares.
LAYERS = (
    "pressure", "raw", "binary", "structures", "uncertainty", "distortion", "health", "patches",
)  # fmt: skip
PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("demo", short_help="The whole thread on the real iCub: start here.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
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
@json_option
def demo(out: Path, parts: tuple[str, ...], seed: int, view: str, as_json: bool) -> None:
    """From the iCub's files to named touches on its body.

    Trains classifiers on simulated touches of some parts, names simulated touches on the others,
    and writes robot.png, flatmaps/, structures.png, replay.mp4, report.html and demo.json.

    \b
    Example:  skinmap demo --out demo --seed 1
    """
    from viewer.demo import STEPS, run_demo, show_window
    from viewer.display import has_display, require_opengl

    require_opengl()
    robot, names = open_robot("icub", parts)
    if len(names) < 2:
        raise click.UsageError("the demo trains on one part and tests on another: give two --part")
    if view == "window" and not has_display():
        raise click.UsageError("--view window needs a display, and there is none here")
    with progress(STEPS + 4 * len(names), "demo") as advance:
        result, stage = run_demo(robot, names, out, seed=seed, advance=advance)
    if as_json:
        emit(result)
    else:
        click.echo(summary(result, out))
    if view == "window" or (view == "auto" and has_display()):
        show_window(stage)


def summary(result: dict[str, object], out: Path) -> str:
    """What the demo found, in a few lines for people."""
    from typing import Any, cast

    r = cast(dict[str, Any], result)
    accuracy = r["accuracy"]
    percent = {key: f"{100 * value:.1f} %" for key, value in accuracy.items()}
    return "\n".join(
        [
            f"{r['robot']}: {r['taxels']} taxels on {len(r['parts'])} parts, "
            f"{r['patches']} patches, {r['meshed_taxels']} taxels meshed",
            f"flat maps: {r['flips']} flipped triangles, edge rms "
            f"{r['edge_rms_percent']['median']:.2f} % (median patch), "
            f"{r['edge_rms_percent']['max']:.2f} % (worst)",
            f"structures: {r['structures']['plain']} plain, {r['structures']['rotated']} rotated",
            f"simulated touches named right: {percent['same_parts']} on trained parts, "
            f"{percent['other_parts']} on parts never trained on",
            f"  there, histograms reach {percent['other_parts_histogram']}, "
            f"the paper's literal ones {percent['other_parts_paper']}",
            f"{r['seconds']['total']:.0f} s; look at {out / 'report.html'}",
        ]
    )


@click.command("view", short_help="Touches on the body: window, browser, picture or movie.")
@robot_argument
@part_option
@click.option(
    "--source",
    default="sim",
    show_default=True,
    help="What is shown: sim, a recording's file, lsl:NAME, zmq:HOST:PORT or a plug-in's name.",
)
@click.option("--model", type=PATH, help="Names the touches; without, a small one is trained.")
@click.option("--layer", help=f"What the skin shows: {', '.join(LAYERS)}.")
@click.option("--style", help="How: surface (interpolated) or discs (one a taxel).")
@click.option(
    "--calibration",
    "calibrations",
    multiple=True,
    metavar="[PART=]FILE",
    help="Calibrated taxels, for the layer uncertainty; may be repeated.",
)
@click.option(
    "--response",
    "responses",
    multiple=True,
    metavar="[PART=]FILE",
    help="Response calibration of a part that sends raw values; may be repeated.",
)
@click.option("--pose", metavar="JOINT=DEG,...", help="Joint angles; the natural pose without.")
@click.option(
    "--links",
    type=click.Choice(("all", "skin", "none")),
    default="all",
    show_default=True,
    help="What is drawn of the body: all, links with the parts' skin, nothing.",
)
@click.option(
    "--detail",
    type=click.FloatRange(0.1, 100.0),
    metavar="PX",
    help="Vertices of links are drawn so far apart, in pixels; 1.5 without. More is quicker.",
)
@click.option(
    "--contour-rate",
    type=click.FloatRange(0.1, 1000.0),
    metavar="HZ",
    help="How often contours of touches are found anew; with each sample without.",
)
@click.option("--view-file", type=FILE, help="Saved view to begin with; the window saves there.")
@click.option("--screenshot", type=FILE, help="Write a picture; needs no screen.")
@click.option("--movie", type=FILE, help="Write a movie (.mp4 or .gif); needs no screen.")
@click.option("--gltf", type=FILE, help="Write the scene for 3D programs (.glb).")
@click.option("--html", type=FILE, help="Write the scene as a page that needs nothing else.")
@click.option("--at", type=float, help="Time of the picture [s]; by default what shows most.")
@click.option("--seconds", type=float, help="How long to watch, at most.")
@click.option("--speed", type=float, default=1.0, show_default=True, help="Of a recording.")
@click.option("--loop", is_flag=True, help="Play a recording over and over.")
@click.option("--follow", is_flag=True, help="Let a movie's camera turn to the touches.")
@click.option("--web", is_flag=True, help="Serve the scene to a browser.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address for --web.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port; 0: a free one.")
@seed_option
@profile_option("view")
@json_option
def view(**options: Any) -> None:
    """Show touches on the robot's body, with the flat map of the touched part beside it.

    Opens a window; press h in it for all keys. Pictures, movies and files need no screen.

    \b
    Example:  skinmap view icub --part torso --part left_arm --source sim
              skinmap view icub --source touches.npz --screenshot touches.png
    """
    from viewer.view_job import run_view

    result = run_view(options)
    if options["as_json"]:
        emit(result)
    else:
        for file in result.get("files", ()):
            click.echo(str(file))

"""The viewer's commands; everything heavy is imported when they run."""

from __future__ import annotations

from pathlib import Path

import click

from skinmap.cli.common import (
    emit,
    json_option,
    open_robot,
    part_option,
    progress,
    robot_argument,
    seed_option,
)

VIEWS = ("auto", "window", "none")


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


@click.command("view", short_help="Touches on the body, in a window or as a picture.")
@robot_argument
@part_option
@click.option(
    "--source",
    type=click.Path(path_type=Path),
    help="Recording to play; simulated touches by default.",
)
@click.option("--model", type=click.Path(path_type=Path), help="Model that names the touches.")
@click.option(
    "--screenshot", type=click.Path(path_type=Path, dir_okay=False), help="Write a picture."
)
@click.option("--movie", type=click.Path(path_type=Path, dir_okay=False), help="Write a movie.")
@seed_option
@json_option
def view(
    robot: str,
    parts: tuple[str, ...],
    source: Path | None,
    model: Path | None,
    screenshot: Path | None,
    movie: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Show touches on the robot's body, with the flat map of the touched part beside it.

    Without --model a classifier is trained on simulated touches first.

    \b
    Example:  skinmap view icub --part torso --part left_arm --screenshot touches.png
    """
    from viewer.display import has_display, require_opengl

    require_opengl()
    if screenshot is None and movie is None and not has_display():
        raise click.UsageError("there is no display here: give --screenshot or --movie")
    from viewer.show import show

    loaded, names = open_robot(robot, parts)
    result = show(
        loaded,
        names,
        source=source,
        model=model,
        screenshot=screenshot,
        movie=movie,
        seed=seed,
    )
    if as_json:
        emit(result)
    else:
        for file in result["files"]:
            click.echo(str(file))

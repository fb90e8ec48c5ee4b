"""What `skinmap view` does with its options: check them all, then show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from skinmap.commands.options import open_robot
from skinmap.errors import InvalidArrayError, OutputError, UnknownNameError
from viewer.commands import LAYERS
from viewer.display import has_display, require_opengl

MOVIES = (".mp4", ".gif")


def run_view(options: Mapping[str, Any]) -> dict[str, Any]:
    """Check the options and show what they ask for.

    Returns
    -------
    dict
        As docs/json.md has it.

    Raises
    ------
    SkinError, click.UsageError
        Bad input, in one line.
    """
    _check(options)
    require_opengl()
    from viewer.drawing.skin.taxel_drawing import check_style
    from viewer.interaction.view_file import load_view
    from viewer.look import Look
    from viewer.show import Wanted, open_window, write_files

    if options["style"] is not None:
        check_style(options["style"])
    view_file: Path | None = options["view_file"]
    view = load_view(view_file) if view_file is not None and view_file.exists() else None
    session = _session(options)
    from viewer.inputs import parse_pose

    look = Look(
        layer=options["layer"],
        style=options["style"],
        angles=parse_pose(options["pose"], session.robot),
        links=options["links"],
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
            session, look, host=options["host"], port=options["port"], seconds=wanted.seconds
        )
    return open_window(session, look, seconds=wanted.seconds, view_file=view_file)


def _session(options: Mapping[str, Any]) -> Any:
    """The robot, its parts and all that was named for them."""
    from viewer.inputs import read_covariances, read_responses
    from viewer.session import Session

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
    if options["layer"] is not None and options["layer"] not in LAYERS:
        raise UnknownNameError("layer", options["layer"], LAYERS)
    files = {name: options[name] for name in ("screenshot", "movie", "gltf", "html")}
    for name, path in files.items():
        if path is not None and not path.parent.is_dir():
            raise OutputError(f"cannot write {str(path)!r}: no folder {str(path.parent)!r}")
        if path is not None and name == "movie" and path.suffix not in MOVIES:
            raise click.UsageError(f"--movie ends in .mp4 or .gif, got {str(path)!r}")
    for name in ("at", "seconds"):
        if options[name] is not None and not 0 <= options[name] < math.inf:
            raise InvalidArrayError(f"--{name} must be seconds from 0, got {options[name]}")
    if not 0 < options["speed"] < math.inf:
        raise InvalidArrayError(f"--speed must be above 0, got {options['speed']}")
    if options["web"] and any(files.values()):
        raise click.UsageError("--web serves the scene, and files are asked for: one of them")
    if not options["web"] and not any(files.values()) and not has_display():
        raise click.UsageError(
            "there is no display here: give --screenshot, --movie, --gltf, --html or --web"
        )

"""Options that commands of calibration share: one name and one meaning for each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from skinmap.io.units import UNITS

FILE = click.Path(path_type=Path, dir_okay=False)
F = TypeVar("F", bound=Callable[..., Any])

layout_option = click.option(
    "--layout", "layout_file", type=FILE, required=True, help="Board: CSV `channel,x,y[,module]`."
)
mesh_option = click.option(
    "--mesh", "mesh_file", type=FILE, required=True, help="Link: STL, OBJ, PLY ..."
)


def units_option(of: str) -> Callable[[F], F]:
    """`--units`, with the files that it holds for."""
    return click.option(
        "--units",
        type=click.Choice([*UNITS]),
        default="m",
        show_default=True,
        help=f"Unit of {of}.",
    )


def sigma_option(of: str) -> Callable[[F], F]:
    """`--sigma-mm`, with what it is the error of."""
    return click.option(
        "--sigma-mm",
        type=click.FloatRange(min=0, min_open=True),
        default=1.0,
        show_default=True,
        help=f"Error of a coordinate of {of}, where the file does not say [mm].",
    )


def effort_options(command: F) -> F:
    """`--starts`, `--steps` and `--wrap-detail-mm`: what trades speed for accuracy."""
    for option in (
        click.option(
            "--wrap-detail-mm", type=click.FloatRange(min=0.5, max=50.0), default=4.0,
            show_default=True, help="Longest edge of the wrap round the link.",
        ),
        click.option(
            "--steps", type=click.IntRange(1, 1000), default=20, show_default=True,
            help="Steps in each of three stages, at most.",
        ),
        click.option(
            "--starts", type=click.IntRange(1, 9), default=3, show_default=True,
            help="Places to start from; three times as many where these fit badly.",
        ),
    ):  # fmt: skip
        command = option(command)
    return command


def out_option(of: str, *, required: bool = True) -> Callable[[F], F]:
    """`-o`, with the files that the folder is for."""
    return click.option(
        "-o",
        "--out",
        type=click.Path(path_type=Path, file_okay=False),
        required=required,
        help=f"Folder for {of}.",
    )


def format_option(
    note: str = "Also write the iCub's positions, as taxels.txt.",
) -> Callable[[F], F]:
    """`--format`."""
    return click.option(
        "--format", "formats", type=click.Choice(["csv", "icub"]), multiple=True, help=note
    )


mirror_option = click.option(
    "--mirror", is_flag=True, help="The board is drawn from its other side: mirror the drawing."
)


def accept_option(note: str = "Write results and exit 0 whatever the status.") -> Callable[[F], F]:
    """`--accept`."""
    return click.option("--accept", is_flag=True, help=note)

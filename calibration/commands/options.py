"""Options that commands of calibration share: one name and one meaning for each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import click

from calibration.patch.solver_budget import FULL, Effort
from skinmap.commands.options import Number, out_folder, seed_option, units_option
from skinmap.commands.profiles import profile_option

FILE = click.Path(path_type=Path, dir_okay=False)
TABLES = "Also write tables as the iCub's positions (.txt)."
F = TypeVar("F", bound=Callable[..., Any])

mesh_option = click.option(
    "--mesh", "mesh_file", type=FILE, required=True, help="Link: STL, OBJ, PLY ..."
)
loss_option = click.option(
    "--loss", type=click.Choice(["linear", "cauchy"]), default="cauchy", show_default=True,
    help="Squares, or a loss that outliers cannot pull.",
)  # fmt: skip


def format_option(
    note: str = "Also write the iCub's positions, as taxels.txt.",
) -> Callable[[F], F]:
    """`--format`."""
    return click.option(
        "--format", "formats", type=click.Choice(["csv", "icub"]), multiple=True, help=note
    )


def accept_option(note: str = "Write results and exit 0 whatever the status.") -> Callable[[F], F]:
    """`--accept`."""
    return click.option("--accept", is_flag=True, help=note)


@dataclass(frozen=True, kw_only=True, slots=True)
class PatchFiles:
    """A board and its link, and where taxels of it are: options of a command, a row of a batch.

    Attributes
    ----------
    layout : Path
        The board.
    mesh : Path
        The link.
    anchors : Path or None
        Known places.
    touches : Path or None
        Touches with a known probe.
    units : str
        Of all files.
    sigma_mm : float
        Error of a coordinate where a file does not say.
    mirror : bool
        Whether the board is drawn from its other side.
    """

    layout: Path
    mesh: Path
    anchors: Path | None = None
    touches: Path | None = None
    units: str = "m"
    sigma_mm: float = 1.0
    mirror: bool = False

    @property
    def title(self) -> str:
        """What is laid on what."""
        return f"{self.layout.stem} on {self.mesh.stem}"


@dataclass(frozen=True, kw_only=True, slots=True)
class PatchOptions:
    """What becomes of the evidence.

    Attributes
    ----------
    out : Path or None
        Folder for files.
    formats : tuple of str
        Tables besides our own.
    accept : bool
        Write a doubtful result too.
    effort : Effort
        Starts, steps and detail of the wrap.
    seed : int
    """

    out: Path | None = None
    formats: tuple[str, ...] = ()
    accept: bool = False
    effort: Effort = FULL
    seed: int = 0


def patch_options(
    folder: str,
    *,
    of: str = "all files",
    sigma: str = "an anchor",
    board: bool = True,
    required: bool = True,
    accept: str = "Write taxels and exit 0 whatever the status.",
) -> Callable[[F], F]:
    """What all commands of patches take; they get it as `files` and `options`.

    Parameters
    ----------
    folder : str
        What `--out` is for.
    of : str
        What the units are of.
    sigma : str
        What the error is of.
    board : bool
        Whether board and link are options; if not, the command gets `units` and `sigma_mm`.
    required : bool
        Whether `--out` is.
    accept : str
        What `--accept` does.
    """
    taken = [
        *(_BOARD if board else ()),
        units_option(of),
        click.option(
            "--sigma-mm", type=Number(0.0, 1000.0, min_open=True), default=1.0,
            show_default=True,
            help=f"Error of a coordinate of {sigma}, where the file does not say [mm].",
        ),
        out_folder(folder, required=required),
        format_option(),
        accept_option(accept),
        *_EFFORT,
        seed_option,
        profile_option("calibrate"),
    ]  # fmt: skip

    def add(command: F) -> F:
        @wraps(command)
        def gather(starts: int, steps: int, wrap_detail_mm: float, **given: Any) -> Any:
            effort = Effort(starts, steps, 1e-3 * wrap_detail_mm)
            rest = {name: given.pop(name) for name in ("out", "formats", "accept", "seed")}
            if board:
                names = {"layout_file", "mesh_file", "anchors_file", "touches_file"} & given.keys()
                files = {name.removesuffix("_file"): given.pop(name) for name in names}
                more = {name: given.pop(name) for name in ("units", "sigma_mm", "mirror")}
                given["files"] = PatchFiles(**files, **more)
            return command(options=PatchOptions(effort=effort, **rest), **given)

        found: Any = gather
        for option in reversed(taken):
            found = option(found)
        return cast("F", found)

    return add


_BOARD = (
    click.option(
        "--layout", "layout_file", type=FILE, required=True,
        help="Board: CSV `channel,x,y[,module]`.",
    ),
    mesh_option,
    click.option(
        "--mirror", is_flag=True, help="The board is drawn from its other side: mirror the drawing."
    ),
)  # fmt: skip
_EFFORT = (
    click.option(
        "--starts", type=click.IntRange(1, 9), default=3, show_default=True,
        help="Places to start from; three times as many where these fit badly.",
    ),
    click.option(
        "--steps", type=click.IntRange(1, 1000), default=20, show_default=True,
        help="Steps in each of three stages, at most.",
    ),
    click.option(
        "--wrap-detail-mm", type=Number(0.5, 50.0), default=4.0,
        show_default=True, help="Longest edge of the wrap round the link.",
    ),
)  # fmt: skip

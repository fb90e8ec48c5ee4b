"""Options that commands of calibration share, and the one way in which these end."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from calibration.commands.results import judged
from skinmap.commands.options import open_robot, out_folder
from skinmap.commands.progress import progress
from skinmap.errors import SkinMismatchError
from skinmap.report.present import present

if TYPE_CHECKING:
    from calibration.commands.results import Calibrated
    from skinmap.skin.skin import Skin

FILE = click.Path(path_type=Path, dir_okay=False)
SIGMA = 1e-3  # error of a coordinate where no file has it [m]
F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R", bound="Calibrated")

mesh_option = click.option(
    "--mesh", "mesh_file", type=FILE, required=True, help="Link: STL, OBJ, PLY ..."
)


@dataclass(frozen=True, kw_only=True, slots=True)
class PatchFiles:
    """A board, its link and where taxels of it are: options of a command, or a row of a batch.

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
        Length unit of all files.
    mirror : bool
        Whether the board is drawn from its other side.
    """

    layout: Path
    mesh: Path
    anchors: Path | None = None
    touches: Path | None = None
    units: str = "m"
    mirror: bool = False

    @property
    def title(self) -> str:
        """What is laid on what."""
        return f"{self.layout.stem} on {self.mesh.stem}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Outputs:
    """What becomes of a result.

    Attributes
    ----------
    out : Path or None
        Folder for files.
    accept : bool
        Write a doubtful result too, and exit with 0.
    as_json : bool
        Print one JSON object.
    """

    out: Path | None = None
    accept: bool = False
    as_json: bool = False

    def of(
        self,
        words: str,
        work: Callable[[], tuple[Any, ...]],
        lines: Callable[[Any], Iterable[str]],
        write: Callable[..., list[str]],
        page: Callable[..., str],
    ) -> None:
        """Do the work of a command, told as `words`, and end it with what comes of it.

        `work` gives the result and what `write` takes before its folder, `page` before the result.
        """
        with progress(1, "calibrate") as advance:
            advance(words)
            result, *made = work()
        self.finish(result, lines, partial(write, *made), partial(page, *made, result))

    def finish(
        self,
        result: R,
        lines: Callable[[R], Iterable[str]],
        write: Callable[[Path], list[str]],
        page: Callable[[], str],
    ) -> None:
        """Show a result, write its files and its page, and exit with 3 where it is refused.

        Parameters
        ----------
        result : Calibrated
        lines : callable
            Words for people, after the status and its reasons.
        write : callable
            Given the folder, writes files and returns their names.
        page : callable
            The report.
        """
        present(
            result,
            lambda one: [*judged(one), *lines(one)],
            as_json=self.as_json,
            out=self.out,
            write=write,
            page=lambda _: page(),
            verdict=result.verdict(accept=self.accept),
        )


def outputs(
    folder: str,
    *,
    required: bool = False,
    accept: str = "Write results and exit 0 whatever the status.",
) -> Callable[[F], F]:
    """`--out` and `--accept`, with `--json`: the command gets them as `output`.

    Parameters
    ----------
    folder : str
        What `--out` is for.
    required : bool
        Whether `--out` is.
    accept : str
        What `--accept` does.
    """

    def add(command: F) -> F:
        @wraps(command)
        def gathered(out: Path | None, accept: bool, as_json: bool, **given: Any) -> Any:
            output = Outputs(out=out, accept=accept, as_json=as_json)
            return command(output=output, **given)

        found = click.option("--accept", is_flag=True, help=accept)(gathered)
        return cast("F", out_folder(folder, required=required)(found))

    return add


def skin_options(command: F) -> F:
    """`--robot` and `--part` of a response: the command gets them as `robot` and `part`."""
    words = "Only this part of the robot: the result remembers its skin."
    command = click.option("--part", metavar="PART", help=words)(command)
    robot: dict[str, Any] = {"default": "icub", "show_default": True, "metavar": "ROBOT"}
    return click.option("--robot", help="Robot of --part.", **robot)(command)


def skin_of(robot: str, part: str | None, count: int) -> tuple[Skin | None, str]:
    """The skin of a part with as many taxels as there are channels, and its fingerprint.

    None and an empty text without a part.

    Raises
    ------
    SkinMismatchError
        Another number of taxels.
    """
    from skinmap.skin.skin import fingerprint

    if part is None:
        return None, ""
    skin = open_robot(robot, (part,))[0].skin(part)
    if len(skin) != count:
        raise SkinMismatchError(f"{part!r} has {len(skin)} taxels, the samples {count} channels")
    return skin, fingerprint(skin)

"""Options that commands of calibration share, and the one way in which these end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from skinmap.commands.options import out_folder, units_option
from skinmap.commands.retired import NO_PROFILE, retired
from skinmap.report.present import present

if TYPE_CHECKING:
    from calibration.commands.results import Calibrated

FILE = click.Path(path_type=Path, dir_okay=False)
NO_LOSS = "outliers never pull"
NO_SEED = "the same files always give the same result"
WORK = "a patch gets the work that its accuracy needs"
SIGMA_MM = 1.0  # error of a coordinate where no file has it
SIGMA = "write a column sigma in the file; without one it is 1 mm"
NO_EFFORT = {"starts": WORK, "steps": WORK, "wrap_detail_mm": WORK, "profile": NO_PROFILE}
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
    sigma_mm: float = SIGMA_MM
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
            Words for people.
        write : callable
            Given the folder, writes files and returns their names.
        page : callable
            The report.
        """
        present(
            result,
            lines,
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
    taken = [
        out_folder(folder, required=required),
        retired(format="write skinmap export taxels.csv --format icub -o taxels.txt"),
        click.option("--accept", is_flag=True, help=accept),
    ]

    def gathered(command: F) -> Any:
        @wraps(command)
        def gather(out: Path | None, accept: bool, as_json: bool, **given: Any) -> Any:
            output = Outputs(out=out, accept=accept, as_json=as_json)
            return command(output=output, **given)

        return gather

    return _with(taken, gathered)


def board_options() -> Callable[[F], F]:
    """A board on its link: the command gets them, with anchors and touches, as `files`."""
    taken = [
        click.option(
            "--layout", "layout_file", type=FILE, required=True,
            help="Board: CSV `channel,x,y[,module]`.",
        ),
        mesh_option,
        click.option(
            "--mirror", is_flag=True,
            help="The board is drawn from its other side: mirror the drawing.",
        ),
        units_option("all files"),
        retired(sigma_mm=SIGMA),
    ]  # fmt: skip
    fields = ("layout_file", "mesh_file", "anchors_file", "touches_file", "mirror", "units")

    def gathered(command: F) -> Any:
        @wraps(command)
        def gather(**given: Any) -> Any:
            own = {name.removesuffix("_file"): given.pop(name) for name in fields if name in given}
            return command(files=PatchFiles(**own), **given)

        return gather

    return _with(taken, gathered)


def _with(options: Sequence[Any], gathered: Callable[[F], Any]) -> Callable[[F], F]:
    def add(command: F) -> F:
        found = gathered(command)
        for option in reversed(options):
            found = option(found)
        return cast("F", found)

    return add

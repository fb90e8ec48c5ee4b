"""What commands share: options, JSON output, progress."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from skinmap.cli.shared.profiles import profile_option as profile_option
from skinmap.cli.shared.profiles import with_profile

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

F = TypeVar("F", bound=Callable[..., Any])
OUTSIDE = "skinmap.allow_outside"
LINE_SECONDS = 15.0  # between lines of progress where there is no terminal


def _note_outside(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    ctx.meta[OUTSIDE] = value


outside_option = click.option(
    "--allow-outside",
    is_flag=True,
    expose_value=False,
    callback=_note_outside,
    help="Let a manifest read files outside its own folder.",
)
_robot_argument = click.argument("robot", default="icub", metavar="[ROBOT]")
_robot_option = click.option(
    "--robot", default="icub", show_default=True, help="Robot that was recorded."
)


def robot_argument(command: F) -> F:
    """The robot as an argument, with the option that lets its manifest look around."""
    return _robot_argument(outside_option(command))


def robot_option(command: F) -> F:
    """The robot as an option, for commands whose argument is a recording."""
    return _robot_option(outside_option(command))


part_option = click.option(
    "--part", "parts", multiple=True, help="Only this part; may be repeated."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
seed_option = click.option("--seed", default=0, show_default=True, help="Seed of all randomness.")
out_option = click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder for pictures."
)


def open_robot(robot: str, parts: tuple[str, ...]) -> tuple[Robot, tuple[str, ...]]:
    """A robot and the parts asked for (all of them by default), names checked.

    Raises
    ------
    UnknownNameError
        A robot or a part that does not exist.
    """
    from skinmap.io.robots.manifest import load_robot

    ctx = click.get_current_context(silent=True)
    allow_outside = bool(ctx is not None and ctx.meta.get(OUTSIDE))
    loaded = load_robot(robot, allow_outside=allow_outside)
    for part in parts:
        loaded.part(part)
    return loaded, tuple(dict.fromkeys(parts)) or loaded.parts


def emit(result: dict[str, Any]) -> None:
    """Print one JSON object on standard output; what is not finite becomes null."""
    click.echo(json.dumps(plain(with_profile(result)), indent=2, allow_nan=False))


def plain(value: Any) -> Any:
    """Nested data with Python numbers only, None for NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def table(columns: list[str], rows: list[list[Any]]) -> None:
    """Print a table for people, numbers to the right."""
    from rich.console import Console
    from rich.table import Table

    drawn = Table(box=None, header_style="bold")
    for place, column in enumerate(columns):
        texts = any(isinstance(row[place], str) for row in rows)
        drawn.add_column(column, justify="left" if texts else "right", no_wrap=True)
    for row in rows:
        drawn.add_row(*(f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in row))
    # A pipe has no width; what is cut off there cannot be read at all.
    console = Console() if Console().is_terminal else Console(width=200)
    console.print(drawn)


@contextmanager
def progress(total: int, title: str) -> Iterator[Callable[[str], None]]:
    """A progress bar on standard error; call what it yields once a step, with what comes next.

    The time that is left is judged by the steps that were computed, not by those that were found
    on file ("resumed"). Where nobody watches, a line comes now and then instead.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    left_column = TextColumn("{task.fields[left]}")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), left_column)
    console = Console(stderr=True)
    start = told = time.monotonic()
    done = computed = 0
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=total, left="")

        def advance(what: str = "") -> None:
            nonlocal done, computed, told
            done, computed = done + 1, computed + (what != "resumed")
            now = time.monotonic()
            left = time_left(now - start, computed, total - done)
            bar.update(task, advance=1, description=f"{title} {what}".rstrip(), left=left)
            if not console.is_terminal and now - told >= LINE_SECONDS:
                told = now
                click.echo(f"{title}: {done} of {total}{left and ', ' + left}", err=True)

        yield advance


def time_left(elapsed: float, computed: int, left: int) -> str:
    """In words how long the rest takes, by what `computed` steps took [s]; empty where unknown."""
    if computed == 0 or left <= 0:
        return ""
    seconds = round(elapsed / computed * left)
    if seconds < 100:
        return f"about {seconds} s left"
    minutes = round(seconds / 60)
    return f"about {minutes} min left" if minutes < 100 else f"about {seconds / 3600:.1f} h left"

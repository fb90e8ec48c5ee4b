"""How far a command is, on standard error: a bar for people, a line now and then for files."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

QUIET = "quiet"  # in the context's object: `skinmap --quiet`
LINE_SECONDS = 15.0  # between lines of progress where there is no terminal


def is_quiet() -> bool:
    """Whether the user asked for no progress."""
    ctx = click.get_current_context(silent=True)
    return bool(ctx is not None and (ctx.obj or {}).get(QUIET))


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
    quiet = is_quiet()
    hidden = quiet or not console.is_terminal  # else it ends in empty lines in a file
    with Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task(title, total=total, left="")

        def advance(what: str = "") -> None:
            nonlocal done, computed, told
            done, computed = done + 1, computed + (what != "resumed")
            now = time.monotonic()
            left = time_left(now - start, computed, total - done)
            bar.update(task, advance=1, description=f"{title} {what}".rstrip(), left=left)
            if not quiet and not console.is_terminal and now - told >= LINE_SECONDS:
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

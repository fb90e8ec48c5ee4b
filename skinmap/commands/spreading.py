"""Options of the commands that spread their work: who computes, and how a run is resumed."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

if TYPE_CHECKING:
    from skinmap.parallel.workers import Workers

MAX_JOBS = 256  # processes
F = TypeVar("F", bound=Callable[..., Any])


class Jobs(click.ParamType["int | str"]):
    """A number of processes, or the address of a Dask scheduler."""

    name = "jobs"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> int | str:
        """The number, or the address as it is."""
        if "://" in str(value):
            return str(value)
        return click.IntRange(1, MAX_JOBS).convert(value, param, ctx)


_jobs_option = click.option(
    "--jobs",
    type=Jobs(),
    metavar="N|URL",
    default=1,
    show_default=True,
    help=f"Processes (1 to {MAX_JOBS}), or a Dask scheduler: tcp://HOST:PORT.",
)
_resume_option = click.option(
    "--resume",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Of finished results: run the same again after an interruption to go on.",
)


@dataclass(frozen=True, slots=True)
class WorkerOptions:
    """Processes or a scheduler's address, and a folder for results, as on the command line."""

    jobs: int | str = 1
    resume: Path | None = None

    @contextmanager
    def open(self, sweep: str) -> Iterator[Workers]:
        """The workers, reached before minutes are spent on what comes first.

        Parameters
        ----------
        sweep : str
            What is computed: results of another one are refused.
        """
        from skinmap.parallel.workers import Workers, open_workers

        with open_workers(Workers(self.jobs), resume=self.resume, sweep=sweep) as opened:
            yield opened
            if opened.kept is not None and opened.kept.recalled:
                click.echo(f"{opened.kept.recalled} results were on file", err=True)


ALONE = WorkerOptions()


def workers_options(*, resume: bool) -> Callable[[F], F]:
    """`--jobs`, and `--resume` of long runs; the command gets them as one, `spread`."""

    def add(command: F) -> F:
        @functools.wraps(command)
        def run(*args: Any, jobs: int | str, resume: Path | None = None, **options: Any) -> Any:
            return command(*args, spread=WorkerOptions(jobs, resume), **options)

        return cast("F", _jobs_option(_resume_option(run) if resume else run))

    return add

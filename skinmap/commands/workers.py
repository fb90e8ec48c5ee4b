"""Options of the commands that spread their work: who computes, and how a run is resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from skinmap.parallel.workers import Workers

MAX_JOBS = 256  # processes
F = TypeVar("F", bound=Callable[..., Any])
_OPTIONS = (
    click.option(
        "--jobs",
        type=click.IntRange(1, MAX_JOBS),
        default=1,
        show_default=True,
        help="Local processes.",
    ),
    click.option(
        "--backend",
        type=click.Choice(["local", "dask"]),
        default="local",
        show_default=True,
        help="Processes of this machine or a Dask cluster.",
    ),
    click.option("--address", metavar="URL", help="Of the Dask scheduler, tcp://host:port."),
    click.option(
        "--resume",
        type=click.Path(path_type=Path),
        metavar="FOLDER",
        help="Of finished results: run the same again after an interruption to go on.",
    ),
)


@dataclass(frozen=True, slots=True)
class WorkerOptions:
    """What was asked for on the command line."""

    backend: str
    jobs: int
    address: str | None
    resume: Path | None

    @contextmanager
    def open(self, sweep: str) -> Iterator[Workers]:
        """The workers, reached before minutes are spent on what comes first.

        Parameters
        ----------
        sweep : str
            What is computed: results of another one are refused.
        """
        from skinmap.parallel.workers import Workers, open_workers

        workers = Workers("dask" if self.backend == "dask" else "local", self.jobs, self.address)
        with open_workers(workers, resume=self.resume, sweep=sweep) as opened:
            yield opened
            if opened.kept is not None and opened.kept.recalled:
                click.echo(f"{opened.kept.recalled} results were on file", err=True)


def workers_options(command: F) -> F:
    """`--jobs`, `--backend`, `--address` and `--resume`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def worker_options(options: dict[str, Any]) -> WorkerOptions:
    """Take these options out of those of a command, and check that they fit together.

    Raises
    ------
    click.UsageError
        An address without the cluster, or the other way round.
    """
    names = ("backend", "jobs", "address", "resume")
    chosen = WorkerOptions(**{name: options.pop(name) for name in names})
    if chosen.backend == "local" and chosen.address:
        raise click.UsageError("--address needs --backend dask")
    if chosen.backend == "dask" and not chosen.address:
        raise click.UsageError("--backend dask needs --address tcp://host:port")
    return chosen

"""Tasks of a sweep through joblib: one core, several, or a Dask cluster, with equal results.

Each task carries its own seed, so what it gives depends neither on the worker that ran it nor on
the tasks before it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np

from skinmap.errors import InvalidArrayError, MissingLibraryError, UnreachableError

T = TypeVar("T")
R = TypeVar("R")
CONNECT_SECONDS = 5.0  # a scheduler that does not answer by then is not there


@dataclass(frozen=True, slots=True)
class Workers:
    """Who runs the tasks.

    Attributes
    ----------
    backend : {"local", "dask"}
        Processes of this machine, or a Dask cluster.
    jobs : int
        Processes; 1 runs everything in this one.
    address : str or None
        Of the Dask scheduler ("tcp://host:8786").
    """

    backend: Literal["local", "dask"] = "local"
    jobs: int = 1
    address: str | None = None

    def __post_init__(self) -> None:
        if self.backend == "dask" and not self.address:
            raise InvalidArrayError("a Dask cluster needs its address (tcp://host:port)")
        if self.backend == "local" and self.address:
            raise InvalidArrayError(f"the address {self.address!r} needs the backend dask")


ONE = Workers()


def check_workers(workers: Workers) -> None:
    """Refuse workers that cannot be reached, before anything is computed."""
    if workers.backend == "dask":
        connect(str(workers.address)).close()


def task_rng(seed: int | Sequence[int], *key: int) -> np.random.Generator:
    """A generator for one task of a run: the same on every worker, independent between tasks."""
    return np.random.default_rng([*np.atleast_1d(seed), *key])


def run_tasks(
    work: Callable[[T], R],
    tasks: Sequence[T],
    *,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> list[R]:
    """The results of `work` on each task, in the order of the tasks.

    Parameters
    ----------
    work : callable
        A function of a module (workers import it by name).
    tasks : sequence
        What it is called with, seed included.
    workers : Workers
    progress : callable, optional
        Called after each task.

    Raises
    ------
    UnreachableError
        No Dask scheduler at the address.
    MissingLibraryError
        Dask is asked for and not installed.
    """
    from joblib import Parallel, delayed

    with _pool(workers) as options:
        results = Parallel(return_as="generator", **options)(delayed(work)(t) for t in tasks)
        found = []
        for result in results:
            found.append(result)
            if progress is not None:
                progress("")
        return found


@contextmanager
def _pool(workers: Workers) -> Iterator[dict[str, Any]]:
    """Options of joblib's Parallel while its workers are reachable."""
    if workers.backend == "local":
        yield {"n_jobs": workers.jobs}
        return
    from joblib import parallel_config

    client = connect(str(workers.address))
    try:
        with parallel_config(backend="dask", client=client):
            yield {}
    finally:
        client.close()


def connect(address: str) -> Any:
    """A client of the Dask scheduler at an address.

    Raises
    ------
    UnreachableError, MissingLibraryError
    """
    try:
        from distributed import Client
    except ImportError:
        raise MissingLibraryError(
            "the backend dask needs dask and distributed: install skinmap[dask]"
        ) from None
    try:
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise UnreachableError(
            f"no Dask scheduler answers at {address!r} ({type(error).__name__}); "
            "expected an address like tcp://host:8786"
        ) from None

"""Who runs the tasks of a sweep, and where its results are kept."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from skinmap.errors import InvalidArrayError
from skinmap.parallel.pool import LocalPool, Pool
from skinmap.parallel.resume import ResumeStore


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
    kept : ResumeStore or None
        Where finished results are kept and found again.
    pool : Pool or None
        The workers themselves where they were reached already (`open_workers`).
    """

    backend: Literal["local", "dask"] = "local"
    jobs: int = 1
    address: str | None = None
    kept: ResumeStore | None = None
    pool: Pool | None = None

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise InvalidArrayError(f"at least 1 job, got {self.jobs}")
        if self.backend == "dask" and not self.address:
            raise InvalidArrayError("a Dask cluster needs its address (tcp://host:port)")
        if self.backend == "local" and self.address:
            raise InvalidArrayError(f"the address {self.address!r} needs the backend dask")


ONE = Workers()


@contextmanager
def open_workers(
    workers: Workers, *, resume: Path | None = None, sweep: str = ""
) -> Iterator[Workers]:
    """The workers, reached once for several calls of `run_tasks`, before anything is computed.

    Parameters
    ----------
    workers : Workers
    resume : Path, optional
        Folder of the results that are finished.
    sweep : str
        What they are results of ("evaluate kaspar"); a folder of another sweep is refused.

    Raises
    ------
    UnreachableError, MissingLibraryError, VersionMismatchError
        See `run_tasks`.
    DataFormatError, OutputError
        See `ResumeStore`.
    """
    with opened_pool(workers) as pool:
        if resume is None:
            yield replace(workers, pool=pool)
            return
        with ResumeStore(resume, sweep) as kept:
            yield replace(workers, pool=pool, kept=kept)


@contextmanager
def opened_pool(workers: Workers) -> Iterator[Pool | None]:
    """The pool of some workers, None for this process; one that is open already stays so."""
    if workers.pool is not None:
        yield workers.pool
    elif workers.backend == "dask":
        from skinmap.parallel.cluster import ClusterPool

        pool = ClusterPool(str(workers.address))
        try:
            yield pool
        finally:
            pool.close()
    elif workers.jobs > 1:
        yield LocalPool(workers.jobs)
    else:
        yield None

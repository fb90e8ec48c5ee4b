"""Tasks on one core, several, or a Dask cluster, with equal results in the order of the tasks.

Each task carries its own seed, so what it gives depends neither on the worker that ran it nor on
the tasks before it; a task whose worker died is given to another.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from skinmap.disk_cache import content_key
from skinmap.errors import SkinWarning, UnreachableError
from skinmap.parallel.workers import ONE, Pool, Workers, WorkersLostError, opened_pool

T = TypeVar("T")
R = TypeVar("R")
LOSSES = 5  # of workers in one sweep before it is given up: some task kills whoever takes it
WINDOW = 2  # tasks handed out for each that can run: no worker waits, and memory does not grow
RECALLED = "resumed"  # what progress is told of a result that was not computed now
Progress = Callable[[str], None]


def task_rng(seed: int | Sequence[int], *key: int) -> np.random.Generator:
    """A generator for one task of a run: the same on every worker, independent between tasks.

    Parameters
    ----------
    seed : int or sequence of int
        Of the run.
    key : int
        Which task it is.

    Returns
    -------
    numpy.random.Generator

    Examples
    --------
    >>> from skinmap.parallel import task_rng
    >>> bool(task_rng(0, 3).integers(100) == task_rng(0, 3).integers(100))
    True
    """
    return np.random.default_rng([*np.atleast_1d(seed), *key])


def run_tasks(
    work: Callable[[T], R],
    tasks: Iterable[T],
    *,
    workers: Workers = ONE,
    progress: Progress | None = None,
) -> list[R]:
    """The results of `work` on each task, in the order of the tasks.

    Parameters
    ----------
    work : callable
        A function of a module (workers import it by name).
    tasks : iterable
        What it is called with, seed included.
    workers : Workers
    progress : callable, optional
        Called after each task, with "resumed" where its result was on file.

    Raises
    ------
    UnreachableError
        No Dask scheduler at the address, or workers that died again and again.
    MissingLibraryError
        Dask is asked for and not installed.
    VersionMismatchError
        Workers of other versions.

    Returns
    -------
    list

    Examples
    --------
    >>> import math
    >>> from skinmap.parallel import run_tasks
    >>> run_tasks(math.factorial, range(5))
    [1, 1, 2, 6, 24]
    """
    with closing(each_result(work, tasks, workers=workers, progress=progress)) as results:
        found = dict(results)
    return [found[place] for place in range(len(found))]


def each_result(
    work: Callable[[T], R],
    tasks: Iterable[T],
    *,
    workers: Workers = ONE,
    progress: Progress | None = None,
) -> Generator[tuple[int, R], None, None]:
    """Place of a task and its result, as they are finished: nothing piles up.

    Tasks are taken from their iterable as workers become free, so neither need there be memory
    for all of them.

    Parameters
    ----------
    work, tasks, workers, progress
        As `run_tasks` takes them.

    Yields
    ------
    place : int
        Of the task among all.
    result

    Examples
    --------
    >>> import math
    >>> from skinmap.parallel import each_result
    >>> dict(each_result(math.factorial, range(3)))
    {0: 1, 1: 1, 2: 2}
    """
    with opened_pool(workers) as pool:
        sweep = _Sweep(work, enumerate(tasks), workers)
        found = _serial(sweep) if pool is None else _shared(sweep, pool)
        with closing(found):
            for place, result, recalled in found:
                if progress is not None:
                    progress(RECALLED if recalled else "")
                yield place, result


Found = tuple[int, Any, bool]  # place, result, and whether it was on file


@dataclass(frozen=True, eq=False, slots=True)
class _Given(Generic[T]):
    """A task on its way: its place, what it is called with, its key where results are kept."""

    place: int
    task: T
    key: str = ""


@dataclass(eq=False, slots=True)
class _Sweep(Generic[T, R]):
    """Tasks that are left, those whose workers died first."""

    work: Callable[[T], R]
    tasks: Iterator[tuple[int, T]]
    workers: Workers
    again: deque[_Given[T]] = field(default_factory=deque)
    losses: int = 0
    done: int = 0

    def take(self) -> Generator[Found, None, _Given[T] | None]:
        """The next task to compute, or None; yields the results on file that lie before it."""
        if self.again:
            return self.again.popleft()
        kept = self.workers.kept
        for place, task in self.tasks:
            if kept is None:
                return _Given(place, task)
            key = content_key(self.work, task)
            try:
                result = kept.recall(key)
            except KeyError:
                return _Given(place, task, key)
            self.done += 1
            yield place, result, True
        return None

    def finish(self, given: _Given[T], result: R) -> Found:
        """Keep a result that was computed."""
        if self.workers.kept is not None:
            self.workers.kept.keep(given.key, result)
        self.done += 1
        return given.place, result, False

    def lose(self, given: Collection[_Given[T]], error: WorkersLostError, where: str) -> None:
        """Put tasks back whose workers died; an error where that happens again and again."""
        self.again.extend(sorted(given, key=lambda one: one.place))
        self.losses += 1
        if self.losses > LOSSES:
            kept = self.workers.kept
            saved = f"; {self.done} results are kept in {str(kept.path)!r}" if kept else ""
            raise UnreachableError(
                f"workers {where} died {self.losses} times ({error}), for want of memory "
                f"perhaps: fewer --jobs may help{saved}"
            ) from None
        warnings.warn(
            f"workers {where} died ({error}): their tasks are given to others",
            SkinWarning,
            stacklevel=2,
        )


def _serial(sweep: _Sweep[T, R]) -> Generator[Found, None, None]:
    while (given := (yield from sweep.take())) is not None:
        yield sweep.finish(given, sweep.work(given.task))


def _shared(sweep: _Sweep[T, R], pool: Pool) -> Generator[Found, None, None]:
    under_way: dict[Any, _Given[T]] = {}
    try:
        while True:
            try:
                yield from _hand_out(sweep, pool, under_way)
                if not under_way:
                    return
                for future in pool.wait(under_way):
                    result = pool.result(future)
                    yield sweep.finish(under_way.pop(future), result)
            except WorkersLostError as error:
                pool.drop(under_way)
                sweep.lose(under_way.values(), error, pool.where)
                under_way.clear()
    finally:
        pool.drop(under_way)


def _hand_out(sweep: _Sweep[T, R], pool: Pool, under_way: dict[Any, _Given[T]]) -> Iterator[Found]:
    """Give the workers what they can take; yields results on file met on the way."""
    while len(under_way) < WINDOW * pool.size:
        given = yield from sweep.take()
        if given is None:
            return
        try:
            under_way[pool.submit(sweep.work, given.task)] = given
        except WorkersLostError:
            sweep.again.append(given)
            raise

"""Repetitions of a protocol: one shape for all, whatever a protocol needs to know."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from skinmap.parallel.run import Progress, run_tasks
from skinmap.parallel.workers import ONE, Workers

R = TypeVar("R")


@dataclass(frozen=True, eq=False, slots=True)
class Repeat(Generic[R]):
    """One repetition: all that a worker needs.

    Attributes
    ----------
    work : callable
        A function of a module.
    arguments : mapping of str to object
        What it is called with; a seed is one of them.
    """

    work: Callable[..., R]
    arguments: Mapping[str, Any]


def run_repeats(
    work: Callable[..., R],
    varied: Iterable[Mapping[str, Any]],
    *,
    workers: Workers = ONE,
    progress: Progress | None = None,
    **shared: Any,
) -> list[R]:
    """What `work` gives for each repetition, in their order.

    Parameters
    ----------
    work : callable
        A function of a module, called by keywords.
    varied : iterable of mapping
        What differs between the repetitions: `{"seed": 1}`.
    workers : Workers
    progress : callable, optional
        Called after each.
    shared
        What is the same for all.
    """
    repeats = [Repeat(work, {**shared, **one}) for one in varied]
    return run_tasks(_run, repeats, workers=workers, progress=progress)


def _run(repeat: Repeat[R]) -> R:
    return repeat.work(**repeat.arguments)

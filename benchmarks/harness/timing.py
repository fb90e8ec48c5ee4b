"""CPU time of tasks that take turns, and memory: what every benchmark measures with.

A task and its peer stand in one table; each is run once to warm up, then all take turns, so that
a machine that grows busy or warm does so for all of them. What is told is the median over the
turns with its quartiles.
"""

from __future__ import annotations

import contextlib
import os
import resource
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

Task = Callable[[], object] | tuple[Callable[[], object], int]
Quartiles = tuple[float, float, float]
Times = dict[str, np.ndarray]  # CPU time of each turn of a task [s]


def quartiles(values: Any) -> Quartiles:
    """Lower quartile, median, upper quartile."""
    low, middle, high = np.quantile(np.asarray(values, float), (0.25, 0.5, 0.75)).tolist()
    return low, middle, high


def timed(run: Callable[[], Any]) -> tuple[Any, float, float]:
    """What a call returns, its CPU time and its wall time [s]."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = run()
    return result, time.process_time() - cpu, time.perf_counter() - wall


def children_seconds() -> float:
    """CPU time of all processes that this one started and that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system


def process_table() -> dict[int, list[str]]:
    """What /proc/PID/stat says behind the name, of all processes that there are."""
    found = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it ended meanwhile
            text = (entry / "stat").read_text(encoding="utf-8")
            found[int(entry.name)] = text.rpartition(")")[2].split()
    return found


def memory_mb() -> float:
    """Memory of this process that is in use now [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def peak_mb() -> float:
    """Most memory of this process since it began, or since the mark was set back [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def take_turns(tasks: Mapping[str, Task], rounds: int, *, settling: int = 0) -> Times:
    """CPU times of each task over rounds in which they take turns.

    Parameters
    ----------
    tasks : mapping of str to callable, or of callable and how often it is called in a turn
        A turn's time is divided by that number.
    rounds : int
    settling : int
        Calls before each turn whose time is not taken.
    """
    table = {name: task if isinstance(task, tuple) else (task, 1) for name, task in tasks.items()}
    cpu: dict[str, list[float]] = {name: [] for name in table}
    for run, _ in table.values():
        run()
    for _ in range(rounds):
        for name, (run, repeats) in table.items():
            for _ in range(settling):
                run()
            spent = time.process_time()
            for _ in range(repeats):
                run()
            cpu[name].append((time.process_time() - spent) / repeats)
    return {name: np.array(one) for name, one in cpu.items()}


def medians(times: Times, scale: float = 1.0) -> dict[str, float]:
    """Median CPU time of each task, in a unit of 1 / `scale` seconds."""
    return {name: scale * float(np.median(one)) for name, one in times.items()}


def ratio_quartiles(times: Times, ratios: Mapping[str, tuple[str, str]]) -> dict[str, Quartiles]:
    """Quartiles of ratios of CPU times, each of two tasks in the same turn.

    Parameters
    ----------
    times : dict
        As `take_turns` gives them.
    ratios : mapping of str to (str, str)
        A name, and the tasks above and below the line.
    """
    return {name: quartiles(times[above] / times[below]) for name, (above, below) in ratios.items()}


def spreads(times: Times, scale: float = 1.0) -> dict[str, dict[str, Quartiles]]:
    """Quartiles of CPU time of each task, in a unit of 1 / `scale` seconds."""
    return {name: {"cpu": quartiles(scale * one)} for name, one in times.items()}

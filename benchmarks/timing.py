"""CPU time of tasks that take turns: what the benchmarks of classification measure with."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

Task = tuple[Callable[[], object], int]


def cpu_us(tasks: dict[str, Task], rounds: int) -> dict[str, float]:
    """Median CPU time of each task [us] over rounds in which they take turns."""
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for run, _ in tasks.values():
        run()
    for _ in range(rounds):
        for name, (run, repeats) in tasks.items():
            start = time.process_time()
            for _ in range(repeats):
                run()
            times[name].append((time.process_time() - start) / repeats * 1e6)
    return {name: median(values) for name, values in times.items()}

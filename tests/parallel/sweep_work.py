"""Tasks that workers of the tests run; worker processes import them by name."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinmap.errors import UnknownNameError
from skinmap.parallel import task_rng


@dataclass(frozen=True, slots=True)
class Draw:
    """Random numbers of a seed; a count of runs beside, where a folder is given."""

    number: int
    folder: Path | None = None
    caught: Path | None = None  # a FIFO: the first run of this task tells its process and stays


def draw(task: Draw) -> dict[str, object]:
    """What depends on the task alone, in all kinds that a result may have."""
    if task.folder is not None:
        (task.folder / f"{task.number}.{os.getpid()}.{os.urandom(6).hex()}").touch()
    if task.caught is not None and first(task.caught):
        with task.caught.open("w") as fifo:
            fifo.write(str(os.getpid()))
        threading.Event().wait()  # until it is killed
    rng = task_rng(7, task.number)
    values = rng.normal(size=(3, task.number + 1))
    return {
        "sum": float(values.sum()),
        "array": values,
        "pair": (task.number, "taxel"),
        "none": None,
    }


def first(caught: Path) -> bool:
    """Whether nobody asked before."""
    try:
        caught.with_suffix(".taken").touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def fail_at_four(number: int) -> int:
    """An error with a message of its own at 4."""
    if number == 4:
        raise UnknownNameError("number", "four", ("three", "five"))
    return number


def kill_own_process(number: int) -> int:
    """A task that no worker survives, but for one."""
    if number == 0:
        os._exit(9)
    return number


def same(one: list[dict[str, object]], other: list[dict[str, object]]) -> bool:
    """Equal to the last bit, types included."""
    return all(
        a.keys() == b.keys()
        and all(np.array_equal(a[key], b[key]) and type(a[key]) is type(b[key]) for key in a)
        for a, b in zip(one, other, strict=True)
    )


@dataclass(frozen=True, slots=True)
class Held:
    """Random numbers of a seed; where FIFOs are given, the first run tells of itself and waits."""

    number: int
    caught: Path | None = None
    go_on: Path | None = None


def draw_when_told(task: Held) -> dict[str, object]:
    """`draw`, once somebody has written into the second FIFO."""
    if task.caught is not None and task.go_on is not None and first(task.caught):
        task.caught.write_text(str(os.getpid()))
        task.go_on.read_text()
    return draw(Draw(task.number))

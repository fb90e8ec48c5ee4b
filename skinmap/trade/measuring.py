"""Time and memory of a piece of work, as reproducibly as a busy machine allows."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
CALLS = 3  # timed calls at least, and
LEAST = 0.05  # seconds of them at least
SLOW = 0.15  # seconds of one call; one that slow needs no warming up, but for the very first
CALLS_MOST = 200
STATUS = Path("/proc/self/status")
CLEAR = Path("/proc/self/clear_refs")


_untimed: ContextVar[bool] = ContextVar("untimed", default=False)
_first: ContextVar[bool] = ContextVar("first", default=False)


@contextlib.contextmanager
def _set(flag: ContextVar[bool]) -> Iterator[None]:
    token = flag.set(True)
    try:
        yield
    finally:
        flag.reset(token)


def untimed() -> AbstractContextManager[None]:
    """Within it `cpu_seconds` calls its work once: to load what it needs."""
    return _set(_untimed)


def first_time() -> AbstractContextManager[None]:
    """Within it `cpu_seconds` warms slow work up too, which it does not do again."""
    return _set(_first)


def cpu_seconds(work: Callable[[], T], *, least: float = LEAST) -> tuple[float, T]:
    """CPU time of one call, the least of several after one to warm up, and what it returned.

    What others do on the machine only ever adds to the time of a call (caches, a shared core's
    clock), so the least of several calls says most about the work itself.

    Parameters
    ----------
    work : callable
        Without arguments; does the same each time.
    least : float
        Seconds of timed calls at least; more where single calls differ much.
    """
    started = time.process_time()
    result = work()
    first = time.process_time() - started
    if _untimed.get() or (first > SLOW and not _first.get()):
        return first, result
    calls = 1 if first > SLOW else CALLS
    times: list[float] = []
    collecting = gc.isenabled()
    gc.disable()  # a collection belongs to no call more than to another
    try:
        while len(times) < CALLS_MOST:
            started = time.process_time()
            result = work()
            times.append(time.process_time() - started)
            if len(times) >= calls and sum(times) >= least:
                break
    finally:
        if collecting:
            gc.enable()
    return min(times), result


def grown_mb(work: Callable[[], T]) -> tuple[float, T]:
    """How far the process grew at most while it worked [MB], and what the work returned.

    On Linux the peak of the resident memory over what it was before, libraries of other languages
    included; elsewhere the peak of Python's own allocations.
    """
    gc.collect()
    if not _reset_peak():
        return _traced_mb(work)
    before = _status_mb("VmRSS")
    result = work()
    return max(_status_mb("VmHWM") - before, 0.0), result


def _reset_peak() -> bool:
    """Give freed memory back and let the peak start at what is held now; False where impossible."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)  # else what was freed is used again, unseen
    try:
        CLEAR.write_text("5")  # proc(5): resets the peak of the resident memory
    except OSError:
        return False
    return True


def _status_mb(key: str) -> float:
    for line in STATUS.read_text().splitlines():
        if line.startswith(key + ":"):
            return float(line.split()[1]) / 1024.0
    return float("nan")


def _traced_mb(work: Callable[[], T]) -> tuple[float, T]:
    tracemalloc.start()
    try:
        result: Any = work()
        return tracemalloc.get_traced_memory()[1] / 2**20, result
    finally:
        tracemalloc.stop()

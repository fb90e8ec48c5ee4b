"""Ctrl-C and a polite kill: who handles them, and when they have to wait.

Some packages try an import and catch whatever is raised in it, `KeyboardInterrupt` too, to go on
without the package (trimesh does): an interruption in that moment would be lost, or come back much
later as some other error. So `interruptible` raises nothing inside an import: a moment later is
soon enough.
"""

from __future__ import annotations

import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
AGAIN = 0.1  # seconds until the next look whether the import is over
IMPORTING = "<frozen importlib._bootstrap>"
Handler = Callable[[int, FrameType | None], Any]


class TerminatedError(KeyboardInterrupt):
    """A polite kill (SIGTERM): undone like Ctrl-C, with another exit code."""


def _take(handler: Handler) -> dict[signal.Signals, Any]:
    """Handle what is not ignored (a shell's background job is started so); who did before."""
    before = {kind: signal.getsignal(kind) or signal.SIG_DFL for kind in SIGNALS}
    taken = {kind: old for kind, old in before.items() if old is not signal.SIG_IGN}
    for kind in taken:
        signal.signal(kind, handler)
    return taken


@contextmanager
def graceful(handler: Handler) -> Iterator[None]:
    """Ctrl-C and a polite kill call a handler within this, and the one of before after it.

    Only the main thread has signals; in another one nothing changes.
    """
    main = threading.current_thread() is threading.main_thread()
    before = _take(handler) if main else {}
    try:
        yield
    finally:
        for kind, old in before.items():
            signal.signal(kind, old)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ctrl-C and a polite kill wait until this is over, which should be soon."""
    came: list[int] = []
    try:
        with graceful(lambda kind, _: came.append(kind)):
            yield
    finally:
        for first in came[:1]:
            signal.raise_signal(first)


@contextmanager
def interrupted_once() -> Iterator[None]:
    """The first Ctrl-C or polite kill raises `KeyboardInterrupt`; more do not disturb the end."""

    def stop(*_: object) -> None:
        for kind in SIGNALS:
            signal.signal(kind, signal.SIG_IGN)
        raise KeyboardInterrupt

    with graceful(stop):
        yield


@contextmanager
def interruptible() -> Iterator[list[int]]:
    """Ctrl-C and a polite kill raise `KeyboardInterrupt` once no import is going on.

    Yields the signals that were raised. After it a signal ends the process at once: the work is
    done, and nothing is left to be undone.
    """
    raised: list[int] = []
    due: list[int] = []  # what came inside an import, to be raised behind it

    def end(kind: int, frame: FrameType | None) -> None:
        if any(one.f_code.co_filename == IMPORTING for one, _ in traceback.walk_stack(frame)):
            due[:] = [kind]
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        due.clear()
        raised.append(kind)
        raise TerminatedError if kind == signal.SIGTERM else KeyboardInterrupt

    def again(_: int, frame: FrameType | None) -> None:
        if due:
            end(due[0], frame)

    signal.signal(signal.SIGALRM, again)
    taken = _take(end)
    try:
        yield raised
    finally:
        for kind in taken:
            signal.signal(kind, signal.SIG_DFL)
        # What came inside the last import comes too late; Python is about to forget its handlers,
        # and an alarm without one kills.
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        due.clear()

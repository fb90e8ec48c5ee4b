"""Ctrl-C and a polite kill: who handles them, and when they have to wait.

Some packages try an import and catch whatever is raised in it, `KeyboardInterrupt` too, to go on
without the package (trimesh does): an interruption in that moment would be lost, or come back much
later as some other error. `import_whole` imports them `undisturbed`: a moment later
is soon enough.
"""

from __future__ import annotations

import importlib
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
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


def import_whole(module: str) -> Any:
    """A module of a package that catches `KeyboardInterrupt` in its imports.

    Ctrl-C and a polite kill wait until it is imported.
    """
    with undisturbed():
        return importlib.import_module(module)


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
    """Ctrl-C and a polite kill raise `KeyboardInterrupt`.

    Yields the signals that were raised. After it a signal ends the process at once: the work is
    done, and nothing is left to be undone.
    """
    raised: list[int] = []

    def end(kind: int, _: FrameType | None) -> None:
        raised.append(kind)
        raise TerminatedError if kind == signal.SIGTERM else KeyboardInterrupt

    taken = _take(end)
    try:
        yield raised
    finally:
        for kind in taken:
            signal.signal(kind, signal.SIG_DFL)

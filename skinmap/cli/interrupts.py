"""Ctrl-C and a polite kill that always end a command, and its workers with it.

Some packages try an import and catch whatever is raised in it, `KeyboardInterrupt` too, to go on
without the package (trimesh does). A Ctrl-C in that moment would be lost, or come back much later
as some other error. So nothing is raised inside an import: a moment later is soon enough.
"""

from __future__ import annotations

import signal
from types import FrameType

AGAIN = 0.1  # seconds until the next look
IMPORTING = "<frozen importlib._bootstrap>"


class TerminatedError(KeyboardInterrupt):
    """A polite kill (SIGTERM): undone like Ctrl-C, with another exit code."""


def end_on_interrupt() -> None:
    """Raise `KeyboardInterrupt` on Ctrl-C and a polite kill, once no import is going on.

    A shell's background job is started with Ctrl-C ignored, and goes on ignoring it.
    """
    for kind in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(kind) is not signal.SIG_IGN:
            signal.signal(kind, _interrupted)
    signal.signal(signal.SIGALRM, _again)


def forget_interrupts() -> None:
    """End at once from here on: the work is done, and nothing is left to be undone."""
    for kind in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(kind) is _interrupted:
            signal.signal(kind, signal.SIG_DFL)


_due: list[int] = []  # what came inside an import, to be raised behind it


def _interrupted(kind: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            _due[:] = [kind]
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        frame = frame.f_back
    _due.clear()
    raise TerminatedError if kind == signal.SIGTERM else KeyboardInterrupt


def _again(_: int, frame: FrameType | None) -> None:
    if _due:
        _interrupted(_due[0], frame)

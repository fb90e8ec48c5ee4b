"""Ctrl-C that always ends a command.

Some packages try an import and catch whatever is raised in it, `KeyboardInterrupt` too, to go on
without the package (trimesh does). A Ctrl-C in that moment would be lost, or come back much later
as some other error. So nothing is raised inside an import: a moment later is soon enough.
"""

from __future__ import annotations

import signal
from types import FrameType

AGAIN = 0.1  # seconds until the next look
IMPORTING = "<frozen importlib._bootstrap>"


def end_on_interrupt() -> None:
    """Raise `KeyboardInterrupt` on Ctrl-C, once no import is going on.

    A shell's background job is started with Ctrl-C ignored, and goes on ignoring it.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        return
    signal.signal(signal.SIGINT, _interrupted)
    signal.signal(signal.SIGALRM, _interrupted)


def _interrupted(_: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        frame = frame.f_back
    raise KeyboardInterrupt

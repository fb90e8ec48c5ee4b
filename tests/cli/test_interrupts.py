"""Ctrl-C ends a command, in whatever moment it comes."""

from __future__ import annotations

import importlib
import signal
import threading

import pytest

from skinmap.cli.interrupts import end_on_interrupt

SWALLOWS = """
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass  # the handler runs between two steps of the interpreter
    came = False
except BaseException:
    came = True
"""


@pytest.fixture
def ours():
    kinds = (signal.SIGINT, signal.SIGALRM)
    before = [signal.getsignal(kind) for kind in kinds]
    end_on_interrupt()
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    for kind, handler in zip(kinds, before, strict=True):
        signal.signal(kind, handler)


def test_interrupt_in_an_import_that_catches_everything_still_ends(ours, tmp_path, monkeypatch):
    (tmp_path / "swallows.py").write_text(SWALLOWS)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(KeyboardInterrupt):  # after the import, not within
        assert not importlib.import_module("swallows").came
        threading.Event().wait(60)  # a deadline, for a handler that forgot it


def test_interrupt_elsewhere_ends_at_once(ours):
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_background_job_goes_on_ignoring_it():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        end_on_interrupt()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)

"""Ctrl-C ends a command, in whatever moment it comes."""

from __future__ import annotations

import signal
import sys

import pytest

from skinmap.cli.main import main
from skinmap.interrupts import TerminatedError, graceful, import_whole, interruptible

SWALLOWS = """
import os, signal
try:
    os.kill(os.getpid(), signal.KIND)
    for _ in range(1000):
        pass  # the handler runs between two steps of the interpreter
    came = False
except BaseException:
    came = True
"""


@pytest.fixture
def restored():
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(kind) for kind in kinds]
    yield
    for kind, handler in zip(kinds, before, strict=True):
        signal.signal(kind, handler)


@pytest.fixture
def ours(restored):
    with interruptible():
        yield


@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM"])
def test_interrupt_in_an_import_that_catches_everything_still_ends(
    ours, tmp_path, monkeypatch, kind
):
    (tmp_path / f"swallows_{kind}.py").write_text(SWALLOWS.replace("KIND", kind))
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(TerminatedError if kind == "SIGTERM" else KeyboardInterrupt):
        import_whole(f"swallows_{kind}")
    assert not sys.modules[f"swallows_{kind}"].came  # it waited until the import was over


def test_interrupt_elsewhere_ends_at_once(ours):
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_polite_kill_is_another_exit_code(monkeypatch, capsys, ours):
    monkeypatch.setattr(sys, "argv", ["skinmap", "list"])
    monkeypatch.setattr("skinmap.cli.main.LazyGroup.invoke", lambda *_: signal.raise_signal(15))
    with pytest.raises(SystemExit, match="143"):
        main()
    assert capsys.readouterr().err.strip() == "Error: terminated"
    # What comes while threads are joined ends it as it ends any program: without a traceback.
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.parametrize(("pressed", "code"), [(True, 130), (False, 1)])
def test_an_interrupt_of_which_a_library_makes_an_error_of_its_own_is_one(
    monkeypatch, capsys, ours, pressed, code
):
    def invoke(*_):
        try:
            if pressed:
                signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            pass
        raise ValueError("Invalid bounding box")  # as matplotlib says it

    monkeypatch.setattr(sys, "argv", ["skinmap", "list"])
    monkeypatch.setattr("skinmap.cli.main.LazyGroup.invoke", invoke)
    with pytest.raises(SystemExit, match=str(code)):
        main()
    said = "interrupted" if pressed else "internal error: ValueError: Invalid bounding box"
    assert capsys.readouterr().err.startswith(f"Error: {said}")


@pytest.mark.usefixtures("restored")
@pytest.mark.parametrize("context", [interruptible, lambda: graceful(print)])
def test_background_job_goes_on_ignoring_it(context):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with context():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN

from __future__ import annotations

import errno
import os
import signal
from pathlib import Path

import pytest

from skinmap.errors import OutputError
from skinmap.io import output
from skinmap.io.output import check_folder, staged_file, staged_folder


def test_staged_folder_moves_files_and_leaves_nothing_else(tmp_path):
    out = tmp_path / "a" / "b"
    with staged_folder(out) as stage:
        (stage / "sub").mkdir()
        (stage / "sub" / "x.txt").write_text("x")
        assert not (out / "sub").exists()
    assert sorted(p.name for p in out.rglob("*")) == ["sub", "x.txt"]


def test_staged_folder_that_fails_leaves_old_results_alone(tmp_path):
    (tmp_path / "x.txt").write_text("old")
    with pytest.raises(RuntimeError, match="boom"), staged_folder(tmp_path) as stage:
        (stage / "x.txt").write_text("new")
        raise RuntimeError("boom")
    assert [p.name for p in tmp_path.iterdir()] == ["x.txt"]
    assert (tmp_path / "x.txt").read_text() == "old"


def test_staged_folder_that_fails_removes_the_folder_it_made(tmp_path):
    with pytest.raises(RuntimeError, match="boom"), staged_folder(tmp_path / "new"):
        raise RuntimeError("boom")
    assert not (tmp_path / "new").exists()


def test_staged_folder_refuses_a_file_as_folder(tmp_path):
    (tmp_path / "f").write_text("")
    with (
        pytest.raises(OutputError, match="cannot write to the folder"),
        staged_folder(tmp_path / "f"),
    ):
        pytest.fail("the body must not run")


def test_staged_folder_refuses_where_nothing_can_be_made():
    # Not even root can make a folder there.
    with pytest.raises(OutputError, match="/proc/skinmap"), staged_folder(Path("/proc/skinmap")):
        pytest.fail("the body must not run")


def test_staged_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "m.bin"
    with pytest.raises(RuntimeError, match="boom"), staged_file(path) as stage:
        stage.write_text("half")
        raise RuntimeError("boom")
    assert list(tmp_path.iterdir()) == []
    with staged_file(path) as stage:
        stage.write_text("whole")
    assert path.read_text() == "whole"
    assert [p.name for p in tmp_path.iterdir()] == ["m.bin"]


def test_staged_file_refuses_a_missing_folder_and_a_folder(tmp_path):
    with pytest.raises(OutputError, match="cannot write"), staged_file(tmp_path / "no" / "m"):
        pytest.fail("the body must not run")
    with pytest.raises(OutputError, match="it is a folder"), staged_file(tmp_path):
        pytest.fail("the body must not run")


def test_check_folder_leaves_nothing_behind(tmp_path):
    check_folder(tmp_path / "a" / "b")
    check_folder(tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("below", ["", "deeper", "deeper/still"])
def test_check_folder_refuses_a_file_on_the_way(tmp_path, below):
    (tmp_path / "f").write_text("")
    with pytest.raises(OutputError, match="cannot write to the folder"):
        check_folder(tmp_path / "f" / below)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EFBIG, errno.EROFS, errno.EDQUOT, errno.EIO])
def test_what_a_disk_refuses_is_a_line_and_leaves_what_was_there(tmp_path, code):
    (tmp_path / "old.txt").write_text("before")
    for staged, place in ((staged_file, tmp_path / "old.txt"), (staged_folder, tmp_path)):
        said = f"cannot write '{place}': {os.strerror(code)}"
        with pytest.raises(OutputError, match=said), staged(place):
            raise OSError(code, os.strerror(code))
    assert [path.name for path in tmp_path.iterdir()] == ["old.txt"]
    assert (tmp_path / "old.txt").read_text() == "before"


def test_what_is_no_refusal_of_a_disk_passes(tmp_path):
    with pytest.raises(FileNotFoundError), staged_folder(tmp_path):
        (tmp_path / "gone").read_text()


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_files_move_all_together_when_a_signal_comes_between(tmp_path, monkeypatch, kind):
    move, before = os.replace, signal.signal(kind, signal.default_int_handler)

    def interrupted(source, target):
        move(source, target)
        signal.raise_signal(kind)

    monkeypatch.setattr(os, "replace", interrupted)
    try:
        with pytest.raises(KeyboardInterrupt), staged_folder(tmp_path / "out") as stage:
            for name in "abc":
                (stage / name).write_text(name)
        assert signal.getsignal(kind) is signal.default_int_handler
    finally:
        signal.signal(kind, before)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a", "b", "c"]


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("staged", [staged_file, staged_folder])
def test_a_signal_while_the_temporary_name_is_made_leaves_nothing(
    tmp_path, monkeypatch, kind, staged
):
    made = {name: getattr(output.tempfile, name) for name in ("mkstemp", "mkdtemp")}
    before = signal.signal(kind, signal.default_int_handler)

    def interrupted(name):
        def make(**options):
            found = made[name](**options)
            signal.raise_signal(kind)
            return found

        return make

    for name in made:
        monkeypatch.setattr(output.tempfile, name, interrupted(name))
    try:
        with pytest.raises(KeyboardInterrupt), staged(tmp_path / "new"):
            pytest.fail("the body must not run")
    finally:
        signal.signal(kind, before)
    assert list(tmp_path.iterdir()) == []

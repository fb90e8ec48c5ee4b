"""The same command gives the same picture: nothing that is not live looks at the clock."""

from __future__ import annotations

import contextlib
import itertools
import json
import subprocess
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import InvalidArrayError
from skinmap.live import namer
from skinmap.live.sources import source as sources
from viewer.view_options import Session

PARTS = ("left_foot", "right_foot")


@contextlib.contextmanager
def load() -> Iterator[None]:
    """Others who want the machine: two processes, and two threads of this one."""
    stop = threading.Event()

    def spin() -> None:
        while not stop.is_set():
            sum(range(2000))

    endless = [sys.executable, "-S", "-c", "while True: sum(range(2000))"]
    others = [subprocess.Popen(endless) for _ in "12"]
    threads = [threading.Thread(target=spin) for _ in "12"]
    for one in threads:
        one.start()
    try:
        yield
    finally:
        stop.set()
        for other in others:
            other.kill()
            other.wait()
        for one in threads:
            one.join()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A recording and a model of the soles."""
    folder = tmp_path_factory.mktemp("same")
    touches, model = folder / "t.npz", folder / "m.skinmodel"
    parts = itertools.chain.from_iterable(("--part", part) for part in PARTS)
    words = ["simulate", "icub", *parts, "--per-gesture", "8", "--seed", "3", "-o", str(touches)]
    assert CliRunner().invoke(cli, words).exit_code == 0
    assert CliRunner().invoke(cli, ["train", str(touches), "-o", str(model)]).exit_code == 0
    return touches, model


def seen(icub, source: str, model, *, seconds: float) -> list:
    """All that a picture of each moment would show."""
    session = Session(icub, PARTS, source=source, model=model)
    session.prepare()
    return [
        (
            round(moment.time, 6),
            {part: np.asarray(values).tobytes() for part, values in moment.pressures.items()},
            [
                (t.part, t.label, repr(t.confidence), t.identity, t.taxels.tolist())
                for t in moment.touches
            ],
        )
        for moment in session.moments(seconds)
    ]


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["sim", "recording"])
def test_moments_are_the_same_on_a_busy_machine(icub, files, kind, whole):
    recording, model = files
    source, seconds = "sim" if kind == "sim" else str(recording), 6.0 if whole else 4.2
    quiet = seen(icub, source, model, seconds=seconds)
    assert len(quiet) > 200
    assert sum(len(touches) for _, _, touches in quiet) > 100
    for _ in range(2 if whole else 1):
        with load():
            assert seen(icub, source, model, seconds=seconds) == quiet


@pytest.fixture
def slow_clock(monkeypatch):
    """Each look at the clock takes a second, as on a machine that hardly gets to work."""
    ticks = itertools.count()
    monkeypatch.setattr(namer.clock, "perf_counter", lambda: float(next(ticks)))


@pytest.mark.parametrize("kind", ["sim", "recording"])
def test_names_do_not_ask_the_clock(icub, files, kind, request):
    recording, model = files
    source = "sim" if kind == "sim" else str(recording)
    before = seen(icub, source, model, seconds=3.0)
    request.getfixturevalue("slow_clock")
    assert seen(icub, source, model, seconds=3.0) == before


def test_names_of_a_live_source_do(icub, files, monkeypatch):
    """The judge above can fail: taken for a live source, the same recording is named otherwise."""
    recording, model = files
    before = seen(icub, str(recording), model, seconds=3.0)
    monkeypatch.setattr("skinmap.live.loop.is_live", lambda _: True)
    calls = itertools.count()

    def leaps() -> float:
        return float(next(calls)) ** 2

    monkeypatch.setattr(namer, "clock", type("Clock", (), {"perf_counter": staticmethod(leaps)}))
    assert seen(icub, str(recording), model, seconds=3.0) != before
    assert not sources.is_live(Session(icub, PARTS).open(hurry=True))


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("kind", ["sim", "recording"])
def test_classify_says_the_same_on_a_busy_machine(files, kind):
    recording, model = files
    source = ["sim", "--seed", "4"] if kind == "sim" else [str(recording)]
    parts = itertools.chain.from_iterable(("--part", part) for part in PARTS)
    words = ["classify", str(model), *source, "--robot", "icub", *parts, "--seconds", "4", "--json"]

    def lines() -> list[dict]:
        result = CliRunner().invoke(cli, words)
        assert result.exit_code == 0, result.output
        found = [json.loads(line) for line in result.stdout.splitlines()]
        return [one for one in found if one["event"] == "touch"]

    quiet = lines()
    assert quiet
    with load():
        assert lines() == quiet


def test_at_and_time_are_one_clock(files, tmp_path, opengl):
    recording, model = files
    for source in ("sim", str(recording)):
        words = ["view", "icub", "--part", "left_foot", "--source", source]
        words += [
            "--model",
            str(model),
            "--screenshot",
            str(tmp_path / "a.glb"),
            "--at",
            "2.5",
            "--json",
        ]
        result = CliRunner().invoke(cli, words)
        assert result.exit_code == 0, result.output
        assert json.loads(result.stdout)["time"] == pytest.approx(
            2.5, abs=0.021
        )  # a sample at 50 Hz


def test_a_time_behind_the_end_is_refused(files, tmp_path, opengl):
    words = ["view", "icub", "--part", "left_foot", "--source", str(files[0]), "--at", "9999"]
    result = CliRunner().invoke(cli, [*words, "--screenshot", str(tmp_path / "a.png")])
    assert isinstance(result.exception, InvalidArrayError)
    assert "lasts" in str(result.exception)
    assert not (tmp_path / "a.png").exists()

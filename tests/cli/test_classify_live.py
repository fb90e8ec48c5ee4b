from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import SkinError
from skinmap.live import open_publisher
from skinmap.live.sources.simulated_source import SimulatedSource
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.model_file import save_classifier
from skinmap.touch.recording import Recording, load_recordings, save_recordings
from skinmap.touch.simulation.gestures import FOUR
from skinmap.touch.simulation.simulator import simulate

FOOT = ("--part", "left_foot")
TOUCH = {
    "heading", "up_mm", "right_mm", "speed_mm_s", "presses", "period_s", "early_label", "early_s",
    "event", "touch", "part", "label", "confidence", "names", "start_s", "duration_s", "area_mm2",
    "path_mm", "peak", "centre_mm", "contacts", "channels", "kind", "motion", "hand", "load",
    "area_least_mm2", "unfinished",
}  # fmt: skip


@pytest.fixture(scope="module")
def made(prepared, tmp_path_factory):
    """A model file that learnt on the left foot, and a recording of other touches there."""
    folder = tmp_path_factory.mktemp("live")
    foot = prepared("left_foot")
    rng = np.random.default_rng(8)
    touches = [
        Touch(foot, samples, label, rate=50.0)
        for _, label, samples in simulate(foot.skin, rng=rng, per_gesture=10, variety=0.0).touches()
    ]
    model = classifiers.get("contact-geometry")().fit(touches, rng=rng)
    save_classifier(model, folder / "m.skinmodel")
    save_recordings([simulate(foot.skin, rng=rng, per_gesture=3, variety=0.0)], folder / "t.npz")
    return folder / "m.skinmodel", folder / "t.npz"


def lines(*words):
    """What a command prints with --json: an object a line."""
    result = CliRunner().invoke(
        cli, ["classify", *map(str, words), "--json"], catch_exceptions=False
    )
    assert result.exit_code == 0, result.output
    return [json.loads(line) for line in result.stdout.splitlines()]


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def test_samples_that_are_read_at_once_have_no_delay_that_is_told(made):
    """The old line told how long samples of a file had waited for those read with them."""
    words = ["classify", *map(str, made), "--seconds", "1000"]
    last = CliRunner().invoke(cli, words, catch_exceptions=False).stdout.splitlines()[-1]
    assert last.endswith(" ms from one sample to the next (mean)")


def test_a_recording_is_followed_as_a_stream(made):
    model, recording = made
    *touches, summary = lines(model, recording, "--seconds", "1000")
    (recorded,) = load_recordings(recording)
    assert all(set(touch) == TOUCH for touch in touches)
    assert {touch["event"] for touch in touches} == {"touch"}
    assert len(recorded.labels) <= len(touches) <= len(recorded.labels) + 2
    starts = [touch["start_s"] + touch["duration_s"] for touch in touches]
    assert starts == sorted(starts)
    assert summary["event"] == "summary"
    assert summary["touches"] == len(touches)
    assert summary["counts"]["used"] == len(recorded.times)
    assert summary["counts"]["lost"] == 0
    assert 0 < summary["latency_ms"]["median"] <= summary["latency_ms"]["p99"]
    right = 0
    for event, label in enumerate(recorded.labels):
        middle = recorded.times[recorded.events == event].mean()
        there = [
            touch["label"]
            for touch in touches
            if touch["start_s"] <= middle <= touch["start_s"] + touch["duration_s"]
        ]
        right += label in there
    # 12 touches on the part it learnt on: 0.97 are right.
    assert right >= 10


def test_seconds_end_a_stream_and_what_lasts_is_told(made, prepared, tmp_path):
    model, _ = made
    pressures = np.zeros((500, 250), np.uint8)
    pressures[20:, 30:33] = 90
    path = tmp_path / "held.npz"
    save_recordings(
        [Recording("left_foot", np.arange(500) / 50, pressures, np.full(500, -1), ())], path
    )
    touch, summary = lines(model, path, "--seconds", "2")
    assert summary["seconds"] == pytest.approx(2.0, abs=0.05)
    assert touch["start_s"] == pytest.approx(0.4)
    assert touch["duration_s"] == pytest.approx(1.6, abs=0.05)


def test_people_get_lines_and_a_sentence(made):
    model, recording = made
    result = CliRunner().invoke(cli, ["classify", str(model), str(recording), "--seconds", "99"])
    head, *touches, last = result.stdout.splitlines()
    assert head.split() == ["began", "part", "touch", "sure", "hand?", "lasted", "area", "path"]
    assert all(re.match(r" +[\d.]+ s  left_foot +\w+ +[01]\.\d\d", line) for line in touches)
    assert re.fullmatch(r"\d+ touches in \d+ samples, 0 lost; [\d.]+ ms from .*", last)


@pytest.mark.usefixtures("hurried")
def test_no_line_names_a_hands_touch_that_no_hand_made():
    words = ["classify", "sim", "--gesture", "all", "--seconds", "12", "--seed", "3"]
    _, *touches, _ = CliRunner().invoke(cli, words).stdout.splitlines()
    denied = [line.split() for line in touches if re.search(r"\d  other +\d", line)]
    assert len(denied) > 2
    assert not {words[3] for words in denied} & set(FOUR)


def test_one_process_publishes_and_another_names(made):
    model, _ = made
    script = "import sys; from skinmap.cli.main import main; sys.argv[0] = 'skinmap'; main()"
    port = free_port()
    words = ["simulate", "icub", *FOOT, "--publish", f"zmq:{port}", "--seconds", "60"]
    with subprocess.Popen(
        [sys.executable, "-c", script, *words], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
    ) as publisher:
        try:
            assert publisher.stderr is not None
            publisher.stderr.readline()
            *touches, summary = lines(model, f"zmq:127.0.0.1:{port}", "--seconds", "2")
        finally:
            publisher.kill()
    assert summary["counts"]["used"] >= 50
    assert summary["counts"]["lost"] == summary["counts"]["refused"] == 0
    assert all(touch["part"] == "left_foot" for touch in touches)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nowhere",), "no source 'nowhere'; the sources are: sim, lsl, mujoco, zenoh, zmq"),
        (("gone.mcap",), "no file 'gone.mcap'"),
        (("sim:rough",), "'sim:' with raw, seed=N"),
        (("sim", "--part", "head"), "no part 'head'"),
        (("sim", *FOOT, "--response", "head=r.npz"), "no part to calibrate 'head'"),
        (("sim", *FOOT, "--response", "gone.npz"), "no file 'gone.npz'"),
        (("sim", *FOOT, "--publish", "smoke:1"), "smoke"),
        (("sim", "--robot", "baxter"), "baxter"),
    ],
)
def test_bad_input_is_one_line(made, words, message):
    with pytest.raises(SkinError, match=re.escape(message)) as told:
        lines(made[0], *words)
    assert "\n" not in str(told.value)


def test_a_port_in_use_is_one_line(made):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(SkinError, match=str(port)):
            lines(made[0], "sim", *FOOT, "--publish", f"zmq:{port}")


@pytest.fixture
def stream():
    """Publishes touches on a robot, by its name, until the test is over."""
    running = []

    def publish(robot, name=""):
        port, stop = free_port(), threading.Event()
        part = robot.parts[0]
        source = SimulatedSource(robot, parts=[part], speed=1.0)
        info = replace(source.info, robot=name or robot.name)
        publisher = open_publisher(f"zmq:{port}", info, robot=robot)

        def send():
            while not stop.is_set():
                block = source.read(0.1)
                if block is not None:
                    publisher.send_block(block)

        thread = threading.Thread(target=send)
        thread.start()
        running.append((stop, thread, source, publisher))
        return f"zmq:{port}"

    yield publish
    for stop, thread, source, publisher in running:
        stop.set()
        thread.join()
        source.close()
        publisher.close()


def test_a_stream_names_its_robot(stream, tmp_path):
    kaspar = skinmap.load_robot("kaspar")
    spec = stream(kaspar)
    *_, summary = lines(spec, "--seconds", "1")
    assert summary["parts"] == [kaspar.parts[0]]
    out = tmp_path / "k.mcap"
    found = CliRunner().invoke(cli, ["record", spec, "-o", str(out), "--seconds", "0.5", "--json"])
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["samples"] > 0


@pytest.mark.parametrize("command", [["classify"], ["record", "-o", "out.mcap"]])
def test_a_stream_of_a_robot_that_is_not_built_in_names_it_in_its_error(
    stream, command, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    spec = stream(skinmap.load_robot("kaspar"), "twolink")
    found = CliRunner().invoke(cli, [*command, spec])
    assert found.exit_code == 2 or isinstance(found.exception, SkinError)
    said = found.output + str(found.exception)
    assert f"{spec} is of 'twolink': give its manifest as --robot" in said


def test_the_centre_is_that_of_the_load_and_not_of_what_lets_go_last(made, tmp_path):
    model, _ = made
    skin = skinmap.load_robot("icub").skin("left_foot")
    middle = skin.positions[30]
    away = np.linalg.norm(skin.positions - middle, axis=1)
    pressed = np.flatnonzero(away < 0.02)
    edge = pressed[np.argmax(away[pressed])]
    last = np.argsort(np.linalg.norm(skin.positions - skin.positions[edge], axis=1))[:2]
    values = np.zeros((200, len(skin)), np.uint8)
    values[50:100, pressed] = 90
    values[100:110, last] = 30
    path = tmp_path / "lets_go.npz"
    none = np.full(200, -1)
    save_recordings([Recording("left_foot", np.arange(200) / 50, values, none, ())], path)
    touch, _ = lines(model, path)
    centre = skin.positions[pressed].mean(axis=0)
    assert np.linalg.norm(1e-3 * np.array(touch["centre_mm"]) - centre) < 1e-3

"""`skinmap view --web` as people start it: a child process, its address, a browser, Ctrl-C."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli

ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/[\w-]{32}/")
BEGUN = 60  # longest wait for the address: imports and skins come first [s]


START = "from skinmap.cli.main import main; main()"
SKIN = ("--part", "left_foot")


class Child:
    """A command, and what it says."""

    def __init__(self, *words: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", START, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        self.said: list[str] = []
        self.heard = threading.Condition()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            with self.heard:
                self.said.append(line)
                self.heard.notify_all()

    def address(self) -> str:
        """What it prints once the page is served."""
        with self.heard:
            found = self.heard.wait_for(lambda: ADDRESS.search("".join(self.said)), BEGUN)
        assert found, f"no address within {BEGUN} s: {''.join(self.said)}"
        return found[0]

    def interrupt(self) -> int:
        """Ctrl-C; its exit code."""
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(20)
        self.reader.join(5)
        return code


@pytest.fixture
def command(opengl) -> Iterator[Callable[..., Child]]:
    made: list[Child] = []

    def begin(*words: str) -> Child:
        made.append(Child(*words))
        return made[-1]

    yield begin
    for child in made:
        if child.process.poll() is None:
            child.process.kill()
        child.process.communicate()


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A model that takes no time to train, and the recording it was trained on."""
    folder = tmp_path_factory.mktemp("model")
    touches, path = folder / "touches.mcap", folder / "small.skinmodel"
    words = ["simulate", "icub", *SKIN, "--per-gesture", "10", "-o", str(touches)]
    assert CliRunner().invoke(cli, words).exit_code == 0
    assert CliRunner().invoke(cli, ["train", str(touches), "-o", str(path)]).exit_code == 0
    return path


def view(*words: str) -> tuple[str, ...]:
    return ("view", "icub", "--web", "--links", "skin", *SKIN, *words)


def end(child: Child, tab) -> None:
    """Ctrl-C ends it without a word of complaint, and the page says so."""
    assert tab.faults == []
    assert child.interrupt() == 0
    said = "".join(child.said)
    assert "Traceback" not in said
    assert "Exception" not in said
    tab.wait("#status.warn")
    tab.context.close()


def test_the_simulator_is_seen_picked_and_ended_by_ctrl_c(command, open_tab):
    child = command(*view("--source", "sim"))
    tab = open_tab(child.address())
    tab.wait(".label")
    flat = tab.page.locator("#flat")
    place = tab.page.evaluate(
        """() => {
          const { flat, arrays } = skinmap, { middle, half } = flat.frame();
          const uv = arrays["taxel.uv"], box = flat.canvas.getBoundingClientRect();
          const share = (i) => ((i ? -0.5 : 0.5) * (uv[i] - middle[i])) / half[i];
          const [x, y] = [0.5 + share(0), 0.5 + share(1)];
          return { x: x * box.width, y: y * box.height };
        }"""
    )
    flat.click(position=place)
    channel = skinmap.load_robot("icub").skin("left_foot").channels[0]
    tab.wait(f"#pick-about dt:text-is('channel') + dd:text-is('{channel}')")
    end(child, tab)


def test_a_recording_is_played_with_the_names_of_a_model(command, open_tab, model):
    recording = model.with_name("touches.mcap")
    child = command(*view("--source", str(recording), "--model", str(model), "--loop"))
    tab = open_tab(child.address())
    tab.wait(".label")
    tab.page.wait_for_function("Number(document.getElementById('time').max) > 5")
    assert tab.page.locator("#time").is_enabled()
    tab.wait(".label:has-text('%')")  # a name with its confidence
    end(child, tab)


def test_a_live_stream_is_shown(command, open_tab, model):
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"zmq:127.0.0.1:{free.getsockname()[1]}"
    command("simulate", "icub", *SKIN, "--publish", address)
    child = command(*view("--source", address, "--model", str(model)))
    tab = open_tab(child.address())
    tab.wait(".label")
    assert tab.page.locator("#time").is_disabled()
    assert "live" in tab.page.locator("#clock").inner_text()
    end(child, tab)

"""`skinmap view --web` as people start it: a child process, its address, a browser, Ctrl-C."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import pytest

import skinmap

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


def view(*words: str) -> tuple[str, ...]:
    return ("view", "icub", "--web", *SKIN, *words)


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

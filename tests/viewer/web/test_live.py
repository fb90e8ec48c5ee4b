"""Sources as `skinmap view --web` opens them: a recording, a live stream, and what goes wrong."""

from __future__ import annotations

import itertools
import socket
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.live.publishing.publish import open_publisher
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.skin import fingerprint
from viewer.view_options import Look, Session
from viewer.web.server import served, wait

PART = "left_foot"
RATE = 50.0
CYCLE, PRESSED, TOUCHED = (
    100,
    80,
    25,
)  # samples: of press and rest, of the press, of one that is seen


class Stream:
    """Somebody who publishes samples of a part until closed: its middle is pressed again and again.

    What stands still from the first sample on is a stuck taxel: a page that takes its time to open
    would never see a touch.
    """

    def __init__(self, address: str, robot, part: str = PART, *, short: bool = False) -> None:
        skin = robot.skin(part)
        gap = np.linalg.norm(skin.positions - skin.positions.mean(axis=0), axis=1)
        pressed = np.where(gap < gap.min() + 0.015, 180.0, 0.0).astype(np.float32)
        info = StreamInfo(
            "foot", (part,), (len(skin),), RATE, robot=robot.name, clock="local",
            fingerprints={part: fingerprint(robot.skin(part))},
        )  # fmt: skip
        self._values = pressed[None, :-1] if short else pressed[None]
        self._publisher = open_publisher(address, info, topics=("pressure",))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        for count in itertools.count():
            row = count % CYCLE
            if self._stop.is_set() and TOUCHED <= row < PRESSED:  # the last picture has a touch
                return
            times = np.array([time.perf_counter()])
            values = self._values if row < PRESSED else np.zeros_like(self._values)
            self._publisher._send_samples("pressure", times, values)
            time.sleep(1 / RATE)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._publisher.close()


@pytest.fixture
def address() -> str:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return f"zmq:127.0.0.1:{free.getsockname()[1]}"


@pytest.fixture
def publish(address, icub) -> Iterator[Callable[..., Stream]]:
    made: list[Stream] = []

    def begin(**how) -> Stream:
        for old in made:
            old.close()
        made[:] = [Stream(address, icub, **how)]
        return made[0]

    yield begin
    for stream in made:
        stream.close()


@pytest.fixture
def session(icub, prepared, opengl) -> Callable[[str], Session]:
    def make(source: str) -> Session:
        return Session(icub, (PART,), source=source, skins={PART: prepared(PART)})

    return make


def test_a_recording_is_played_and_gets_its_names(session, open_tab, tmp_path):
    recording = tmp_path / "touches.npz"
    words = ["simulate", "icub", "--part", PART, "--per-gesture", "3", "-o", str(recording)]
    assert CliRunner().invoke(cli, words).exit_code == 0
    with served(session(str(recording)), Look(links="skin")) as (server, player):
        player.loop = True
        tab = open_tab(server.url)
        tab.wait(".label:has-text('%')")  # a name with its confidence
        assert float(tab.page.locator("#time").get_attribute("max")) > 5
        assert tab.page.locator("#time").is_enabled()
        assert tab.faults == []
        tab.context.close()


def test_what_becomes_of_a_live_stream_is_told_and_the_page_stays(
    session, publish, open_tab, address
):
    publish()
    with served(session(address), Look(links="skin")) as (server, _):
        tab = open_tab(server.url)
        tab.wait(".label")
        tab.wait("#time:enabled")  # what was seen can be led through
        assert tab.page.locator("#clock").inner_text() == "live"
        tab.wait("#status:has-text('samples/s'):has-text('shown after')")

        publish(short=True)  # it loses a taxel
        tab.wait("#status.warn:has-text('no data for'):has-text('samples do not fit this skin')")
        publish()
        tab.wait("#status:not(.warn):has-text('samples/s')")
        tab.wait(".label")
        publish().close()  # it stops
        tab.wait("#status.warn:has-text('no data for')")
        assert "fit" not in tab.page.locator("#status").inner_text()
        publish(part="right_foot")  # another skin
        tab.wait("#status.warn:has-text('the source failed:'):has-text('sends another skin now')")
        assert tab.page.locator("#status").inner_text().count("\n") == 0
        # The last picture stays; whether its touches have names yet is up to its last samples.
        tab.wait()
        assert np.ptp(tab.pixels()) > 50

        said: list[str] = []
        wait(server.hub, 0.2, said.append)
        (line,) = said
        assert "the source failed" in line
        assert "Ctrl-C" in line
        other = open_tab(server.url)  # who comes later is told, too
        other.wait("#status.warn:has-text('the source failed')")
        assert tab.faults == other.faults == []
        other.context.close()
        tab.context.close()


def test_a_player_that_only_ends_is_waited_for_without_a_word(start):
    said: list[str] = []
    hub = start().hub
    hub.player.play()
    wait(hub, 0.1, said.append)
    assert said == []

"""Many updates of one page: what the server's memory grows by, and whether it ends as it began.

A child process takes the samples as a page does, as fast as they come, and says of each that it is
drawn; what a browser itself takes is not looked at.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import skinmap
from benchmarks.harness.timing import memory_mb
from benchmarks.viewer.viewer_soak import WARM, Live, moments
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.layers import Layers
from viewer.playing.player import Player
from viewer.web.sample import SampleWriter
from viewer.web.scene_data import make_scene
from viewer.web.server import WebServer, serve

PART, LINK = "torso", "chest"
AHEAD = 2  # moments that are made before the page has taken them
PAGE = """
import sys
from websockets.sync.client import connect
address, origin, wanted = sys.argv[1], sys.argv[2], int(sys.argv[3])
with connect(address, origin=origin, max_size=None) as page:
    came = 0
    while came < wanted:
        if isinstance(page.recv(timeout=600), bytes):
            came += 1
            page.send('{"do": "drawn", "samples": %d}' % came)
"""


class Hurried(Live):
    """A source whose next moment comes as soon as the page has taken the one before."""

    def __init__(self, source: Iterator[Any]) -> None:
        super().__init__(source)
        self._next, self.given = source, 0
        self.server: WebServer | None = None

    def step(self, timeout: float, wake: threading.Event) -> Any:
        """The next moment, or None after `timeout` [s]."""
        until = time.monotonic() + timeout
        while self.server is None or self.given > self.server.hub.samples_sent + AHEAD:
            if time.monotonic() > until or wake.wait(0.001):
                return None
        self.given += 1
        return next(self._next)


def soak(updates: int) -> dict[str, Any]:
    """Serve so many updates to one page."""
    robot = skinmap.load_robot("icub")
    skins = {PART: PreparedSkin(robot.skin(PART))}
    source = Hurried(moments({PART: skins[PART].skin}))
    warm, before = min(WARM, updates // 4), 0.0
    with (
        Player(source) as player,
        serve(robot, skins, player, port=0, links=[LINK]) as server,
    ):
        source.server = server
        origin = f"http://127.0.0.1:{server.port}"
        words = [f"ws://127.0.0.1:{server.port}/{server.guard.token}/live", origin, str(updates)]
        started = time.process_time()
        page = subprocess.Popen([sys.executable, "-c", PAGE, *words])
        while page.poll() is None:
            time.sleep(0.05)
            if not before and server.hub.samples_sent >= warm:
                before = memory_mb()
        return {
            "updates": server.hub.samples_sent,
            "cpu_ms_per_update": (time.process_time() - started) / updates * 1e3,
            "grown_mb": memory_mb() - before,
            "same_as_fresh": page.returncode == 0 and _same(server, robot, skins),
        }


def _same(server: WebServer, robot: Any, skins: dict[str, PreparedSkin]) -> bool:
    """Whether the last sample is written by a fresh writer to the same bytes."""
    hub = server.hub
    fresh = SampleWriter(make_scene(robot, skins, links=[LINK]), Layers(skins))
    last, layer = hub._moment, Layers(skins).get("pressure")
    return hub._writer.write(last, layer, {}) == fresh.write(last, layer, {})

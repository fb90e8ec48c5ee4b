"""Many updates of one scene: what memory grows by, and how old is what is shown."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.timing import memory_mb
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.layers import Layers
from viewer.playing.player import Player
from viewer.web.sample import SampleWriter
from viewer.web.scene_data import WebScene
from viewer.web.server import WebServer, serve

PERIOD = 1.0 / 50.0  # of the samples [s]
SECONDS = 6.0  # that ages are looked at
WARM = 2_000  # updates until caches are filled
SIZE = (320, 240)


def moments(skins: dict[str, Any], seed: int = 0) -> Iterator[Any]:
    """Touches that wander over the parts, appear and go, without end."""
    rng = np.random.default_rng(seed)
    number, parts = 0, list(skins)
    while True:
        part = parts[number // 60 % len(parts)]
        skin = skins[part]
        taxel = int(rng.integers(len(skin)))
        distance = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
        load = 200.0 * np.clip(1.0 - (distance / 0.02) ** 2, 0.0, None)
        pressures = {name: np.zeros(len(one)) for name, one in skins.items()}
        pressures[part] = load
        touched = np.flatnonzero(load > 12.0)
        touches = (NamedTouch(part, touched, skin.positions[taxel], "poke", 0.9),)
        yield Moment(number * PERIOD, pressures, touches if number % 60 < 50 else ())
        number += 1


def soak(scene: Any, updates: int, fresh: Callable[[], Any] | None = None) -> dict[str, Any]:
    """Show so many updates, as fast as they can be drawn; and the last in a fresh scene, too."""
    skins = {part: layer.skin for part, layer in scene.layers.items()}
    source = moments(skins)
    before, started = 0.0, time.process_time()
    warm = min(WARM, updates // 4)
    for number in range(updates):
        if number == warm:
            before = memory_mb()
        scene.show_moment(next(source))
        scene.refresh()
        if number % 20_000 == 0 and number:
            print(f"{number:,} updates, {memory_mb():.1f} MB", file=sys.stderr, flush=True)
    told = {
        "updates": updates,
        "cpu_ms_per_update": (time.process_time() - started) / updates * 1e3,
        "grown_mb": memory_mb() - before,
    }
    if fresh is not None:  # the last moment in a new window
        last, other = next(source), fresh()
        # The camera turns to the first touch and a label stays where it was: both look from the
        # same side, and see the touch begin.
        rest = replace(last, touches=(), pressures={p: 0.0 * v for p, v in last.pressures.items()})
        for one in (scene, other):
            one.look(20.0)
            for moment in (rest, last):
                one.show_moment(moment)
                one.refresh()
        told["same_as_fresh"] = bool(np.array_equal(scene.frame(), other.frame()))
        other.close()
    return told


class Live:
    """A live source at 50 Hz, as a player's thread asks it: the newest moment that is due.

    A moment's time is when it was due, in perf_counter's seconds: what the thread comes too late
    by counts as age too.
    """

    loop = seekable = halts = paced = False
    duration, period = float("nan"), PERIOD

    def __init__(self, source: Iterator[Any]) -> None:
        self._source, self._due = source, time.perf_counter()

    def step(self, timeout: float, wake: threading.Event) -> Any:
        """The newest moment, None after `timeout` [s]."""
        late = time.perf_counter() - self._due
        if late < 0.0:
            wake.wait(min(-late, timeout))
            if time.perf_counter() < self._due:
                return None
        behind = int(max(0.0, time.perf_counter() - self._due) / PERIOD)
        arrived = self._due + behind * PERIOD
        self._due = arrived + PERIOD
        late = time.perf_counter() - arrived
        return replace(next(self._source), time=arrived, latency=late, rate=1.0 / PERIOD)

    def pace(self, speed: float, *, halted: bool, hurried: bool) -> None:
        """And at its own pace."""

    def close(self) -> None:
        """There is nothing to give back."""


def ages(scene: Any, turn: float = 0.0) -> dict[str, float]:
    """How old what is shown is: the window's own loop, its player's thread, a source at 50 Hz.

    From a sample's arrival to its picture on the screen; those that say themselves that they are
    late are counted apart. The camera turns by `turn` [deg] with each picture. Ends with the
    scene closed, as a window does.
    """
    from viewer.window import Window

    player: Any = Player(Live(moments({p: one.skin for p, one in scene.layers.items()}, seed=1)))
    window = Window(scene, player)
    window.open()
    scene.refresh()
    player.start()
    shown: list[float] = []
    late = 0  # pictures that say themselves that they are late
    start = time.perf_counter()
    try:
        while time.perf_counter() < start + SECONDS:
            if turn:
                scene.look(20.0 + turn * window.drawn)
            before = window.drawn
            window.turn()
            if window.drawn > before and scene.moment.time > 0.0:  # NaN before the first sample
                if window.punctual.late > late:
                    late += 1
                else:
                    shown.append(time.perf_counter() - scene.moment.time)
            window.wait()
    finally:
        window.close()
    told = {"drawn_per_s": (len(shown) + late) / SECONDS}
    if shown:  # else a machine with so much to do that every picture says that it is late
        told |= {"median_ms": 1e3 * float(np.median(shown)), "worst_ms": 1e3 * max(shown)}
    return told


def soak_torso(updates: int) -> dict[str, Any]:
    """Many updates of the torso of the iCub."""
    from viewer.scene import Scene

    def load() -> Any:
        return Scene.load("icub", ["torso"], links="skin", window_size=SIZE)

    return soak(load(), updates, load)


# Many updates of one page: what the server's memory grows by, and whether it ends as it began.
#
# A child process takes the samples as a page does, as fast as they come, and says of each that it
# is drawn; what a browser itself takes is not looked at.

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


def soak_page(updates: int) -> dict[str, Any]:
    """Serve so many updates to one page."""
    robot = skinmap.load_robot("icub")
    skins = {PART: PreparedSkin(robot.skin(PART))}
    source = Hurried(moments({PART: skins[PART].skin}))
    warm, before = min(WARM, updates // 4), 0.0
    with Player(source) as player, serve(robot, skins, player, port=0, links=[LINK]) as server:
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
    fresh = SampleWriter(WebScene(robot, skins, links=[LINK]), Layers(skins))
    last, layer = hub._moment, Layers(skins).get("pressure")
    return hub._writer.write(last, layer, {}) == fresh.write(last, layer, {})

"""Where `skinmap checkup` wants to be touched next, on the robot's body in a browser."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.playing.player import Player
from viewer.web.server import serve

AROUND = 9e-3  # taxels so near the place are marked [m]
MILLIMETRES = re.compile(r" \([^()]* mm\)")  # coordinates: too long beside a body
RATE = 20.0  # pictures a second


class WebMarker:
    """A page that shows the next place as a touch with its words.

    Parameters
    ----------
    robot : Robot
    parts : sequence of str
    told : callable
        Told the page's address.
    """

    def __init__(
        self, robot: Robot, parts: Sequence[str], told: Callable[[str], None] | None = None
    ) -> None:
        self.skins = {part: PreparedSkin(robot.skin(part)) for part in parts}
        self._pressures: dict[str, NDArray[np.float64]] = {
            part: np.zeros(len(skin)) for part, skin in self.skins.items()
        }
        self._touches: tuple[NamedTouch, ...] = ()
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self.player = Player(self._moments())
        self.server = serve(robot, self.skins, self.player, port=0)
        if told is not None:
            told(self.server.url)

    def show(self, part: str, path: FloatArray, words: str) -> None:
        """Mark a place (p, 3) of a part [m], with a line of words."""
        touch = next_touch(self.skins[part], path, words)
        with self._lock:
            self._touches = (touch,)

    def feed(self, part: str, answers: FloatArray) -> None:
        """Show answers (n,) of a part [counts]."""
        with self._lock:
            self._pressures[part] = np.clip(np.asarray(answers, np.float64), 0.0, 255.0)

    def close(self) -> None:
        """End the page."""
        self._closed.set()
        self.server.stop()
        self.player.close()

    def moment(self, now: float) -> Moment:
        """What is to be shown at a time."""
        with self._lock:
            return Moment(now, dict(self._pressures), self._touches)

    def _moments(self) -> Iterator[Moment]:
        began = time.monotonic()
        while not self._closed.is_set():
            yield self.moment(time.monotonic() - began)
            self._closed.wait(1.0 / RATE)


def next_touch(skin: PreparedSkin, path: FloatArray, words: str) -> NamedTouch:
    """The place to touch next, as a touch that the viewer outlines and labels."""
    positions = skin.skin.positions
    away = np.linalg.norm(positions[:, None] - path[None], axis=2).min(axis=1)
    rows = np.flatnonzero(away < max(AROUND, float(away.min()) + 1e-4))
    centre = path[len(path) // 2]
    normal = skin.skin.normals[int(np.argmin(away))]
    label = MILLIMETRES.sub("", words).replace(f" {skin.skin.part}", "")  # what is seen is not said
    return NamedTouch(skin.skin.part, rows, centre, f"next: {label}", 1.0, 0, normal=normal)


open_marker = WebMarker  # what `skinmap checkup --web` opens

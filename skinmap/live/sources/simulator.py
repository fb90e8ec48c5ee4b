"""Endless simulated touches as a live source: seeded, on chosen parts, at any pace."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import InvalidArrayError
from skinmap.live.bounded_queue import BoundedQueue
from skinmap.live.sources.simulated_touches import Touching, TrueTouch
from skinmap.live.sources.source import SIMULATION, Block, Kind, Source, SourceEnded, StreamInfo
from skinmap.skin.fingerprint import fingerprint
from skinmap.skin.robot import Robot
from skinmap.touch.gestures import FOUR
from skinmap.touch.sensing import Sensing

REST = 240  # what an iCub's taxel sends untouched; less is harder [counts]
CHUNK = 0.25  # samples are made so far in one go [s]
HALTED = 1.0  # without a call of `read` for so long, the simulation stands still [s]
AHEAD = 4  # chunks made before they are wanted


class SimulatedSource(Source):
    """Touches on a robot's skin without end: a `Source`.

    Parameters
    ----------
    robot : Robot
    parts : sequence of str, optional
        Only these.
    seed : int
        The same touches for the same seed, parts and rate.
    rate : float
        Samples a second.
    speed : float
        How many times faster than the clock; `inf` as fast as they are asked for.
    kind : {"pressure", "raw"}
        Raw values are 240 at rest and fall under load, as the iCub sends them.
    gestures : sequence of str
    sensing : Sensing, optional
        How taxels answer; its rate is `rate`.
    seconds : float
        It ends after so long; never by default.

    Notes
    -----
    Nothing is left out: a reader that comes late gets all samples that are due. Where nobody reads
    for a second its time stands still.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        parts: Sequence[str] | None = None,
        seed: int = 0,
        rate: float = 50.0,
        speed: float = 1.0,
        kind: Kind = "pressure",
        gestures: Sequence[str] = FOUR,
        sensing: Sensing | None = None,
        seconds: float = float("inf"),
    ) -> None:
        sensing = Sensing(rate=rate) if sensing is None else sensing
        if not speed > 0:
            raise InvalidArrayError(f"speed must be above 0, got {speed}")
        chosen = tuple(dict.fromkeys(parts or robot.parts))
        rng = np.random.default_rng(seed)
        self._touching = Touching(robot, chosen, rng=rng, sensing=sensing, gestures=gestures)
        info = StreamInfo(
            "simulation",
            chosen,
            tuple(len(robot.skin(part)) for part in chosen),
            sensing.rate,
            kind,
            robot.name,
            {part: fingerprint(robot.skin(part)) for part in chosen},
            SIMULATION,
        )
        super().__init__(info)
        self._speed = float(speed)
        self._last = seconds * sensing.rate
        self._chunk = max(1, round(CHUNK * sensing.rate))
        self._made: BoundedQueue[NDArray[np.uint8]] = BoundedQueue(AHEAD)
        self._closed = threading.Event()
        self._worker = threading.Thread(target=self._work, name="simulator", daemon=True)
        self._open = np.zeros((0, self._info.channels), np.uint8)
        self._given = 0
        self._since = self._asked = float("nan")  # the first sample, and the last call of `read`
        self._worker.start()

    @property
    def speed(self) -> float:
        """How many times faster than the clock."""
        return self._speed

    @property
    def truth(self) -> tuple[TrueTouch, ...]:
        """What was simulated, the last thousand touches; some may still be to come."""
        return tuple(self._touching.truth)

    def read(self, timeout: float) -> Block | None:
        """Samples that are due; None when none is within `timeout` [s].

        Raises
        ------
        SourceEnded
            Closed, or played as long as was asked for.
        """
        if self._closed.is_set() or self._given >= self._last:
            raise SourceEnded
        asked, self._asked = self._asked, time.perf_counter()
        deadline = self._asked + timeout
        if len(self._open) == 0 and not self._take(timeout):
            return None
        if np.isnan(self._since):
            # The clock starts when somebody listens and there is something to hear.
            self._since = time.perf_counter()
        due, now = self._when(self._given), time.perf_counter()
        if now - asked > HALTED and now > due:
            self._since += now - due  # nobody listened meanwhile: its time stood still
            due = now
        if due > now:
            if self._closed.wait(min(due, deadline) - now if deadline > now else 0.0):
                raise SourceEnded
            now = time.perf_counter()
            if due > now:
                return None
        return self._give(now)

    def close(self) -> None:
        """End it; a waiting `read` is told."""
        self._closed.set()
        self._made.end(SourceEnded(), at_once=True)
        self._worker.join()

    def _when(self, sample: int) -> float:
        """When a sample is due, by `perf_counter`; at once where no clock paces it."""
        return self._since + sample / (self._info.rate * self._speed)

    def _give(self, now: float) -> Block:
        count = len(self._open)
        if np.isfinite(self._speed):
            passed = int((now - self._since) * self._info.rate * self._speed) + 1
            count = min(count, max(passed - self._given, 1))
        count = int(min(count, np.ceil(self._last - self._given)))
        values, self._open = self._open[:count], self._open[count:]
        times = (self._given + np.arange(count)) / self._info.rate
        arrived = self._when(self._given + count - 1) if np.isfinite(self._speed) else now
        self._given += count
        return Block(times, values, min(arrived, now))

    def _take(self, timeout: float) -> bool:
        """Open the next chunk, if one is made within the time."""
        made = self._made.take(max(timeout, 1e-3))
        if made is None:
            return False
        self._open = made
        return True

    def _work(self) -> None:
        try:
            while True:
                made = self._touching.make(self._chunk)
                if self._info.kind == "raw":
                    made = np.uint8(REST) - np.minimum(made, np.uint8(REST))
                self._made.put(made)
        except Exception as error:  # noqa: BLE001 - raised to whoever reads; closing ends it too
            self._made.end(error)

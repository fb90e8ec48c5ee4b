"""Endless simulated touches as a live source: seeded, on chosen parts, at any pace."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.live.bounded_queue import BoundedQueue
from skinmap.live.sources.source import (
    SIMULATION,
    Block,
    Kind,
    Source,
    SourceEnded,
    StreamInfo,
    describe_skins,
)
from skinmap.skin.robot import Robot
from skinmap.touch.simulation.gestures import FOUR
from skinmap.touch.simulation.hands import gesture_set
from skinmap.touch.simulation.simulator import (
    GAP,
    MISSES,
    SUBJECTS,
    Stage,
    loads_over_time,
    place,
    prepare,
)
from skinmap.touch.simulation.variety import DEFAULT, Sensing, Subject, draw_sensing, draw_subjects

REST = 240  # what an iCub's taxel sends untouched; less is harder [counts]
CHUNK = 0.25  # samples are made so far in one go [s]
HALTED = 1.0  # without a call of `read` for so long, the simulation stands still [s]
AHEAD = 4  # chunks made before they are wanted

PAUSE = 0.4  # mean time between the beginnings of two touches that may overlap [s]
TOGETHER = 2  # touches at once, each on its own part
REMEMBERED = 1000  # touches kept in `truth`


class TrueTouch(NamedTuple):
    """A touch that was simulated.

    Attributes
    ----------
    part, label : str
    began, ended : float
        In the source's clock [s].
    """

    part: str
    label: str
    began: float
    ended: float


@dataclass(slots=True)
class _Playing:
    """A touch that lasts: its part, its loads (t, n) and the sample that it began with."""

    row: int
    loads: FloatArray
    began: int


class MadeSource(Source):
    """Samples that are made ahead in a thread and given out by the clock.

    Parameters
    ----------
    info : StreamInfo
    make : callable
        Gives so many next samples (count, channels), 0 at rest to 255.
    truth : deque of TrueTouch
        What was simulated; filled by `make`.
    speed : float
        Speed as a multiple of the clock's; `inf` gives samples as soon as they are read.
    seconds : float
        It ends after so long; never by default.

    Notes
    -----
    Nothing is left out: a reader that comes late gets all samples that are due. Where nobody reads
    for a second its time stands still.
    """

    def __init__(
        self,
        info: StreamInfo,
        make: Callable[[int], NDArray[np.uint8]],
        truth: deque[TrueTouch],
        *,
        speed: float,
        seconds: float = float("inf"),
    ) -> None:
        if not speed > 0:
            raise InvalidArrayError(f"speed must be above 0, got {speed}")
        super().__init__(info)
        self._make, self._truth = make, truth
        self._speed = float(speed)
        self._last = seconds * info.rate
        self._chunk = max(1, round(CHUNK * info.rate))
        self._made: BoundedQueue[NDArray[np.uint8]] = BoundedQueue(AHEAD)
        self._closed = threading.Event()
        self._worker = threading.Thread(target=self._work, name="simulator", daemon=True)
        self._open = np.zeros((0, self._info.channels), np.uint8)
        self._given = 0
        self._since = self._asked = float("nan")  # the first sample, and the last call of `read`
        self._worker.start()

    @property
    def speed(self) -> float:
        """Speed as a multiple of the clock's."""
        return self._speed

    @property
    def truth(self) -> tuple[TrueTouch, ...]:
        """What was simulated, the last thousand touches; some may still be to come."""
        return tuple(self._truth)

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
        if len(self._open) == 0:
            made = self._made.take(max(timeout, 1e-3))
            if made is None:
                return None
            self._open = made
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

    def _work(self) -> None:
        try:
            while True:
                made = self._make(self._chunk)
                if self._info.kind == "raw":
                    made = np.uint8(REST) - np.minimum(made, np.uint8(REST))
                self._made.put(made)
        except Exception as error:  # noqa: BLE001 - raised to whoever reads; closing ends it too
            self._made.end(error)


class SimulatedSource(MadeSource):
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
        Speed as a multiple of the clock's; `inf` gives samples as soon as they are read.
    kind : {"pressure", "raw"}
        Raw values are 240 at rest and fall under load, as the iCub sends them.
    gestures : sequence of str
    sensing : Sensing, optional
        How taxels answer, at its own rate; drawn for each part as the variety says by default.
    variety : float
        How far touches are drawn at random, see `skinmap.touch.simulation.variety`.
    seconds : float
        It ends after so long; never by default.
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
        variety: float = DEFAULT,
        seconds: float = float("inf"),
    ) -> None:
        gestures = gesture_set(gestures)
        self._rate = Sensing(rate=rate).rate if sensing is None else sensing.rate
        self._rng, self._gestures = np.random.default_rng(seed), gestures
        self._people: tuple[Subject, ...] = draw_subjects(SUBJECTS, rng=self._rng)
        self._stages: list[Stage] = []
        for part in dict.fromkeys(parts or robot.parts):
            answers = sensing or draw_sensing(variety, rng=self._rng, rate=self._rate)
            stage = prepare(robot.skin(part), rng=self._rng, sensing=answers, variety=variety)
            self._stages.append(stage)
        self._playing: list[_Playing] = []
        self._free_at = [0] * len(self._stages)
        self._next = self._now = 0
        self._misses = [dict.fromkeys(gestures, 0) for _ in self._stages]
        skins = [stage.skin for stage in self._stages]
        info = describe_skins("simulation", robot.name, skins, self._rate, kind, SIMULATION)
        truth: deque[TrueTouch] = deque(maxlen=REMEMBERED)
        super().__init__(info, self._simulate, truth, speed=speed, seconds=seconds)

    def _simulate(self, count: int) -> NDArray[np.uint8]:
        while self._next < self._now + count:
            self._begin(self._next)
            self._next += max(1, round(float(self._rng.exponential(PAUSE)) * self._rate))
        columns = []
        for row, stage in enumerate(self._stages):
            loads = np.zeros((count, len(stage.skin)))
            for touch in [one for one in self._playing if one.row == row]:
                first = touch.began - self._now
                start, stop = max(first, 0), min(first + len(touch.loads), count)
                if start < stop:
                    loads[start:stop] += touch.loads[start - first : stop - first]
            columns.append(stage.sensors.read(loads, rng=self._rng))
        self._now += count
        self._playing = [one for one in self._playing if one.began + len(one.loads) > self._now]
        return np.concatenate(columns, axis=1)

    def _begin(self, sample: int) -> None:
        """Let a touch begin at a sample, if a part is free and a place is found."""
        lasting = sum(one.began + len(one.loads) > sample for one in self._playing)
        free = [row for row in range(len(self._stages)) if self._free_at[row] <= sample]
        if lasting >= TOGETHER or not free:
            return
        row = free[int(self._rng.integers(len(free)))]
        label = self._gestures[int(self._rng.integers(len(self._gestures)))]
        who = self._people[int(self._rng.integers(len(self._people)))]
        if self._misses[row][label] >= MISSES:
            return
        stage = self._stages[row]
        placed = place(stage, label, who, rng=self._rng)
        if placed is None:
            self._misses[row][label] += 1
            return
        loads = loads_over_time(placed, self._rate, self._rng)
        self._playing.append(_Playing(row, loads, sample))
        self._free_at[row] = sample + len(loads) + round(GAP * self._rate)
        ended = (sample + len(loads)) / self._rate
        self._truth.append(TrueTouch(stage.skin.part, label, sample / self._rate, ended))

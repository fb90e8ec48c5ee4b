"""Simulated touches on several parts without end, chunk by chunk."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.skin.robot import Robot
from skinmap.touch.gestures import FOUR
from skinmap.touch.sensing import Sensing
from skinmap.touch.simulator import (
    GAP,
    MISSES,
    SUBJECTS,
    Stage,
    check_gestures,
    loads_over_time,
    place,
    prepare,
)
from skinmap.touch.subjects import Subject, draw_subjects

PAUSE = 0.4  # mean time between the beginnings of two touches that may overlap [s]
REMEMBERED = 1000  # touches kept in `truth`


@dataclass(frozen=True, slots=True)
class TrueTouch:
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


class Touching:
    """Makes samples of several parts, chunk by chunk; the same ones for the same seed.

    Parameters
    ----------
    robot : Robot
    parts : sequence of str
    rng : numpy.random.Generator
    sensing : Sensing
    gestures : sequence of str
    together : int
        Touches at once, each on its own part.
    """

    def __init__(
        self,
        robot: Robot,
        parts: Sequence[str],
        *,
        rng: np.random.Generator,
        sensing: Sensing,
        gestures: Sequence[str] = FOUR,
        together: int = 2,
    ) -> None:
        check_gestures(gestures)
        self._rng, self._gestures, self._together = rng, tuple(gestures), together
        self._people: tuple[Subject, ...] = draw_subjects(SUBJECTS, rng=rng)
        self._stages: list[Stage] = [
            prepare(robot.skin(part), rng=rng, sensing=sensing) for part in parts
        ]
        self._rate = sensing.rate
        self._playing: list[_Playing] = []
        self._free_at = [0] * len(parts)
        self._next = 0
        self._now = 0
        self._misses = [dict.fromkeys(gestures, 0) for _ in parts]
        self.truth: deque[TrueTouch] = deque(maxlen=REMEMBERED)

    def make(self, count: int) -> NDArray[np.uint8]:
        """The next samples (count, channels), 0 at rest to 255."""
        while self._next < self._now + count:
            self._begin(self._next)
            pause = max(1, round(float(self._rng.exponential(PAUSE)) * self._rate))
            self._next += pause
        columns = []
        for row, stage in enumerate(self._stages):
            loads = np.zeros((count, len(stage.skin)))
            for touch in self._playing:
                if touch.row == row:
                    self._add(touch, loads)
            columns.append(stage.sensors.read(loads, rng=self._rng))
        self._now += count
        self._playing = [one for one in self._playing if one.began + len(one.loads) > self._now]
        return np.concatenate(columns, axis=1)

    def _add(self, touch: _Playing, loads: FloatArray) -> None:
        first = touch.began - self._now
        start, stop = max(first, 0), min(first + len(touch.loads), len(loads))
        if start < stop:
            loads[start:stop] += touch.loads[start - first : stop - first]

    def _begin(self, sample: int) -> None:
        """Let a touch begin at a sample, if a part is free and a place is found."""
        lasting = sum(one.began + len(one.loads) > sample for one in self._playing)
        free = [row for row in range(len(self._stages)) if self._free_at[row] <= sample]
        if lasting >= self._together or not free:
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
        self.truth.append(TrueTouch(stage.skin.part, label, sample / self._rate, ended))

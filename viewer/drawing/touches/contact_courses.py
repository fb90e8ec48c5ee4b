"""How contacts went over the last seconds: their force, their area, how quickly they moved."""

from __future__ import annotations

from collections import deque
from typing import Literal, get_args

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.live.moment import Moment

Course = Literal["force", "area", "speed"]
COURSES: tuple[Course, ...] = get_args(Course)
UNITS = {"force": "N", "area": "mm2", "speed": "mm/s"}
SECONDS = 10.0  # that are kept
SAMPLES = 500  # at most
PAST = 0.1  # a speed is taken over so long [s]: centres jump from taxel to taxel


class ContactCourses:
    """Numbers of the touches of the last seconds; never grows."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, dict[tuple[str, int], tuple[float, ...]]]] = deque()

    def add(self, moment: Moment) -> None:
        """Keep what a moment says of its touches."""
        time = moment.time
        if not np.isfinite(time) or moment.stale:
            return
        if self._rows and time <= self._rows[-1][0]:
            if time == self._rows[-1][0]:
                return
            self._rows.clear()  # led back: what came later is not true yet
        self._rows.append(
            (
                time,
                {
                    (touch.part, touch.identity): (
                        np.nan if touch.force is None else touch.force,
                        touch.peak,
                        1e6 * touch.area,
                        *np.asarray(touch.centre, np.float64).tolist(),
                    )
                    for touch in moment.touches
                },
            )
        )
        while len(self._rows) > SAMPLES or time - self._rows[0][0] > SECONDS:
            self._rows.popleft()

    def show(self, course: Course, most: int) -> tuple[FloatArray, FloatArray, list[str], str]:
        """Times (t,) [s], values (t, k), names of the k contacts felt last, and the unit.

        Where no force is known, the largest pressure stands in its place.
        """
        times = np.array([time for time, _ in self._rows])
        seen: dict[tuple[str, int], None] = {}
        for _, row in reversed(self._rows):
            seen.update(dict.fromkeys(row))
        keys = list(seen)[:most]
        table = np.full((len(times), len(keys), 6), np.nan)
        for k, (_, row) in enumerate(self._rows):
            for column, key in enumerate(keys):
                if key in row:
                    table[k, column] = row[key]
        names = [part.replace("_", " ") for part, _ in keys]
        if course == "area":
            return times, table[..., 2], names, UNITS["area"]
        if course == "speed":
            return times, speeds(times, table[..., 3:]), names, UNITS["speed"]
        if np.isfinite(table[..., 0]).any():
            return times, table[..., 0], names, UNITS["force"]
        return times, table[..., 1], names, "counts"


def speeds(times: FloatArray, centres: FloatArray) -> FloatArray:
    """(t, k) speeds [mm/s] of centres (t, k, 3) [m] at times (t,) [s]; NaN where none is known."""
    if not len(times):
        return np.zeros(centres.shape[:2])
    before = np.maximum(np.searchsorted(times, times - PAST - 1e-9), 0)
    gap = times - times[before]
    way = np.linalg.norm(centres - centres[before], axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(1e3 * way / np.where(gap > 0, gap, np.nan)[:, None])

"""Moments for whoever draws: the newest handed over, those of the last minute to go back to."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.live.moment import Moment

MINUTE = 60.0  # that is remembered [s]
MEMORY = 64_000_000  # bytes at most: a minute of the whole iCub at 50 Hz, in float32
LENGTH = 6000  # moments, however small they are


class Outlet:
    """One moment at a time, with its number and age.

    Parameters
    ----------
    clock : callable
        Seconds of this machine.

    Attributes
    ----------
    news : threading.Condition
        Guards the rest, may be entered again by who holds it; told of each new moment.
    moment : Moment or None
        What is to be shown; None before the first sample.
    number : int
        Changes with each new moment to be shown.
    oldest : float
        Largest age of a moment when it was taken to be drawn [s].
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.clock = clock
        self.news = threading.Condition()
        self.moment: Moment | None = None
        self.number = 0
        self.oldest = 0.0
        self._taken = 0
        self._closed = False
        self._arrived = math.nan  # when what is to be shown came, in the clock's seconds
        self._drawn = math.nan  # when what was taken came

    @property
    def age(self) -> float:
        """How long ago the sample arrived that was taken last [s]; NaN before the first."""
        return self.clock() - self._drawn

    def show(self, moment: Moment, *, fresh: bool = False) -> None:
        """Put a moment there: one that has just come, or one of the past."""
        with self.news:
            if fresh:
                late = moment.latency if math.isfinite(moment.latency) else 0.0
                self._arrived = self.clock() - late
            self.moment = moment
            self.tell()

    def tell(self) -> None:
        """Wake who waits: something has changed."""
        with self.news:
            self.number += 1
            self.news.notify_all()

    def take(self, *, live: bool) -> Moment | None:
        """What is to be shown, None where nothing has changed since the last call."""
        with self.news:
            if self.number == self._taken:
                return None
            self._taken, self._drawn = self.number, self._arrived
            if live and self.moment is not None and not self.moment.stale:
                self.oldest = max(self.oldest, self.age)
            return self.moment

    def wait(self, number: int, timeout: float) -> bool:
        """Wait until something else than `number` is to be shown; False after `timeout` [s]."""
        with self.news:
            return self.news.wait_for(lambda: self.number != number or self._closed, timeout)

    def close(self) -> None:
        """Release all waiting threads."""
        with self.news:
            self._closed = True
            self.news.notify_all()


class History:
    """The last moments, oldest first, in as few bytes as their numbers need."""

    def __init__(self) -> None:
        self._moments: deque[Moment] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._moments)

    @property
    def newest(self) -> Moment | None:
        """The latest moments."""
        return self._moments[-1] if self._moments else None

    @property
    def oldest(self) -> Moment | None:
        """The earliest moment that is remembered."""
        return self._moments[0] if self._moments else None

    def moments(self) -> tuple[Moment, ...]:
        """All that is remembered, oldest first."""
        return tuple(self._moments)

    def add(self, moment: Moment) -> None:
        """Remember a moment, and forget the oldest where it gets too much."""
        kept = replace(moment, pressures=small(moment.pressures), raw=small(moment.raw))
        self._moments.append(kept)
        self._bytes += size(kept)
        while len(self._moments) > 2 and (
            len(self._moments) > LENGTH
            or self._bytes > MEMORY
            or kept.time - self._moments[0].time > MINUTE
        ):
            self._bytes -= size(self._moments.popleft())

    def clear(self) -> None:
        """Forget everything."""
        self._moments.clear()
        self._bytes = 0


class Past:
    """Moments to step through while the picture is halted, from the newest backwards.

    Parameters
    ----------
    moments : tuple of Moment
        Oldest first.
    """

    def __init__(self, moments: tuple[Moment, ...] = ()) -> None:
        self._moments = moments
        self._cursor = len(moments) - 1

    @property
    def newest(self) -> bool:
        """Whether nothing newer is remembered than what is shown."""
        return self._cursor >= len(self._moments) - 1

    def step(self, count: int) -> Moment | None:
        """The moment `count` later (negative: earlier); None where none is remembered."""
        goal = self._cursor + count
        if not 0 <= goal < len(self._moments):
            return None
        self._cursor = goal
        return self._moments[goal]

    def at(self, time: float) -> Moment | None:
        """The moment nearest to a time [s]; None where nothing is remembered."""
        if not self._moments:
            return None
        self._cursor = min(
            range(len(self._moments)), key=lambda k: abs(self._moments[k].time - time)
        )
        return self._moments[self._cursor]


def small(values: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays as bytes where they hold whole counts, else in single precision."""
    found = {}
    for part, array in values.items():
        own = np.asarray(array)
        if own.dtype == np.uint8:
            found[part] = own
            continue
        with np.errstate(invalid="ignore"):
            counts = own.astype(np.uint8)
        found[part] = counts if np.array_equal(counts, own) else own.astype(np.float32)
    return found


def size(moment: Moment) -> int:
    """Bytes of the moment's arrays."""
    return sum(v.nbytes for v in moment.pressures.values()) + sum(
        v.nbytes for v in moment.raw.values()
    )

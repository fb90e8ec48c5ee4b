"""Hand-over of the newest moment from the player's thread to the drawing one."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from skinmap.live.moment import Moment


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

"""Blocks from a source that may fall silent and come back."""

from __future__ import annotations

import time
from collections import deque

import numpy as np

from skinmap.live.sources.source import (
    SIMULATION,
    Block,
    Counts,
    Source,
    StreamInfo,
)

STALE = 0.5  # seconds without a sample that are shown; a source slower than that has three periods
ARRIVALS = 64  # blocks that the present rate is taken from


class Feed:
    """Reads a source and notices that nothing comes.

    Parameters
    ----------
    source : Source
    counts : Counts
        That it adds to.

    Attributes
    ----------
    stale : bool
        Whether nothing has come for a while.
    arrived : float
        `perf_counter` when the newest sample came [s].
    """

    def __init__(self, source: Source, counts: Counts) -> None:
        self.source, self._counts = source, counts
        self.stale = False
        self.arrived = time.perf_counter()
        self._heard = float("nan")  # until somebody listens
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=ARRIVALS)
        self._came = 0
        self._speed = 1.0  # that the arrivals were at

    @property
    def info(self) -> StreamInfo:
        """What the source says of itself."""
        return self.source.info

    @property
    def rate(self) -> float:
        """Samples a second that came lately; 0 where none comes, NaN where unknown."""
        if self.stale:
            return 0.0
        if len(self._arrivals) < 2 or np.isinf(self._speed):
            return float("nan")
        (first, before), (last, after) = self._arrivals[0], self._arrivals[-1]
        return (after - before) / (last - first) if last > first else float("nan")

    def read(self, timeout: float) -> Block | None:
        """What has come; waits `timeout` [s] at most, and no longer than until it is stale.

        Raises
        ------
        SourceEnded
            A recording is over.
        UnreachableError
            The source died for good.
        """
        if np.isnan(self._heard):
            self._heard = time.perf_counter()
        until_stale = self._heard + self._patience() - time.perf_counter()
        wait = timeout if self.stale else min(timeout, max(until_stale, 0.0))
        block = self.source.read(wait)
        if block is not None:
            self.stale = False
            if self.source.speed != self._speed:
                self._speed = self.source.speed
                self._arrivals.clear()  # a rate over two speeds is that of neither
            self._heard, self.arrived = time.perf_counter(), block.arrived
            self._came += len(block)
            self._arrivals.append((block.arrived, self._came))
        return block

    def falls_silent(self) -> bool:
        """Whether nothing has come for too long, told once."""
        if self.stale or time.perf_counter() - self._heard < self._patience():
            return False
        self.stale = True
        self._counts.stale += self._came > 0  # what has not begun is not interrupted
        return True

    def _patience(self) -> float:
        """Seconds without a sample after which the source is called stale."""
        speed = self.source.speed
        # What is made when it is asked for is never silent, only slow.
        if speed == 0.0 or self.info.clock == SIMULATION:
            return float("inf")
        rate = self.info.rate * speed
        return max(STALE, 3.0 / rate) if rate > 0 else STALE

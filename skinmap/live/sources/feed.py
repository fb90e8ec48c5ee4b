"""Blocks from a source that may fall silent, die and come back."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from skinmap.errors import SkinMismatchError, UnreachableError
from skinmap.live.sources.source import (
    SIMULATION,
    Block,
    Counts,
    Source,
    StreamInfo,
    as_source,
    check_skin,
)
from skinmap.skin.robot import Robot

STALE = 0.5  # seconds without a sample that are shown; a source slower than that has three periods
RETRY = 0.5  # between two tries to open a dead source again [s]
ARRIVALS = 64  # blocks that the present rate is taken from
logger = logging.getLogger(__name__)


class Feed:
    """Reads a source, notices that nothing comes, and opens it again where it died.

    Parameters
    ----------
    robot : Robot
    source : Source
    counts : Counts
        That it adds to.
    reopen : callable, optional
        Opens the source again where it died for good.

    Attributes
    ----------
    stale : bool
        Whether nothing has come for a while.
    arrived : float
        `perf_counter` when the newest sample came [s].
    """

    def __init__(
        self,
        robot: Robot,
        source: Source,
        counts: Counts,
        reopen: Callable[[], Source] | None = None,
    ) -> None:
        self.source = as_source(source)
        self._robot, self._counts, self._reopen = robot, counts, reopen
        self.stale = False
        self.arrived = time.perf_counter()
        self._heard = float("nan")  # until somebody listens
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=ARRIVALS)
        self._came = 0
        self._speed = 1.0  # that the arrivals were at
        self._dead = False
        self._next_try = 0.0

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
            The source died, and nobody said how to open it again.
        SkinMismatchError
            It came back with another skin.
        """
        if self._dead and not self._revive(timeout):
            return None
        if np.isnan(self._heard):
            self._heard = time.perf_counter()
        until_stale = self._heard + self._patience() - time.perf_counter()
        wait = timeout if self.stale else min(timeout, max(until_stale, 0.0))
        try:
            block = self.source.read(wait)
        except UnreachableError:
            if self._reopen is None:
                raise
            logger.warning("source %r died; trying to open it again", self.info.name)
            self._dead, self._next_try = True, 0.0
            return None
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
        if self.stale:
            return False
        if not self._dead and time.perf_counter() - self._heard < self._patience():
            return False
        self.stale = True
        self._counts.stale += self._came > 0  # what has not begun is not interrupted
        return True

    def _revive(self, timeout: float) -> bool:
        """Open a dead source again, no more than twice a second."""
        wait = self._next_try - time.perf_counter()
        if wait > 0:
            time.sleep(min(wait, timeout))
            if wait > timeout:
                return False
        self._next_try = time.perf_counter() + RETRY
        self.source.close()
        try:
            source = self.source if self._reopen is None else as_source(self._reopen())
        except UnreachableError:
            return False
        if (source.info.parts, source.info.widths) != (self.info.parts, self.info.widths):
            source.close()
            raise SkinMismatchError(f"stream {source.info.name!r} came back with another skin")
        check_skin(source.info, self._robot)
        self.source, self._dead = source, False
        self._counts.reconnects += 1
        return True

    def _patience(self) -> float:
        """Seconds without a sample after which the source is called stale."""
        speed = self.source.speed
        # What is made when it is asked for is never silent, only slow.
        if speed == 0.0 or self.info.clock == SIMULATION:
            return float("inf")
        rate = self.info.rate * speed
        return max(STALE, 3.0 / rate) if rate > 0 else STALE

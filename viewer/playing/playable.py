"""What a player plays: a touch loop on a recording or a live source, or moments of any origin."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterable, Iterator
from typing import Any, Protocol, runtime_checkable

from skinmap.live.moment import Moment
from skinmap.live.sources.source import Seekable, Source, SourceEnded, is_live
from viewer.playing.stepwise import Stepwise

HURRY = 25.0  # speed through samples that are only listened to, where none can be had singly
PERIOD = 0.02  # between two samples where nobody says it [s]


@runtime_checkable
class Stepping(Protocol):
    """What is needed of a touch loop."""

    @property
    def source(self) -> Source:
        """Where its samples come from."""

    def step(self, timeout: float) -> Moment | None:
        """The next moment; None where nothing comes within `timeout` [s]."""

    def close(self) -> None:
        """Give threads, sockets and files back."""


class Feed(Protocol):
    """Moments one by one, at a pace."""

    loop: bool

    @property
    def seekable(self) -> bool:
        """Whether it can be led through time."""

    @property
    def halts(self) -> bool:
        """Whether it waits between requests; live sources do not."""

    @property
    def paced(self) -> bool:
        """Whether it can be played quicker and slower."""

    @property
    def duration(self) -> float:
        """[s]; NaN where it has none."""

    @property
    def period(self) -> float:
        """Between two samples [s]."""

    def step(self, timeout: float, wake: threading.Event) -> Moment | None:
        """The next moment; None after `timeout` [s] or when woken. `SourceEnded` at the end."""

    def seek(self, seconds: float) -> None:
        """Go on from there."""

    def pace(self, speed: float, *, halted: bool, hurried: bool) -> None:
        """How quick moments come from now on."""

    def close(self) -> None:
        """Give everything back."""


def feed_of(moments: Any) -> Feed:
    """What plays a touch loop or an iterable of moments."""
    if isinstance(moments, Stepping):
        return LoopFeed(moments)
    if isinstance(moments, Iterable):
        return MomentFeed(moments)
    feed: Feed = moments
    return feed


class LoopFeed:
    """Moments of a touch loop; a recording's pace is its source's."""

    def __init__(self, loop: Stepping) -> None:
        self.touches = loop
        source = loop.source
        self._recording = source if isinstance(source, Seekable) else None
        rate = source.info.rate
        self.period = 1.0 / rate if rate > 0 else PERIOD

    @property
    def seekable(self) -> bool:
        """A recording, or anything else that can be led through time."""
        return self._recording is not None

    @property
    def halts(self) -> bool:
        """Recordings and the simulator wait."""
        return not is_live(self.touches.source)

    @property
    def paced(self) -> bool:
        """A recording."""
        return self._recording is not None

    @property
    def duration(self) -> float:
        """Of the recording [s]."""
        return math.nan if self._recording is None else self._recording.duration

    @property
    def loop(self) -> bool:
        """Whether the recording starts again at its end."""
        return self._recording is not None and self._recording.loop

    @loop.setter
    def loop(self, loop: bool) -> None:
        if self._recording is not None:
            self._recording.loop = loop

    def step(self, timeout: float, wake: threading.Event) -> Moment | None:
        """The loop's next moment."""
        return self.touches.step(timeout)

    def seek(self, seconds: float) -> None:
        """Lead the recording."""
        if self._recording is not None:
            # The loop's own, where it has one: it lets go of what was touched before.
            getattr(self.touches, "seek", self._recording.seek)(seconds)

    def pace(self, speed: float, *, halted: bool, hurried: bool) -> None:
        """Set the recording's speed."""
        if self._recording is not None:
            quick = math.inf if isinstance(self._recording, Stepwise) else HURRY
            wanted = 0.0 if halted else quick if hurried else speed
            if self._recording.speed != wanted:
                self._recording.speed = wanted

    def close(self) -> None:
        """Close the loop, and with it the source."""
        self.touches.close()


class MomentFeed:
    """Moments of an iterable, shown when their time comes.

    A sequence can be led through time, an iterator only goes on.
    """

    def __init__(self, moments: Iterable[Moment]) -> None:
        self._moments = moments if isinstance(moments, list | tuple) else None
        self._iterator: Iterator[Moment] = iter(moments)
        self._next: Moment | None = None
        self._last: Moment | None = None
        self._due = math.nan  # when the next is to be shown, in perf_counter's seconds
        self._speed = 1.0
        self.loop = False
        self.period = PERIOD
        if self._moments is not None and len(self._moments) > 1:
            self.period = (self._moments[-1].time - self._moments[0].time) / (
                len(self._moments) - 1
            )

    @property
    def seekable(self) -> bool:
        """A sequence."""
        return self._moments is not None

    @property
    def halts(self) -> bool:
        """Nothing comes unless it is asked for."""
        return True

    @property
    def paced(self) -> bool:
        """Always."""
        return True

    @property
    def duration(self) -> float:
        """From the first moment to the last [s]."""
        if not self._moments:
            return math.nan
        return self._moments[-1].time - self._moments[0].time

    def step(self, timeout: float, wake: threading.Event) -> Moment | None:
        """The next moment when its time has come."""
        if self._next is None:
            self._next = next(self._iterator, None)
            if self._next is None and self.loop and self._moments:
                self._iterator, self._last = iter(self._moments), None
                self._next = next(self._iterator, None)
            if self._next is None:
                raise SourceEnded
            gap = 0.0 if self._last is None else self._next.time - self._last.time
            now = time.perf_counter()
            due = self._due if math.isfinite(self._due) else now
            # After a halt there is no rush to catch up.
            self._due = max(due + max(gap, 0.0) / self._speed, now - 5 * self.period)
        wait = self._due - time.perf_counter()
        if wait > 0 and wake.wait(min(wait, timeout)):
            return None
        if time.perf_counter() < self._due:
            return None
        self._last, self._next = self._next, None
        return self._last

    def seek(self, seconds: float) -> None:
        """Go on with the first moment at or after a time."""
        if not self._moments:
            return
        start = self._moments[0].time + seconds - self.period / 2
        later = [moment for moment in self._moments if moment.time >= start]
        self._iterator = iter(later or self._moments[-1:])
        self._next = self._last = None
        self._due = math.nan

    def pace(self, speed: float, *, halted: bool, hurried: bool) -> None:
        """Set the speed of what comes next."""
        wanted = math.inf if hurried else speed
        if halted or wanted != self._speed:
            self._due = math.nan
        self._speed = wanted

    def close(self) -> None:
        """End a generator."""
        close = getattr(self._iterator, "close", None)
        if close is not None:
            close()

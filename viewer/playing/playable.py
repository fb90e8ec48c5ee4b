"""What a player plays: a touch loop on a recording or a live source, or moments of any origin."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterable, Iterator
from typing import Any, Protocol, runtime_checkable

from skinmap.live.moment import Moment
from skinmap.live.sources.source import Block, Relay, Seekable, Source, SourceEnded, is_live

HURRY = 25.0  # speed through samples that are only listened to, where none can be had singly
PERIOD = 0.02  # between two samples where nobody says it [s]


class Stepwise(Relay, Seekable):
    """A recording that gives single samples while it is hurried: a `Seekable`.

    What a player seeks for, or steps to, is then met to the sample.
    """

    def __init__(self, recording: Seekable) -> None:
        super().__init__(recording)
        self._recording = recording
        self._open: Block | None = None  # what was read ahead, and its next row
        self._row = 0
        self._origin = math.nan  # of its times, where its position is 0 [s]

    @property
    def speed(self) -> float:
        """How many times faster than recorded."""
        return self._recording.speed

    @speed.setter
    def speed(self, speed: float) -> None:
        if self._open is not None:
            # What was read ahead is read again, at its time.
            self._recording.seek(self.position)
            self._open = None
        self._recording.speed = speed

    @property
    def loop(self) -> bool:
        """Whether it starts again at its end."""
        return self._recording.loop

    @loop.setter
    def loop(self, loop: bool) -> None:
        self._recording.loop = loop

    @property
    def duration(self) -> float:
        """[s]."""
        return self._recording.duration

    @property
    def position(self) -> float:
        """Seconds from its beginning, of the sample that comes next."""
        if self._open is None:
            return self._recording.position
        return float(self._open.times[self._row]) - self._origin

    def read(self, timeout: float) -> Block | None:
        """The next sample while hurried, else all that is due."""
        if self._open is None:
            before = self._recording.position
            block = self._recording.read(timeout)
            if block is not None and math.isnan(self._origin):
                self._origin = float(block.times[0]) - before
            if block is None or len(block) <= 1 or not math.isinf(self.speed):
                return block
            self._open, self._row = block, 0
        block, row = self._open, self._row
        self._row += 1
        if self._row == len(block):
            self._open = None
        return Block(block.times[row : row + 1], block.values[row : row + 1], block.arrived)

    def seek(self, seconds: float) -> None:
        """Go on from there."""
        self._open = None
        self._recording.seek(seconds)


def stepwise(source: Source) -> Source:
    """The source as a player can lead it: recordings step by step, live sources as they are."""
    return Stepwise(source) if isinstance(source, Seekable) else source


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

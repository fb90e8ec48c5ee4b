"""Moments to be drawn: the newest one, those to go back to, and when what was touched."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.live.contacts.named_touch import UNNAMED, Moment
from viewer.colours import RIM, class_colour, touch_colour

MINUTE = 60.0  # that is remembered [s]
MEMORY = 64_000_000  # bytes at most: a minute of the whole iCub at 50 Hz, in float32
LENGTH = 6000  # moments, however small they are
MAX_SPANS = 20_000  # remembered; the oldest are forgotten first

MOST = 80  # moments that a file keeps: 8 s at 10 a second, some hundred kilobytes
EVERY = 0.1  # between two of them at first [s]


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

    def take(self) -> Moment | None:
        """What is to be shown, None where nothing has changed since the last call."""
        with self.news:
            if self.number == self._taken:
                return None
            self._taken, self._drawn = self.number, self._arrived
            if self.moment is not None and not self.moment.stale:
                self.oldest = max(self.oldest, self.age)  # which NaN leaves as it is
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
    """The last moments, oldest first, in as few bytes as their numbers need.

    Parameters
    ----------
    seconds : float
        How far it reaches back.
    most : int
        Moments, however small they are.
    spread : bool
        Whether moments that come too quickly are left out, rather than that old ones are forgotten
        early: for plots.
    """

    def __init__(
        self, seconds: float = MINUTE, most: int = LENGTH, *, spread: bool = False
    ) -> None:
        self._moments: deque[Moment] = deque()
        self._bytes = 0
        self._seconds, self._most, self._spread = seconds, most, spread

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
        if self._spread and self._moments and not self._wanted(moment):
            return
        pressures, raw = small(moment.pressures), small(moment.raw)
        kept = replace(moment, pressures=pressures, raw=raw, block=None)
        self._moments.append(kept)
        self._bytes += size(kept)
        while len(self._moments) > 2 and (
            len(self._moments) > self._most
            or self._bytes > MEMORY
            or kept.time - self._moments[0].time > self._seconds
        ):
            self._bytes -= size(self._moments.popleft())

    def _wanted(self, moment: Moment) -> bool:
        """Whether a moment comes long enough after the newest; all go where it comes before it."""
        newest = self._moments[-1]
        if moment.time < newest.time:  # led back: what came later is not true yet
            self.clear()
            return True
        most = min(self._most, MEMORY // max(size(newest), 1))
        return moment.time - newest.time >= 0.9 * self._seconds / most

    def clear(self) -> None:
        """Forget everything."""
        self._moments.clear()
        self._bytes = 0


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
    return sum(one.nbytes for one in (*moment.pressures.values(), *moment.raw.values()))


@dataclass(frozen=True, slots=True)
class Span:
    """One touch from its first sample to the last that was seen [s], in the moments' clock.

    `marked` ones are the recording's own; one without a part is a gap in which nothing is known.
    """

    part: str
    label: str
    began: float
    ended: float
    marked: bool = False
    colour: str = ""  # of the touch; of a mark that of its label

    def to_json(self, origin: float) -> list[Any]:
        """Beginning and end from the origin [s], colour, words, part, and whether it is a mark."""
        words = f"{self.label} on {self.part}" if self.part else self.label
        words = f"{words}, marked" if self.marked else words
        began, ended = round(self.began - origin, 3), round(self.ended - origin, 3)
        tint = (self.colour or class_colour(self.label)) if self.part else RIM
        return [began, ended, tint, words.replace("_", " "), self.part, self.marked]


class Timeline:
    """Spans of all touches that passed, however often a recording is led through them.

    Attributes
    ----------
    version : int
        Changes with each span that begins or gets another name.
    """

    def __init__(self) -> None:
        self.version = 0
        self._spans: dict[int, Span] = {}  # by a number of their own
        self._open: dict[tuple[str, int], int] = {}  # numbers of the touches seen last
        self._notes: tuple[Span, ...] = ()
        self._next = 0

    @classmethod
    def of(cls, moments: Iterable[Moment]) -> Timeline:
        """That of some moments."""
        made = cls()
        for moment in moments:
            made.see(moment)
        return made

    def note(self, spans: Iterable[Span]) -> None:
        """Keep the recording's own marks and gaps, instead of those of before."""
        self._notes = tuple(spans)
        self.version += 1

    def see(self, moment: Moment) -> None:
        """Take a moment in: what is known later of a touch counts more than what was before."""
        now: dict[tuple[str, int], int] = {}
        for touch in moment.touches:
            key = (touch.part, touch.identity)
            number = self._open.get(key)
            if number is None or number not in self._spans:
                number = self._number(touch.part, moment.time)
                if number is None:
                    number = self._add(Span(touch.part, touch.label, moment.time, moment.time))
            span, tint = self._spans[number], touch_colour(touch)
            if moment.time >= span.ended or span.label == UNNAMED:
                self.version += (span.label, span.colour) != (touch.label, tint)
                ended = max(span.ended, moment.time)
                named = replace(span, label=touch.label, ended=ended, colour=tint)
                self._spans[number] = named
            now[key] = number
        self.version += len(self._open.keys() - now.keys())
        self._open = now

    def fill(self, stretches: Iterable[tuple[str, float, float]]) -> None:
        """Note when parts are touched [s] that were not played yet: names come with playing."""
        known: dict[str, FloatArray] = {}
        for part, began, ended in stretches:
            if part not in known:
                own = [(one.began, one.ended) for one in self._spans.values() if one.part == part]
                known[part] = np.array(own).reshape(-1, 2)
            there = known[part]
            if not ((there[:, 0] <= ended) & (began <= there[:, 1])).any():
                self._add(Span(part, UNNAMED, began, ended))

    def settle(self, began: float, ended: float, found: Iterable[Span]) -> None:
        """Put touches with names in the place of those without that lie between two times [s]."""
        lasting = set(self._open.values())
        for number, one in list(self._spans.items()):
            inside = one.label == UNNAMED and began <= one.began and one.ended <= ended
            if inside and number not in lasting:
                del self._spans[number]
        for span in found:
            there = (one for one in self._spans.values() if one.part == span.part)
            if not any(one.began <= span.ended and span.began <= one.ended for one in there):
                self._add(span)
        self.version += 1

    def _add(self, span: Span) -> int:
        self._next += 1
        self._spans[self._next] = span
        self.version += 1
        while len(self._spans) > MAX_SPANS:
            del self._spans[next(iter(self._spans))]
        return self._next

    def _number(self, part: str, time: float) -> int | None:
        """The span that a touch was in when its time was played before."""
        taken = set(self._open.values())
        here = (k for k, one in self._spans.items() if one.part == part and k not in taken)
        return next((k for k in here if self._spans[k].began <= time <= self._spans[k].ended), None)

    def spans(self) -> tuple[Span, ...]:
        """Touches that were found, in the order in which they came."""
        return tuple(self._spans.values())

    def every(self) -> tuple[Span, ...]:
        """Marks and gaps of the recording, and these."""
        return (*self._notes, *self.spans())


class Excerpt:
    """Keeps some of the moments that pass; each time it is full, every second is forgotten.

    Attributes
    ----------
    moments : list of Moment
    gap : float
        Time between two of them [s].
    """

    def __init__(self, most: int = MOST) -> None:
        self.moments: list[Moment] = []
        self.gap = EVERY
        self._most = most

    def watch(self, moments: Iterable[Moment]) -> Iterator[Moment]:
        """The same moments, looked at as they pass."""
        for moment in moments:
            self.add(moment)
            yield moment

    def add(self, moment: Moment) -> None:
        """Keep a moment if the last one kept is long enough ago."""
        if self.moments and moment.time < self.moments[-1].time + self.gap - 1e-6:
            return
        self.moments.append(moment)
        if len(self.moments) > self._most:
            self.moments = self.moments[::2]
            self.gap *= 2

    def around(self, chosen: Moment | None) -> tuple[list[Moment], int | None]:
        """What was kept with one more in its place, and which that is; nothing without it."""
        if chosen is None or not self.moments:
            return [], None
        kept = [moment for moment in self.moments if moment.time != chosen.time]
        place = sum(moment.time < chosen.time for moment in kept)
        return [*kept[:place], chosen, *kept[place:]], place

"""The player: the newest moment of a source, ready to draw, with pause, steps, seek and speed.

with Player(loop) as player:
    moment = player.take()      # None until something new is to be shown

A thread of its own takes moments in, so that a slow picture never holds up the samples; whoever
draws asks for the newest when it is ready. Nothing here knows what draws it.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterable
from typing import Self

from skinmap.errors import InvalidArrayError
from skinmap.live.moment import Moment
from skinmap.live.sources.source import SourceEnded
from viewer.playing.playable import Feed, feed_of
from viewer.playing.recent_moments import History, Outlet, Past, Timeline

WAIT = 0.1  # longest wait of the thread before it looks for requests again [s]
SPEEDS = (1 / 16, 16.0)  # slowest and quickest
LEAD = 0.6  # a seek starts so much earlier, unseen: touches are named from their past [s]
PATIENCE = 3.0  # for the thread to end when it is closed [s]


class Player:
    """Moments of a recording or a live source, one at a time.

    Live sources can be paused: the picture stays, samples go on, and what was seen last can be
    stepped through. Recordings halt, and can be led anywhere.

    Parameters
    ----------
    moments : TouchLoop or iterable of Moment
        What is played. An iterable is paced by the times of its moments.
    paused : bool
        Halt at the first moment.
    clock : callable
        Seconds of this machine, for the age of what is shown.
    """

    def __init__(
        self,
        moments: Feed | Iterable[Moment],
        *,
        paused: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._feed = feed_of(moments)
        self._outlet = Outlet(clock)
        self._news = self._outlet.news  # guards all below
        self._history = History()
        self._past = Past()
        self.timeline = Timeline()
        self._origin = math.nan  # time of the recording's beginning, in the moments' clock [s]
        self._paused = paused
        self._speed = 1.0
        self._asked: float | None = None  # where to go, in the moments' clock [s]
        self._until: float | None = None  # what comes before is not shown [s]
        self._more = 1 if paused else 0  # moments still to be shown while paused
        self._ended = False
        self._error: Exception | None = None
        self._worker = Worker(self._turn, self._fail)
        self._wake = self._worker.wake

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Begin to take moments in; more than once does no harm."""
        self._worker.start()

    def close(self) -> None:
        """End the thread and close what is played; may be called twice."""
        self._worker.close()
        self._feed.close()
        self._outlet.close()

    # What is shown.

    @property
    def moment(self) -> Moment | None:
        """What is to be shown now; None before the first sample."""
        return self._outlet.moment

    @property
    def number(self) -> int:
        """Changes with each new moment to be shown."""
        return self._outlet.number

    def take(self) -> Moment | None:
        """What is to be shown now, None where nothing has changed since the last call."""
        return self._outlet.take(live=not self._paused)

    def wait(self, number: int, timeout: float) -> bool:
        """Wait until something else than `number` is to be shown; False after `timeout` [s]."""
        return self._outlet.wait(number, timeout)

    @property
    def age(self) -> float:
        """How long ago the sample arrived that was taken last [s]; NaN where nothing is live."""
        shown = self.moment
        live = shown is not None and not (shown.stale or self._paused or self._ended)
        return self._outlet.age if live else math.nan

    @property
    def oldest(self) -> float:
        """Largest age of a moment when it was taken to be drawn [s]."""
        return self._outlet.oldest

    # Where it stands.

    @property
    def halts(self) -> bool:
        """Whether what is played waits while it is paused: a recording."""
        return self._feed.halts

    @property
    def seekable(self) -> bool:
        """Whether it can be led through time: a recording."""
        return self._feed.seekable

    @property
    def duration(self) -> float:
        """Of the recording [s]; NaN where there is none."""
        return self._feed.duration

    @property
    def position(self) -> float:
        """Of what is shown, from the recording's beginning [s]; 0 before the first moment."""
        if self._asked is not None:
            return max(0.0, self._asked - self._start)
        return 0.0 if self.moment is None else max(0.0, self.moment.time - self._start)

    @property
    def span(self) -> tuple[float, float]:
        """From when to when it can be led [s], as `position` counts; both 0 before anything came.

        The whole of a recording; of what is live, what is remembered of it.
        """
        if self.seekable:
            return 0.0, self.duration
        with self._news:
            first, last = self._history.oldest, self._history.newest
        if first is None or last is None:
            return 0.0, 0.0
        return first.time - self._start, last.time - self._start

    def spans(self) -> list[list[object]]:
        """Touches that were seen, as the pages get them: of what is live those of `span`."""
        with self._news:
            found = self.timeline.spans()
        first = self.span[0]
        return [s.to_json(self._start) for s in found if s.ended - self._start >= first]

    @property
    def ended(self) -> bool:
        """Whether nothing more will come without a seek."""
        return self._ended

    @property
    def error(self) -> Exception | None:
        """Why the source failed, if it did; the last moment stays."""
        return self._error

    @property
    def paused(self) -> bool:
        """Whether the picture is halted."""
        return self._paused

    # What can be asked for; False where the source cannot do it.

    def pause(self) -> None:
        """Halt the picture. A recording halts too, a live source goes on unseen."""
        with self._news:
            if not self._paused:
                self._paused = True
                self._past = Past(self._history.moments())
        self._wake.set()

    def play(self) -> None:
        """Go on: a live source with its newest sample, a recording from where it stands."""
        with self._news:
            if not (self._paused or self._ended):
                return
            self._paused = False
            if self.seekable and self.moment is not None:
                if not self._past.newest:
                    self._asked = self.moment.time
            elif (newest := self._history.newest) is not None:
                self._outlet.show(newest)
            self._past = Past()
        if self._ended and self.seekable:
            self.seek(0.0)
        self._wake.set()

    def toggle(self) -> None:
        """Pause or go on; at its end a recording begins again."""
        (self.play if self._paused or (self._ended and self.seekable) else self.pause)()

    def step(self, count: int) -> bool:
        """Halt, and show `count` samples later (negative: earlier)."""
        self.pause()
        with self._news:
            goal = self._until if self._asked is None else self._asked
            if goal is not None and self.seekable:  # on its way: from where it goes
                last = self._start + self.duration
                return self._ask(min(goal + count * self._feed.period, last))
            if (moment := self._past.step(count)) is not None:
                self._outlet.show(moment)
                return True
            shown, over = self.moment, self._ended and count > 0
            if shown is None or over or not self._feed.halts:
                return False
            if count < 0:
                return self._ask(shown.time + count * self._feed.period)
            self._more += count
        self._wake.set()
        return True

    def seek(self, seconds: float) -> bool:
        """Go to so many seconds from the beginning: of a recording, playing or halted.

        What is live is halted, and shown as far back as it is remembered.
        """
        if not math.isfinite(seconds):
            raise InvalidArrayError(f"seconds to go to must be a number, got {seconds}")
        if not self.seekable and not self._feed.paced:
            self.pause()
            with self._news:
                if (moment := self._past.at(self._start + seconds)) is None:
                    return False
                self._outlet.show(moment)
            return True
        with self._news:
            inside = min(max(seconds, 0.0), self.duration)
            return self._ask(self._start + inside)

    @property
    def speed(self) -> float:
        """How many times quicker than recorded; 1 for live sources."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        if not math.isfinite(speed) or speed <= 0:
            raise InvalidArrayError(f"speed must be above 0, got {speed}")
        if self._feed.paced:
            self._speed = min(max(speed, SPEEDS[0]), SPEEDS[1])
            self._wake.set()

    @property
    def loop(self) -> bool:
        """Whether a recording starts again at its end."""
        return self._feed.loop

    @loop.setter
    def loop(self, loop: bool) -> None:
        self._feed.loop = loop
        if loop and self._ended and not self._paused:
            self.seek(0.0)

    @property
    def _start(self) -> float:
        return 0.0 if math.isnan(self._origin) else self._origin

    def _ask(self, goal: float) -> bool:
        """Let the thread go to a time of the moments' clock."""
        if not self.seekable:
            return False
        self._asked = max(goal, self._start)
        self._wake.set()
        return True

    # The thread.

    def _fail(self, error: Exception) -> None:
        with self._news:
            self._error = error
            self._ended = True
            self._outlet.tell()

    def _turn(self) -> None:
        """One turn: requests first, then samples."""
        self._wake.clear()
        with self._news:
            self._obey()
            halted = self._halted()
        if halted or self._ended:
            self._wake.wait(WAIT)
            return
        with contextlib.suppress(SourceEnded):
            moment = self._feed.step(WAIT, self._wake)
            if moment is not None:
                self._take_in(moment)
            return
        with self._news:
            self._ended = self._asked is None
            if self._until is not None and self._history.newest is not None:
                self._until = None
                self._land(self._history.newest)
            self._outlet.tell()

    def _halted(self) -> bool:
        return self._paused and self._feed.halts and self._more == 0 and self._until is None

    def _obey(self) -> None:
        """Seek where that was asked for, and set the pace."""
        if self._asked is not None:
            first = max(self._start, self._asked - LEAD)
            self._feed.seek(first - self._start)
            self._until, self._asked = self._asked, None
            self._history.clear()
            self._past = Past()
            self._more, self._ended = 0, False
        single = self._until is not None or (self._paused and self._more > 0)
        self._feed.pace(self._speed, halted=self._halted(), hurried=single)

    def _take_in(self, moment: Moment) -> None:
        with self._news:
            if math.isnan(self._origin):
                self._origin = moment.time
            if self._asked is not None:
                return  # from before the jump that is asked for
            if self._until is not None:
                if moment.time < self._until - self._feed.period / 2:
                    self._history.add(moment)
                    self.timeline.see(moment)
                    return
                self._until = None
            elif self._paused and self._feed.halts:
                if self._more == 0:
                    return
                self._more -= 1
            self._history.add(moment)
            self.timeline.see(moment)
            if self._paused and not self._feed.halts and self.moment is not None:
                return
            self._land(moment)

    def _land(self, moment: Moment) -> None:
        """Show the newest moment of the history."""
        if self._paused:
            self._past = Past(self._history.moments())
        self._outlet.show(moment, fresh=True)


class Worker:
    """One thread of a player.

    Parameters
    ----------
    turn : callable
        Done again and again; it sleeps by waiting for `wake`.
    failed : callable
        Told what a turn raised, after which there is no other.

    Attributes
    ----------
    wake : threading.Event
        Set where a turn is to end early.
    """

    def __init__(self, turn: Callable[[], None], failed: Callable[[Exception], None]) -> None:
        self.wake = threading.Event()
        self._turn, self._failed = turn, failed
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> None:
        """Begin; more than once does no harm, and after `close` nothing begins."""
        if self._thread is None and not self._stop.is_set():
            self._thread = threading.Thread(target=self._run, name="player", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread; may be called twice."""
        self._stop.set()
        self.wake.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(PATIENCE)

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._turn()
        except Exception as error:  # noqa: BLE001 - told to whoever draws
            self._failed(error)

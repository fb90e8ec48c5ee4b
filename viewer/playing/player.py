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
from collections.abc import Iterable, Iterator
from typing import Any, Self

from skinmap.errors import InvalidArrayError
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import Seekable, SourceEnded, is_live
from viewer.playing.recent_moments import History, Outlet, Timeline

PERIOD = 0.02  # between two samples where the source states none [s]


WAIT = 0.1  # longest wait of the thread before it looks for requests again [s]
SPEEDS = (1 / 16, 16.0)  # slowest and quickest
FURTHEST = 20.0  # that a touch is followed back to its first sample [s]
BEFORE = 1.0  # of a jump's end, worked through at least: where was nothing touched? [s]
PATIENCE = 3.0  # for the thread to end when it is closed [s]


NEAR = 0.3  # a touch that begins so near to what is shown is the one that is shown [s]


def _recorded(name: str) -> Any:
    """A member of a feed's recording."""
    return property(lambda self: float(getattr(self._recording, name, math.nan)), doc="[s].")


class LoopFeed:
    """Moments of a touch loop; a recording's pace is its source's."""

    def __init__(self, loop: Any) -> None:
        self.touches = loop
        source = loop.source
        if isinstance(source, Playback):
            source.most = 1  # what it is led to is met to the sample
        self._recording = source if isinstance(source, Seekable) else None
        self.seekable = self.paced = self._recording is not None
        self.halts = not is_live(source)  # recordings and the simulator wait
        rate = source.info.rate
        self.period = 1.0 / rate if rate > 0 else PERIOD

    # Of the recording: how long it lasts, where the sample lies that comes next, and when it began
    # in the moments' clock [s]; NaN where there is none.
    duration, position, began = map(_recorded, ("duration", "position", "began"))

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

    def lead(self, seconds: float, before: float) -> tuple[list[Moment], float]:
        """Lead the recording to a time [s], with the names there that a straight play gives.

        What is touched there is named from its first sample: back to where nothing was touched,
        `FURTHEST` seconds at most. What is over by then needs no names, which take most of the
        time.

        Returns
        -------
        moments : list of Moment
            From `before` seconds earlier on, oldest first; the last one is that of the time.
        named : float
            From when on their touches have names [s].
        """
        if self._recording is None:
            return [], math.nan
        self.pace(1.0, halted=False, hurried=True)
        first, rests, moments = seconds, math.nan, list[Moment]()
        self._name(False)
        try:
            while math.isnan(rests) and seconds - first < FURTHEST:
                first = max(0.0, first - max(before, 1.0))
                moments, rests = self._replay(first, seconds)
                if first == 0.0:
                    rests = 0.0 if math.isnan(rests) else rests
        finally:
            self._name(True)
        if not moments or not moments[-1].touches:
            return moments, moments[-1].time if moments else math.nan
        named, _ = self._replay(first if math.isnan(rests) else rests, seconds)
        begin = named[0].time if named else math.nan
        return [one for one in moments if one.time < begin] + named, begin

    def _name(self, names: bool) -> None:
        if hasattr(self.touches, "naming"):
            self.touches.naming = names

    def _replay(self, first: float, seconds: float) -> tuple[list[Moment], float]:
        """Moments from one time to another [s], and where nothing was touched last, if anywhere."""
        recording = self._recording
        assert recording is not None
        # The loop's own, where it has one: it lets go of what was touched before.
        getattr(self.touches, "seek", recording.seek)(first)
        start, origin, rests = recording.position, math.nan, math.nan
        moments: list[Moment] = []
        with contextlib.suppress(SourceEnded):
            while True:
                before = recording.position
                moment = self.touches.step(0.0)
                if moment is None:
                    if recording.position == before:
                        break  # it gives nothing now
                    continue
                origin = moment.time - start if math.isnan(origin) else origin
                moments.append(moment)
                if moment.time - origin >= seconds - self.period / 2:
                    break
                if getattr(self.touches, "resting", not moment.touches):
                    rests = moment.time - origin
        return moments, rests

    def pace(self, speed: float, *, halted: bool, hurried: bool) -> None:
        """Set the recording's speed."""
        if self._recording is not None:
            wanted = 0.0 if halted else math.inf if hurried else speed
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
        self.seekable = self._moments is not None
        self.halts = self.paced = True  # nothing comes unless it is asked for
        self.duration = math.nan  # from the first moment to the last [s]
        if self._moments:
            self.duration = self._moments[-1].time - self._moments[0].time
            if len(self._moments) > 1:
                self.period = self.duration / (len(self._moments) - 1)

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

    def lead(self, seconds: float, before: float) -> tuple[list[Moment], float]:
        """Go on after the first moment at or after a time; moments up to there, and their names."""
        if not self._moments:
            return [], math.nan
        start = self._moments[0].time + seconds - self.period / 2
        count = sum(moment.time < start for moment in self._moments) + 1
        found = [one for one in self._moments[:count] if one.time >= start - before]
        self._iterator = iter(self._moments[count:])
        self._next, self._due = None, math.nan
        self._last = found[-1] if found else None
        return found or [self._moments[-1]], -math.inf

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


Feed = LoopFeed | MomentFeed  # moments one by one, at a pace


class Player(Outlet):
    """Moments of a recording or a live source, one at a time.

    Live sources can be paused: the picture stays, samples go on, and what was seen last can be
    stepped through. Recordings halt, and can be led anywhere.

    Parameters
    ----------
    moments : TouchLoop or iterable of Moment
        What is played. An iterable is paced by the times of its moments.
    paused : bool
        Halt at the first moment.

    Attributes
    ----------
    paused : bool
        Whether the picture is halted.
    ended : bool
        Whether nothing more will come without a seek.
    error : Exception or None
        Why the source failed, if it did; the last moment stays.

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.live import Moment
    >>> from viewer import Player
    >>> with Player([Moment(0.02 * k, {"torso": np.zeros(3)}) for k in range(9)]) as player:
    ...     _ = player.wait(player.number, 5.0)
    ...     player.pause()
    ...     player.seekable, round(player.duration, 2)
    (True, 0.16)
    """

    def __init__(self, moments: Any, *, paused: bool = False) -> None:
        # A touch loop steps by itself, as a feed does; whatever else gives moments is gone through.
        self._touches: Any = moments if hasattr(moments, "source") else None
        if self._touches is not None:
            self._feed: Feed = LoopFeed(moments)
        else:
            self._feed = moments if hasattr(moments, "step") else MomentFeed(moments)
        super().__init__()  # whose `news` guards all below
        self._history = History()
        # What can be stepped through while the picture is halted, oldest first, and which is shown.
        self._past: tuple[Moment, ...] = ()
        self._cursor = -1
        self.timeline = Timeline()
        # Time of the recording's beginning, in the moments' clock [s].
        self._origin = float(getattr(self._feed, "began", math.nan))
        self.paused = paused
        self._speed = 1.0
        self.before = BEFORE  # what is worked through before a jump's end [s]
        self._asked: float | None = None  # where to go, in the moments' clock [s]
        self._named = -math.inf  # what is remembered from before has touches without names [s]
        self._more = 1 if paused else 0  # moments still to be shown while paused
        self._held: Moment | None = None  # came while the picture was being halted: is next
        self.ended = False
        self.error: Exception | None = None
        self._wake, self._stop = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Begin to take moments in; more than once does no harm; after `close` nothing begins."""
        if self._thread is None and not self._stop.is_set():
            self._thread = threading.Thread(target=self._run, name="player", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread and close what is played; may be called twice."""
        self._stop.set()
        self._wake.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(PATIENCE)
        self._feed.close()
        super().close()

    @property
    def age(self) -> float:
        """How long ago the sample arrived that was taken last [s]; NaN where nothing is live."""
        shown = self.moment
        live = shown is not None and not (shown.stale or self.paused or self.ended)
        return super().age if live else math.nan

    # Where it stands.

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
            return max(0.0, self._asked - self.origin)
        return 0.0 if self.moment is None else max(0.0, self.moment.time - self.origin)

    @property
    def span(self) -> tuple[float, float]:
        """From when to when it can be led [s], as `position` counts; both 0 before anything came.

        The whole of a recording; of what is live, what is remembered of it.
        """
        if self.seekable:
            return 0.0, self.duration
        with self.news:
            first, last = self._history.oldest, self._history.newest
        if first is None or last is None:
            return 0.0, 0.0
        return first.time - self.origin, last.time - self.origin

    def spans(self) -> list[list[object]]:
        """Touches that were seen, as the pages get them: of what is live those of `span`."""
        with self.news:
            found = self.timeline.every()
        first = self.span[0]
        return [s.to_json(self.origin) for s in found if s.ended - self.origin >= first]

    @contextlib.contextmanager
    def marking(self) -> Iterator[Timeline]:
        """The time line, for another thread to write on alone."""
        with self.news:
            yield self.timeline

    def next_touch(self, way: int) -> bool:
        """Go to the beginning of the next touch that is known, or of the one before (-1).

        False where none is known that way.
        """
        with self.news:
            begun = sorted({one.began - self.origin for one in self.timeline.every() if one.part})
        here = self.position
        there = [one for one in begun if (one > here + NEAR if way > 0 else one < here - NEAR)]
        return bool(there) and self.seek(there[0] if way > 0 else there[-1])

    @property
    def closed(self) -> bool:
        """Whether it was closed."""
        return self._stop.is_set()

    # What can be asked for; False where the source cannot do it.

    def pause(self) -> None:
        """Halt the picture. A recording halts too, a live source goes on unseen."""
        with self.news:
            if not self.paused:
                self.paused = True
                self._remember_past()
        self._wake.set()

    def play(self) -> None:
        """Go on: a live source with its newest sample, a recording from where it stands."""
        with self.news:
            if not (self.paused or self.ended):
                return
            self.paused = False
            if self.seekable and self.moment is not None:
                if self._cursor < len(self._past) - 1:
                    self._asked = self.moment.time
            elif (newest := self._history.newest) is not None:
                self.show(newest)
            self._past, self._cursor = (), -1
        if self.ended and self.seekable:
            self.seek(0.0)
        self._wake.set()

    def toggle(self) -> None:
        """Pause or go on; at its end a recording begins again."""
        (self.play if self.paused or (self.ended and self.seekable) else self.pause)()

    def step(self, count: int) -> bool:
        """Halt, and show `count` samples later (negative: earlier)."""
        self.pause()
        with self.news:
            goal = self._asked
            if goal is not None and self.seekable:  # on its way: from where it goes
                last = self.origin + self.duration
                return self._ask(min(goal + count * self._feed.period, last))
            if 0 <= (there := self._cursor + count) < len(self._past):
                self._cursor = there
                self.show(self._past[there])
                return True
            shown, over = self.moment, self.ended and count > 0
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
            with self.news:
                gaps = [abs(one.time - (self.origin + seconds)) for one in self._past]
                if not gaps:
                    return False
                self._cursor = gaps.index(min(gaps))
                self.show(self._past[self._cursor])
            return True
        with self.news:
            inside = min(max(seconds, 0.0), self.duration)
            return self._ask(self.origin + inside)

    @property
    def speed(self) -> float:
        """How many times quicker than recorded; 1 for live sources."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        self._set_speed(speed)

    def _set_speed(self, speed: float) -> None:
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
        self._set_loop(loop)

    def _set_loop(self, loop: bool) -> None:
        self._feed.loop = loop
        if loop and self.ended and not self.paused:
            self.seek(0.0)

    @property
    def origin(self) -> float:
        """Time of the recording's beginning in the moments' clock [s]; 0 before the first one."""
        return 0.0 if math.isnan(self._origin) else self._origin

    def _ask(self, goal: float) -> bool:
        """Let the thread go to a time of the moments' clock."""
        if not self.seekable:
            return False
        self._asked, self.ended = max(goal, self.origin), False  # it leaves its end
        self._wake.set()
        return True

    # The thread.

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._turn()
        except Exception as error:  # noqa: BLE001 - told to whoever draws
            with self.news:
                self.error = error
                self.ended = True
                self.tell()

    def _turn(self) -> None:
        """One turn: requests first, then samples."""
        self._wake.clear()
        with self.news:
            goal = None if math.isnan(self._origin) else self._asked
            single = self.paused and self._more > 0
            halted = self._halted()
            if goal is None:
                self._feed.pace(self._speed, halted=halted, hurried=single)
        if goal is not None:
            self._lead(goal)
            return
        if halted or (self.ended and self._asked is None):
            self._wake.wait(WAIT)
            return
        with contextlib.suppress(SourceEnded):
            moment, self._held = self._held or self._feed.step(WAIT, self._wake), None
            if moment is not None:
                self._take_in(moment)
            return
        with self.news:
            self.ended = self._asked is None
            self.tell()

    def _halted(self) -> bool:
        return self.paused and self._feed.halts and self._more == 0 and self._asked is None

    def _lead(self, goal: float) -> None:
        """Go to a time of the moments' clock [s], and remember what was before it."""
        moments, named = self._feed.lead(goal - self.origin, self.before)
        self._held = None
        with self.news:
            if self._asked == goal:  # else on to where was asked for meanwhile
                self._asked = None
            self._history.clear()
            for moment in moments:
                self._history.add(moment)
                if moment.time >= named:
                    self.timeline.see(moment)
            touched = [one.time for one in moments if one.touches and one.time < named]
            self._named = touched[-1] if touched else -math.inf
            self._past, self._cursor = (), -1
            self._more, self.ended = int(self.paused and not moments), False
            if moments:
                self._land(moments[-1])

    def _take_in(self, moment: Moment) -> None:
        with self.news:
            if math.isnan(self._origin):
                self._origin = moment.time
            if self._asked is not None:
                return  # from before the jump that is asked for
            if self.paused and self._feed.halts:
                if self._more == 0:
                    self._held = moment
                    return
                self._more -= 1
            self._history.add(moment)
            self.timeline.see(moment)
            if self.paused and not self._feed.halts and self.moment is not None:
                return
            self._land(moment)

    def _land(self, moment: Moment) -> None:
        """Show the newest moment of the history."""
        if self.paused:
            self._remember_past()
        self.show(moment, fresh=True)

    def _remember_past(self) -> None:
        """Keep moments whose touches have the names of a straight play; the newest is shown."""
        self._past = tuple(one for one in self._history.moments() if one.time > self._named)
        self._cursor = len(self._past) - 1

    def remember(self, seconds: float) -> None:
        """Keep so many seconds before each shown moment from now on, for an open plot."""
        with self.news:
            more, self.before = seconds > self.before, max(seconds, BEFORE)
            shown, oldest = self.moment, self._history.oldest
            if not more or shown is None or oldest is None or self._asked is not None:
                return
            if oldest.time > max(shown.time - seconds, self.origin) + self._feed.period:
                self._ask(shown.time)

    def recall(self, first: float, last: float) -> list[Moment]:
        """Moments that are remembered from one time to another [s, in their clock]."""
        with self.news:
            every = self._history.moments()
        return [one for one in every if first - 1e-9 <= one.time <= last + 1e-9 and not one.stale]

    @property
    def zero_age(self) -> float | None:
        """Age of the zero of the forces [s]; None where there are none."""
        return getattr(self._touches, "zero_age", None)

    def zero(self) -> None:
        """Take the zero of the forces anew, as soon as nothing touches."""
        if hasattr(self._touches, "zero"):
            self._touches.zero()

    def totals(self) -> dict[str, int]:
        """What became of the samples, as `TouchLoop.totals`; nothing without a loop."""
        return self._touches.totals() if hasattr(self._touches, "totals") else {}

    def levels(self, part: str, taxel: int) -> dict[str, float]:
        """What is known of a taxel at rest, as `TouchLoop.levels`; nothing without a loop."""
        return dict(self._touches.levels(part, taxel)) if hasattr(self._touches, "levels") else {}

"""The whole of a recording on the time line from the start, found beside what is played.

First its marks and gaps, and the seconds in which it is touched: from its own overview, or from all
its samples. Then the touches with their names, the nearest to what is shown first.

Two players in step: one is led through time, and the other follows it.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing

from skinmap.errors import SkinError
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import SourceEnded
from skinmap.live.touched_taxels import touch_stretches
from viewer.playing.player import Player
from viewer.playing.recent_moments import Span, Timeline
from viewer.view_options import Session

AHEAD = 0.03  # of the other one, at most [s]: longer than a sample of most skins


class PairedPlayer(Player):
    """A player that another one follows, whichever of the two is asked for something.

    Attributes
    ----------
    mate : PairedPlayer or None
        The other one.
    later : float
        How much later the other one stands in its recording [s].

    Examples
    --------
    >>> from viewer.playing.overview import PairedPlayer, in_step
    >>> with PairedPlayer([]) as left, PairedPlayer([]) as right:
    ...     in_step(left, right)
    ...     left.pause()
    ...     right.paused
    True
    """

    mate: PairedPlayer | None = None
    later = 0.0

    def pause(self) -> None:
        """Halt both, at the same time of their recordings."""
        if not self.paused:
            super().pause()
            if self.mate is not None:
                Player.pause(self.mate)
                self._bring()

    def play(self) -> None:
        """Let both go on; one that ended before the other stays at its end."""
        over = self.ended
        super().play()
        if self.mate is not None and (over or not self.mate.ended):
            Player.play(self.mate)

    def step(self, count: int) -> bool:
        """Halt both, and show `count` samples later (negative: earlier)."""
        done = super().step(count)
        if self.mate is not None:
            Player.step(self.mate, count)
        return done

    def seek(self, seconds: float) -> bool:
        """Go to so many seconds from the beginning, the other one to the same time of its own."""
        done = super().seek(seconds)
        if self.mate is not None:
            Player.seek(self.mate, max(seconds + self.later, 0.0))
        return done

    def _set_speed(self, speed: float) -> None:
        super()._set_speed(speed)
        if self.mate is not None:
            Player._set_speed(self.mate, speed)

    def _set_loop(self, loop: bool) -> None:
        super()._set_loop(loop)
        if self.mate is not None:
            Player._set_loop(self.mate, loop)

    def _bring(self) -> None:
        """Bring the other one to where this one stands."""
        if self.mate is not None and self.seekable and self.mate.seekable:
            Player.seek(self.mate, max(self.position + self.later, 0.0))

    def _halted(self) -> bool:
        """Neither goes on while the other is on its way to another time, or falls behind."""
        own = super()._halted()
        if own or self._more > 0 or self._asked is not None:
            return own
        if self.mate is None or not (self.seekable and self.mate.seekable):
            return False
        ahead = self._next + self.later - self.mate._next
        return self.mate._asked is not None or (ahead > AHEAD and not self.mate.ended)

    @property
    def _next(self) -> float:
        """Seconds from the recording's beginning, of the sample that comes next."""
        return float(getattr(self._feed, "position", math.nan))

    def _lead(self, goal: float) -> None:
        super()._lead(goal)
        if self.mate is not None:
            self.mate._wake.set()

    def _take_in(self, moment: Moment) -> None:
        before = self.moment
        super()._take_in(moment)
        if self.mate is not None:
            self.mate._wake.set()  # it may have waited for this one
        if self.loop and before is not None and moment.time < before.time:
            self._bring()


def in_step(left: PairedPlayer, right: PairedPlayer, *, later: float = 0.0) -> None:
    """Let each of two players follow the other, the right one `later` [s] in its recording."""
    left.mate, left.later = right, later
    right.mate, right.later = left, -later
    if later > 0.0:
        Player.seek(right, later)


REST = 2e-3  # between two blocks of samples: pictures and names come first [s]
SHARE = 0.6  # of a core for names while a recording plays: the picture needs the rest
BLOCK = 10e-3  # worked on without a pause [s]
APART = 2.0  # touches with a longer pause between them are named one after the other [s]
BEFORE, AFTER = 1.0, 0.6  # of touches that are worked on too: a pat may go on [s]
TOGETHER = 30.0  # touches that come without a pause are named in pieces of so long [s]
logger = logging.getLogger(__name__)


def new_players(sessions: Sequence[Session], later: float = 0.0) -> list[PairedPlayer]:
    """A player of each source, halted where that can wait; the second of two `later` [s]."""
    players = []
    for session in sessions:
        loop = session.live()
        players.append(PairedPlayer(loop, paused=not loop.live))
        players[-1].speed = sessions[0].speed
        fill_overview(session, players[-1])
    if len(players) > 1:
        in_step(*players, later=later)
    return players


def fill_overview(session: Session, player: Player) -> threading.Thread | None:
    """Find when a recording is touched, and how, in a thread of its own; None for other sources.

    It ends with the recording, or when the player is closed.
    """
    if session.simulated or not session.repeats:
        return None
    thread = threading.Thread(target=_fill, args=(session, player), name="overview", daemon=True)
    thread.start()
    return thread


def _fill(session: Session, player: Player) -> None:
    try:
        source = session.open(hurry=True)
        if not isinstance(source, Playback) or not math.isfinite(source.duration):
            source.close()
            return
        with closing(session.touch_loop(source, None)) as loop:
            session.learn_rest(loop)
            _note(source, loop, player)
            if source.overview is None:
                _find(loop, player)
        if not player.closed:
            source = session.open(hurry=True)
            with closing(session.touch_loop(source, session.classifier())) as loop:
                session.learn_rest(loop)
                _name(loop, player)
    except (SkinError, OSError) as error:  # the player reads the same and reports it
        logger.info("no overview: %s", error)


def _note(source: Playback, loop: TouchLoop, player: Player) -> None:
    """Note what the recording states by itself."""
    marks = [Span(*mark, marked=True) for mark in source.marked()]
    gaps = [Span("", f"no samples for {b - a:.1f} s", a, b) for a, b in source.gaps]
    overview, parts = source.overview, source.info.parts
    touched = [] if overview is None else [
        (part, *own) for part in loop.skins for own in overview.touched(parts.index(part))
    ]  # fmt: skip
    with player.marking() as line:
        line.note([*gaps, *(one for one in marks if one.part in loop.skins)])
        line.fill(touched)


def _find(loop: TouchLoop, player: Player) -> None:
    """Find when parts are touched, from what is shown to the end, then what is before it."""
    begin = player.position
    for first, last in ((begin, math.inf), (0.0, begin)):
        loop.seek(first)
        for stretches in touch_stretches(loop):
            if player.closed:
                return
            if stretches:
                with player.marking() as line:
                    line.fill(stretches)
            time.sleep(0.0 if player.paused else REST)
            if loop.source.position >= last:  # type: ignore[attr-defined]
                break


def _name(loop: TouchLoop, player: Player) -> None:
    """Name all touches of the time line, always those that are nearest to what is shown."""
    with player.marking() as line:
        left = pieces([(one.began, one.ended) for one in line.spans()])
    origin = loop.source.began  # type: ignore[attr-defined]
    while left and not player.closed:
        shown = player.position + origin
        began, ended = left.pop(min(range(len(left)), key=lambda k: abs(left[k][0] - shown)))
        found = Timeline()
        loop.seek(max(began - BEFORE - origin, 0.0))
        started = time.perf_counter()
        for moment in _until(loop, ended + AFTER, player):
            found.see(moment)
            spent = time.perf_counter() - started
            if spent > BLOCK:
                time.sleep(0.0 if player.paused else spent * (1.0 / SHARE - 1.0))
                started = time.perf_counter()
        own = [one for one in found.spans() if one.began < one.ended]
        with player.marking() as line:
            line.settle(began - BEFORE, ended + AFTER, own)


def _until(loop: TouchLoop, end: float, player: Player) -> Iterator[Moment]:
    """Moments up to a time [s], or until the player is closed."""
    try:
        while (moment := loop.step(0.0)) is not None and moment.time <= end:
            if player.closed:
                return
            yield moment
    except SourceEnded:
        return


def pieces(stretches: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Stretches [s] named at once: touches that follow each other closely."""
    found: list[tuple[float, float]] = []
    for began, ended in sorted(stretches):
        if found and began - found[-1][1] < APART and ended - found[-1][0] < TOGETHER:
            found[-1] = (found[-1][0], max(found[-1][1], ended))
        else:
            found.append((began, ended))
    return found

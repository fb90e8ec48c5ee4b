"""Two players in step: one is led through time, and the other follows it."""

from __future__ import annotations

import math

from skinmap.live.moment import Moment
from viewer.playing.player import Player

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
    >>> from viewer.playing.paired_player import PairedPlayer, in_step
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
        if not self._paused:
            super().pause()
            if self.mate is not None:
                Player.pause(self.mate)
                self._bring()

    def play(self) -> None:
        """Let both go on; one that ended before the other stays at its end."""
        over = self._ended
        super().play()
        if self.mate is not None and (over or not self.mate._ended):
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
        return self.mate._asked is not None or (ahead > AHEAD and not self.mate._ended)

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

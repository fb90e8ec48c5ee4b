"""Samples with their times, played back: at any speed, from any place, over and over."""

from __future__ import annotations

import threading
import time

import numpy as np

from skinmap.errors import InvalidArrayError
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.sources.source import MAX_BLOCK, Block, Seekable, SourceEnded

GAP = 0.5  # without a sample: something is lost [s]

MarkedSpan = tuple[str, str, float, float]  # part, label, beginning and end [s]


class Playback(Seekable):
    """A recording as a source: `Seekable`.

    Parameters
    ----------
    track : RecordedStream
        Its marks and its overview are kept with it.
    speed : float
        Speed as a multiple of the recorded one; `inf` gives all at once, 0 halts.
    loop : bool
        Whether it starts again at its end.

    Attributes
    ----------
    loop : bool
    most : int
        Samples that one read gives at most while it plays as fast as it is asked.

    Notes
    -----
    Nothing is left out: a slow reader gets all samples that are due. Times are the recording's
    own, so they jump back when it starts again and where `seek` leads back.
    """

    def __init__(self, track: RecordedStream, *, speed: float = 1.0, loop: bool = False) -> None:
        super().__init__(track.info)
        self.marks, self.overview, self.most = track.touches, track.overview, MAX_BLOCK
        self._track, self._times = track, track.times
        steps = np.diff(self._times)
        self._step = float(np.median(steps)) if len(steps) else 0.0
        self._changed = threading.Condition()
        self._closed = False
        self._row = 0
        self.loop = loop
        self._speed = _checked(speed)
        self._anchor()

    def again(self, speed: float) -> Playback:
        """The same recording from its beginning, as a source of its own; nothing is read anew."""
        return Playback(self._track, speed=speed, loop=self.loop)

    @property
    def speed(self) -> float:
        """Factor of the speed."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        with self._changed:
            self._anchor(self._playing_time())
            self._speed = _checked(speed)
            self._changed.notify_all()

    @property
    def duration(self) -> float:
        """[s]; the last sample lasts as long as a sample does."""
        return self._end - self.began

    @property
    def last(self) -> float:
        """Seconds from its beginning to its last sample; 0 where it has none."""
        return float(self._times[-1]) - self.began if len(self._times) else 0.0

    @property
    def began(self) -> float:
        """Time of its beginning, in its clock [s]."""
        return float(self._times[0]) if len(self._times) else 0.0

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Where samples are missing for `GAP` and longer [s], in the recording's clock."""
        after = np.flatnonzero(np.diff(self._times) > max(GAP, 2 * self._step))
        return list(zip(self._times[after].tolist(), self._times[after + 1].tolist(), strict=True))

    def marked(self) -> list[MarkedSpan]:
        """Part, label, beginning and end [s] of each mark, in the recording's clock."""
        return [
            (one.part, one.label, *self._times[[one.first, one.last]].tolist())
            for one in self.marks
            if one.first <= one.last
        ]

    @property
    def position(self) -> float:
        """Seconds from the beginning to the sample that comes next."""
        with self._changed:
            return self._time_of(self._row) - self.began

    def angles_at(self, time: float) -> dict[str, float]:
        """Joint angles [rad] of the last sample up to a time in the recording's clock [s]."""
        row = int(np.searchsorted(self._times, time + 1e-10)) - 1
        if not 0 <= row < len(self._track.angles):
            return {}
        found = zip(self._track.joints, self._track.angles[row].tolist(), strict=True)
        return {joint: angle for joint, angle in found if angle == angle}

    def seek(self, seconds: float) -> None:
        """Go on from there; before the beginning or after the end is the beginning or the end."""
        if not np.isfinite(seconds):
            raise InvalidArrayError(f"cannot seek to {seconds} seconds")
        with self._changed:
            # A tenth of a nanosecond: what `position` gave must lead back to the same sample.
            self._row = int(np.searchsorted(self._times, self.began + seconds - 1e-10))
            self._anchor()
            self._changed.notify_all()

    def read(self, timeout: float) -> Block | None:
        """All samples that are due by now, at most 256; None where none is within `timeout` [s].

        Raises
        ------
        SourceEnded
            After the last sample, until `seek`; and once it is closed.
        """
        deadline = time.perf_counter() + timeout
        with self._changed:
            while True:
                if self._row >= len(self._times) and self.loop and len(self._times):
                    self._row = 0
                    # Begins when the last sample has lasted, not when somebody asks for more.
                    self._anchor(since=self._when(self._end))
                if self._closed or self._row >= len(self._times):
                    raise SourceEnded
                now = time.perf_counter()
                if (block := self._due(now)) is not None:
                    return block
                left = min(deadline, self._when(self._times[self._row])) - now
                if now >= deadline:
                    return None
                self._changed.wait(max(left, 0.0))

    def close(self) -> None:
        """End it; a waiting `read` is told."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def _end(self) -> float:
        if len(self._times) == 0:
            return 0.0
        return float(self._times[-1]) + self._step

    def _time_of(self, row: int) -> float:
        return float(self._times[row]) if row < len(self._times) else self._end

    def _anchor(self, played: float | None = None, *, since: float | None = None) -> None:
        """Note which time of the recording belongs to which moment of the wall clock."""
        self._played = self._time_of(self._row) if played is None else played
        self._since = time.perf_counter() if since is None else since

    def _playing_time(self) -> float:
        """Time of the recording that is due now; never past what comes next."""
        due = self._time_of(self._row)
        if self._speed == 0.0 or not np.isfinite(self._speed):
            return min(self._played, due) if self._speed == 0.0 else due
        return min(self._played + (time.perf_counter() - self._since) * self._speed, due)

    def _when(self, recorded: float) -> float:
        """When a time of the recording is due, by `perf_counter`."""
        if self._speed == 0.0:
            return np.inf
        return self._since + (recorded - self._played) / self._speed

    def _due(self, now: float) -> Block | None:
        """What is due, and the row moved behind it."""
        row = self._row
        if np.isinf(self._speed):
            stop = row + self.most
        elif self._when(self._times[row]) > now:
            return None
        else:
            due = self._played + (now - self._since) * self._speed
            stop = max(int(np.searchsorted(self._times, due, side="right")), row + 1)
        stop = min(stop, row + MAX_BLOCK, len(self._times))
        arrived = now if np.isinf(self._speed) else self._when(self._times[stop - 1])
        block = Block(self._times[row:stop], self._track.values[row:stop], min(arrived, now))
        self._row = stop
        return block


def _checked(speed: float) -> float:
    if not speed >= 0.0:
        raise InvalidArrayError(f"speed must not be negative, got {speed}")
    return float(speed)

"""A recording that can be led to the very sample."""

from __future__ import annotations

import math

from skinmap.live.sources.source import Block, Relay, Seekable, Source


class Stepwise(Relay, Seekable):
    """A recording that gives single samples while it is hurried: a `Seekable`.

    What a player seeks for, or steps to, is then met to the sample.

    Parameters
    ----------
    recording : Seekable
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

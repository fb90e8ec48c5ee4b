"""A source whose samples are recorded on their way to whoever reads it."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from skinmap.live.recording.recorder import Recorder
from skinmap.live.sources.source import Block, Relay, Source, SourceEnded

HAIR = 1e-6  # [s]; times are multiples of a step only nearly


class RecordingTap(Relay):
    """A source whose samples are recorded on their way; the recorder is closed on its own.

    Parameters
    ----------
    source : Source
    recorder : Recorder
    patience : float
        Seconds to wait for a slow disk before samples are dropped.
    seconds : float, optional
        Ends after these, in the source's clock.
    one_by_one : bool
        Whether samples that came together are given one after the other, so that whoever works
        on them has a result for each.
    """

    def __init__(
        self,
        source: Source,
        recorder: Recorder,
        *,
        patience: float = 1.0,
        seconds: float | None = None,
        one_by_one: bool = False,
    ) -> None:
        super().__init__(source)
        self._one_by_one = one_by_one
        self._waiting: deque[Block] = deque()
        self.recorder, self._patience = recorder, patience
        self._seconds = float("inf") if seconds is None else seconds
        self._end = float("inf")
        self._ended = False
        self._angles: Mapping[str, float] = {}

    def read(self, timeout: float) -> Block | None:
        """What the source gives, recorded."""
        if self._waiting:
            return self._waiting.popleft()
        block = self._record(timeout)
        if block is None or not self._one_by_one:
            return block
        for row in range(1, len(block)):
            rows = slice(row, row + 1)
            self._waiting.append(Block(block.times[rows], block.values[rows], block.arrived))
        return Block(block.times[:1], block.values[:1], block.arrived)

    def _record(self, timeout: float) -> Block | None:
        if self._ended:
            raise SourceEnded
        block = self.source.read(timeout)
        if block is None or len(block) == 0:
            return None
        if self._end == float("inf"):
            self._end = float(block.times[0]) + self._seconds
        if block.times[-1] >= self._end - HAIR:
            self._ended = True
            rows = block.times < self._end - HAIR
            if not rows.any():
                raise SourceEnded
            block = Block(block.times[rows], block.values[rows], block.arrived)
        self.recorder.put(block, patience=self._patience)
        self._record_angles(block)
        return block

    def _record_angles(self, block: Block) -> None:
        """Record joint angles where the source has them and they changed."""
        for now in block.times.tolist():
            angles = self.source.angles_at(now)
            if angles != self._angles:
                self._angles = angles
                self.recorder.put_angles(now, angles)

"""A receiving thread: takes what comes at once, keeps it within bounds, and counts the rest.

Some parts of a source that sends more.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skinmap.live.bounded_queue import BoundedQueue
from skinmap.live.sources.source import (
    Block,
    Counts,
    Relay,
    Source,
    SourceEnded,
    StreamInfo,
)


class ChosenParts(Relay):
    """A source of which only some parts are handed on.

    Parameters
    ----------
    source : Source
        Closed with this.
    parts : sequence of str

    Raises
    ------
    UnknownNameError
        A part that the source does not send.
    """

    def __init__(self, source: Source, parts: Sequence[str]) -> None:
        super().__init__(source)
        self._info, self._columns = source.info.only(parts)

    @property
    def info(self) -> StreamInfo:
        """What is in a sample, of the chosen parts."""
        return self._info

    def read(self, timeout: float) -> Block | None:
        """As the source's, with fewer channels."""
        block = self.source.read(timeout)
        if block is None:
            return None
        return Block(block.times, block.values[:, self._columns], block.arrived)


def choose_parts(source: Source, parts: Sequence[str] | None) -> Source:
    """The source itself, or only some of its parts."""
    if not parts or tuple(parts) == source.info.parts:
        return source
    return ChosenParts(source, parts)


def follow(source: Source, parts: Sequence[str] | None) -> Receiver:
    """Some parts of a live source, received in a thread; the source is closed where that fails."""
    try:
        return Receiver(choose_parts(source, parts))
    except BaseException:
        source.close()
        raise


MAX_BYTES = 64_000_000  # kept for a slow reader: 3.7 s of a whole iCub at 1 kHz in float32
OVERHEAD = 512  # bytes of a block beside its numbers: narrow ones weigh little else
POLL = 0.1  # the thread looks so often whether it is to stop [s]
SILENT = 0.8  # without a sign of life, a source counts as dead: well within a second [s]


class Receiver(Relay):
    """Reads a source in a thread of its own; itself a `Source`.

    Parameters
    ----------
    source : Source
        Read from the thread only, and closed with this.
    most_bytes : int
        Kept for a slow reader, blocks with all that they weigh; the oldest samples go first.

    Notes
    -----
    Samples are handed on as they came: who uses them looks at them (`SampleChecks`).
    `read` gives all that was kept. What a source raises is raised again by whoever reads.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> source = skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    >>> receiver = skinmap.live.Receiver(source)
    >>> block = receiver.read(30.0)
    >>> len(block) > 0, block.values.shape[1] == source.info.channels
    (True, True)
    >>> receiver.close()
    """

    def __init__(self, source: Source, *, most_bytes: int = MAX_BYTES) -> None:
        super().__init__(source)
        self._kept: BoundedQueue[Block] = BoundedQueue(most_bytes)
        self._last_seen = time.perf_counter()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="receiver", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> Counts:
        """What happened so far; a copy."""
        theirs = self.source.counts
        return replace(
            self._counts, lost=theirs.lost, refused=theirs.refused, reconnects=theirs.reconnects
        )

    @property
    def last_seen(self) -> float:
        """`time.perf_counter()` of the last sign of life.

        A source that knows it is asked: this thread takes a block a moment after it came, and two
        moments would let `alive` and `last_seen` contradict each other.
        """
        theirs = self.source.last_seen
        return self._last_seen if np.isnan(theirs) else theirs

    @property
    def alive(self) -> bool:
        """Whether there was a sign of life within the last second."""
        return self.source.alive and time.perf_counter() - self.last_seen < SILENT

    def read(self, timeout: float) -> Block | None:
        """All samples that were kept, as one block; None where none come within `timeout` [s]."""
        blocks = self._kept.take_all(timeout)
        if not blocks:
            return None
        if len(blocks) == 1:
            return blocks[0]
        return Block(
            np.concatenate([block.times for block in blocks]),
            np.concatenate([block.values for block in blocks]),
            blocks[-1].arrived,
        )

    def close(self) -> None:
        """Stop the thread and close the source; may be called twice."""
        self._stop.set()
        self._kept.end(SourceEnded(), at_once=True)
        if threading.current_thread() is not self._thread:
            self._thread.join()
        self.source.close()

    def _work(self) -> None:
        while not self._stop.is_set():
            try:
                block = self.source.read(POLL)
            except Exception as error:  # noqa: BLE001 - whoever reads is told
                self._kept.end(error)
                return
            if block is not None and len(block):
                self._last_seen = time.perf_counter()
                self._counts.received += len(block)
                size = block.values.nbytes + block.times.nbytes + OVERHEAD
                self._counts.dropped += sum(map(len, self._kept.push(block, size)))

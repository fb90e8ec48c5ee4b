"""A receiving thread: takes what comes at once, keeps it within bounds, and counts the rest."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import replace

import numpy as np

from skinmap.errors import SkinError
from skinmap.live.sources.sample_counts import Counts
from skinmap.live.sources.source import Block, Source, SourceEnded, StreamInfo

MAX_BYTES = 64_000_000  # kept for who reads late: 3.7 s of a whole iCub at 1 kHz in float32
POLL = 0.1  # the thread looks so often whether it is to stop [s]
SILENT = 0.8  # without a sign of life, a source counts as dead: well within a second [s]
LATE = 2.0  # periods after the one before, from which a block counts as late


class Receiver:
    """Reads a source in a thread of its own; itself a `Source`.

    Parameters
    ----------
    source : Source
        Read from the thread only, and closed with this. Its `counts` (lost, refused,
        reconnected), `alive` and `last_seen` are used where it has them.
    most_bytes : int
        Values kept for who reads late; the oldest samples go first.

    Notes
    -----
    Samples are handed on as they came: who uses them looks at them (`SampleChecks`).
    `read` gives all that was kept, `newest` the last sample alone. What a source raises is raised
    again by whoever reads.
    """

    def __init__(self, source: Source, *, most_bytes: int = MAX_BYTES) -> None:
        self._source, self._most_bytes = source, most_bytes
        self._kept: deque[Block] = deque()
        self._bytes = 0
        self._counts = Counts()
        self._arrived = float("nan")
        self._raised: Exception | None = None
        self._last_seen = time.perf_counter()
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="receiver", daemon=True)
        self._thread.start()

    @property
    def info(self) -> StreamInfo:
        """What is in a sample."""
        return self._source.info

    @property
    def counts(self) -> Counts:
        """What happened so far; a copy."""
        theirs = getattr(self._source, "counts", None)
        with self._changed:
            counts = replace(self._counts)
        if isinstance(theirs, Counts):
            counts.lost += theirs.lost
            counts.refused += theirs.refused
            counts.reconnects += theirs.reconnects
        return counts

    @property
    def dropped(self) -> int:
        """Samples left out because nobody took them in time, or lost on the way."""
        counts = self.counts
        return counts.dropped + counts.lost

    @property
    def last_seen(self) -> float:
        """`time.perf_counter()` of the last sign of life.

        A source that knows it is asked: this thread takes a block a moment after it came, and two
        moments would let `alive` and `last_seen` contradict each other.
        """
        return float(getattr(self._source, "last_seen", self._last_seen))

    @property
    def alive(self) -> bool:
        """Whether there was a sign of life within the last second."""
        theirs = bool(getattr(self._source, "alive", True))
        return theirs and time.perf_counter() - self.last_seen < SILENT

    def read(self, timeout: float) -> Block | None:
        """All samples that were kept, as one block; None where none come within `timeout` [s]."""
        if not self._wait(timeout):
            return None
        with self._changed:
            blocks = list(self._kept)
            self._kept.clear()
            self._bytes = 0
            count = sum(len(block) for block in blocks)
            self._counts.given += count
        if len(blocks) == 1:
            return blocks[0]
        return Block(
            np.concatenate([block.times for block in blocks]),
            np.concatenate([block.values for block in blocks]),
            blocks[-1].arrived,
        )

    def newest(self, timeout: float) -> Block | None:
        """The last sample alone; those before it count as dropped."""
        if not self._wait(timeout):
            return None
        with self._changed:
            last = self._kept[-1]
            count = sum(len(block) for block in self._kept)
            self._kept.clear()
            self._bytes = 0
            self._counts.given += 1
            self._counts.dropped += count - 1
        return last if len(last) == 1 else Block(last.times[-1:], last.values[-1:], last.arrived)

    def close(self) -> None:
        """Stop the thread and close the source; may be called twice."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join()
        self._source.close()

    def _wait(self, timeout: float) -> bool:
        """Whether something is kept, within the time; raises what the source raised."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._kept or self._raised is not None or self._stop.is_set(), timeout
            )
            if self._stop.is_set():
                raise SourceEnded
            if self._kept:
                return True
            if self._raised is not None:
                raise self._raised
            return False

    def _work(self) -> None:
        while not self._stop.is_set():
            try:
                block = self._source.read(POLL)
            except (SourceEnded, SkinError) as error:
                self._fail(error)
                return
            except Exception as error:  # noqa: BLE001 - a plug-in's fault, told to who reads
                self._fail(error)
                return
            if block is None or len(block) == 0:
                continue
            with self._changed:
                self._last_seen = time.perf_counter()
                self._keep(block)
                self._changed.notify_all()

    def _fail(self, error: Exception) -> None:
        with self._changed:
            self._raised = error
            self._changed.notify_all()

    def _keep(self, block: Block) -> None:
        self._counts.received += len(block)
        rate = self.info.rate
        if rate > 0 and block.arrived - self._arrived > LATE / rate:
            self._counts.delayed += 1
        self._arrived = block.arrived
        self._kept.append(block)
        self._bytes += block.values.nbytes
        # One block always stays: it may alone be larger than what is to be kept.
        while self._bytes > self._most_bytes and len(self._kept) > 1:
            gone = self._kept.popleft()
            self._bytes -= gone.values.nbytes
            self._counts.dropped += len(gone)

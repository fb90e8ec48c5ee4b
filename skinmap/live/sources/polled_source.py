"""A source of one part, made of a function that asks a device for new samples: see its example."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from skinmap.live.sources.source import Block, Counts, Source, SourceEnded, StreamInfo

Poll = Callable[[float, Counts], Iterable[Any]]


class PolledSource(Source):
    """Samples of one part from a function; their times are those of their arrival here.

    Parameters
    ----------
    name : str
        Of the stream.
    part : str
    taxels : int
        Numbers in a sample.
    poll : callable
        `poll(timeout, counts)` gives the samples that came, each `taxels` raw values, after at most
        `timeout` seconds; none is an empty list. It raises `EOFError` after the last. What is no
        sample of finite numbers counts as refused; what it finds missing it adds to `counts.lost`.
    stop : callable, optional
        Gives the device back; called once.

    Examples
    --------
    >>> lines = iter(["1 2 3", "4 5"])
    >>> source = PolledSource("file", "left_hand", 3, lambda timeout, counts: [next(lines).split()])
    >>> source.read(1.0).values.tolist(), source.read(1.0), source.counts.refused
    ([[1.0, 2.0, 3.0]], None, 1)
    """

    def __init__(
        self,
        name: str,
        part: str,
        taxels: int,
        poll: Poll,
        stop: Callable[[], object] | None = None,
    ) -> None:
        super().__init__(StreamInfo(name, (part,), (taxels,), 0.0, "raw", clock="local"))
        self._poll: Poll | None = poll
        self._stop = stop

    def read(self, timeout: float) -> Block | None:
        """What the function gives.

        Raises
        ------
        SourceEnded
            After the last sample, or once closed.
        """
        if self._poll is None:
            raise SourceEnded
        try:
            came = self._poll(timeout, self.counts)
        except EOFError as error:
            raise SourceEnded from error
        rows = [row for row in map(self._sample, came) if row is not None]
        now = time.perf_counter()
        return Block(np.full(len(rows), now), np.stack(rows), now) if rows else None

    def _sample(self, row: Any) -> Any:
        try:
            sample = np.asarray(row, np.float32)
        except (TypeError, ValueError):
            sample = np.zeros(0, np.float32)
        if sample.shape == (self.info.channels,) and np.isfinite(sample).all():
            return sample
        self.counts.refused += 1
        return None

    def close(self) -> None:
        """Give the device back; any number of times."""
        self._poll, stop, self._stop = None, self._stop, None
        if stop is not None:
            stop()

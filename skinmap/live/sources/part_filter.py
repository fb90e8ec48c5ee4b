"""Some parts of a source that sends more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from skinmap.live.sources.receiver import Receiver
from skinmap.live.sources.source import Block, Source, StreamInfo


class ChosenParts:
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
        self._source = source
        whole = source.info
        slices = {part: whole.part_slice(part) for part in dict.fromkeys(parts)}
        self._info = replace(
            whole,
            parts=tuple(slices),
            widths=tuple(one.stop - one.start for one in slices.values()),
            fingerprints={
                part: print_ for part, print_ in whole.fingerprints.items() if part in slices
            },
        )
        self._columns = np.concatenate([np.arange(one.start, one.stop) for one in slices.values()])

    @property
    def info(self) -> StreamInfo:
        """What is in a sample, of the chosen parts."""
        return self._info

    def read(self, timeout: float) -> Block | None:
        """As the source's, with fewer channels."""
        block = self._source.read(timeout)
        if block is None:
            return None
        return Block(block.times, block.values[:, self._columns], block.arrived)

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def __getattr__(self, name: str) -> Any:
        # Counts and signs of life are the source's own.
        if name == "_source":
            raise AttributeError(name)
        return getattr(self._source, name)


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

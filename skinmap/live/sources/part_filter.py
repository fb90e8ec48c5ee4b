"""Some parts of a source that sends more."""

from __future__ import annotations

from collections.abc import Sequence

from skinmap.live.sources.receiver import Receiver
from skinmap.live.sources.source import Block, Relay, Source, StreamInfo


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

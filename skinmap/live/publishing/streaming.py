"""Carry samples from a source to a publisher until one of them ends."""

from __future__ import annotations

from skinmap.live.publishing.publish import Publisher
from skinmap.live.sources.source import Source, SourceEnded

POLL = 0.2  # so often a silent source lets an interruption through [s]


def stream(source: Source, publisher: Publisher) -> None:
    """Publish all that a source gives, as it comes; back when the source ends."""
    while True:
        try:
            block = source.read(POLL)
        except SourceEnded:
            return
        if block is not None:
            publisher.send_block(block)

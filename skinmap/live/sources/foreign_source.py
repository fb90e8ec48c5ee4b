"""Sources that do not derive from `Source`: the one place that asks what such a one has."""

from __future__ import annotations

from typing import Any

from skinmap.errors import BrokenPluginError
from skinmap.live.sources.sample_counts import Counts
from skinmap.live.sources.source import Block, Seekable, Source

NEEDED = ("info", "read", "close")
LED = ("speed", "loop", "duration", "position", "seek")  # what a recording has


def as_source(found: Any) -> Source:
    """What a plug-in gave as a `Source`, itself or wrapped.

    Raises
    ------
    BrokenPluginError
        It lacks what every source has (says what).
    """
    if isinstance(found, Source):
        return found
    lacking = [name for name in NEEDED if not hasattr(found, name)]
    if lacking:
        raise BrokenPluginError(
            f"{type(found).__name__} has no {', '.join(map(repr, lacking))}; a source has "
            "'info', 'read' and 'close' (docs/live.md)"
        )
    if all(hasattr(found, name) for name in LED):
        return _ForeignRecording(found)
    return _ForeignSource(found)


def _theirs(name: str) -> Any:
    """A member that is the foreign source's own, or that of `Source` where it has none."""

    def get(self: _ForeignSource) -> Any:
        return getattr(
            self.found if hasattr(self.found, name) else super(_ForeignSource, self), name
        )

    return property(get, lambda self, value: setattr(self.found, name, value))


class _ForeignSource(Source):
    """Adapter of a foreign source; where it lacks a member, the default of `Source` answers."""

    def __init__(self, found: Any) -> None:
        self.found = found
        super().__init__(found.info)

    info, last_seen, alive, speed = map(_theirs, ("info", "last_seen", "alive", "speed"))
    angles_at = _theirs("angles_at")

    def read(self, timeout: float) -> Block | None:
        block: Block | None = self.found.read(timeout)
        return block

    def close(self) -> None:
        self.found.close()

    @property
    def counts(self) -> Counts:
        theirs = getattr(self.found, "counts", None)
        return theirs if isinstance(theirs, Counts) else super().counts


class _ForeignRecording(_ForeignSource, Seekable):
    """Adapter of a foreign recording."""

    speed, loop, duration, position, seek = map(_theirs, LED)

"""Sources that do not derive from `Source`: the one place that asks what such a one has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skinmap.errors import BrokenPluginError
from skinmap.live.sources.sample_counts import Counts
from skinmap.live.sources.source import Block, Seekable, Source, StreamInfo

NEEDED = ("info", "read", "close")
OPTIONAL = ("counts", "last_seen", "alive", "speed", "angles_at")
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


class _ForeignSource(Source):
    """Adapter of a foreign source; where it lacks a member, the default of `Source` answers."""

    def __init__(self, found: Any) -> None:
        super().__init__(found.info)
        self._found = found
        self._has = {name for name in OPTIONAL if hasattr(found, name)}

    def read(self, timeout: float) -> Block | None:
        block: Block | None = self._found.read(timeout)
        return block

    def close(self) -> None:
        self._found.close()

    @property
    def info(self) -> StreamInfo:
        info: StreamInfo = self._found.info
        return info

    @property
    def counts(self) -> Counts:
        theirs = self._found.counts if "counts" in self._has else None
        return theirs if isinstance(theirs, Counts) else super().counts

    @property
    def last_seen(self) -> float:
        return float(self._found.last_seen) if "last_seen" in self._has else super().last_seen

    @property
    def alive(self) -> bool:
        return bool(self._found.alive) if "alive" in self._has else super().alive

    @property
    def speed(self) -> float:
        return float(self._found.speed) if "speed" in self._has else super().speed

    def angles_at(self, time: float) -> Mapping[str, float]:
        angles: Mapping[str, float]
        angles = self._found.angles_at(time) if "angles_at" in self._has else {}
        return angles


class _ForeignRecording(_ForeignSource, Seekable):
    """Adapter of a foreign recording."""

    @property
    def speed(self) -> float:
        return float(self._found.speed)

    @speed.setter
    def speed(self, speed: float) -> None:
        self._found.speed = speed

    @property
    def loop(self) -> bool:
        return bool(self._found.loop)

    @loop.setter
    def loop(self, loop: bool) -> None:
        self._found.loop = loop

    @property
    def duration(self) -> float:
        return float(self._found.duration)

    @property
    def position(self) -> float:
        return float(self._found.position)

    def seek(self, seconds: float) -> None:
        self._found.seek(seconds)

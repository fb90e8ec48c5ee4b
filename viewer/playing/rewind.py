"""What was seen lately: moments to step and slide back through, in bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.live.moment import Moment

MINUTE = 60.0  # that is remembered [s]
MEMORY = 64_000_000  # bytes at most: a minute of the whole iCub at 50 Hz, in float32
LENGTH = 6000  # moments, however small they are


class History:
    """The last moments, oldest first, in as few bytes as their numbers need."""

    def __init__(self) -> None:
        self._moments: deque[Moment] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._moments)

    @property
    def newest(self) -> Moment | None:
        """The latest moments."""
        return self._moments[-1] if self._moments else None

    @property
    def oldest(self) -> Moment | None:
        """The earliest moment that is remembered."""
        return self._moments[0] if self._moments else None

    def moments(self) -> tuple[Moment, ...]:
        """All that is remembered, oldest first."""
        return tuple(self._moments)

    def add(self, moment: Moment) -> None:
        """Remember a moment, and forget the oldest where it gets too much."""
        kept = replace(moment, pressures=small(moment.pressures), raw=small(moment.raw))
        self._moments.append(kept)
        self._bytes += size(kept)
        while len(self._moments) > 2 and (
            len(self._moments) > LENGTH
            or self._bytes > MEMORY
            or kept.time - self._moments[0].time > MINUTE
        ):
            self._bytes -= size(self._moments.popleft())

    def clear(self) -> None:
        """Forget everything."""
        self._moments.clear()
        self._bytes = 0


class Past:
    """Moments to step through while the picture is halted, from the newest backwards.

    Parameters
    ----------
    moments : tuple of Moment
        Oldest first.
    """

    def __init__(self, moments: tuple[Moment, ...] = ()) -> None:
        self._moments = moments
        self._cursor = len(moments) - 1

    @property
    def newest(self) -> bool:
        """Whether nothing newer is remembered than what is shown."""
        return self._cursor >= len(self._moments) - 1

    def step(self, count: int) -> Moment | None:
        """The moment `count` later (negative: earlier); None where none is remembered."""
        goal = self._cursor + count
        if not 0 <= goal < len(self._moments):
            return None
        self._cursor = goal
        return self._moments[goal]

    def at(self, time: float) -> Moment | None:
        """The moment nearest to a time [s]; None where nothing is remembered."""
        if not self._moments:
            return None
        self._cursor = min(
            range(len(self._moments)), key=lambda k: abs(self._moments[k].time - time)
        )
        return self._moments[self._cursor]


def small(values: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays as bytes where they hold whole counts, else in single precision."""
    found = {}
    for part, array in values.items():
        own = np.asarray(array)
        if own.dtype == np.uint8:
            found[part] = own
            continue
        with np.errstate(invalid="ignore"):
            counts = own.astype(np.uint8)
        found[part] = counts if np.array_equal(counts, own) else own.astype(np.float32)
    return found


def size(moment: Moment) -> int:
    """Bytes of the moment's arrays."""
    return sum(v.nbytes for v in moment.pressures.values()) + sum(
        v.nbytes for v in moment.raw.values()
    )

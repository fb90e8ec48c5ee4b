"""What was seen lately: moments to step back through, in bounded memory."""

from __future__ import annotations

from collections import deque

from skinmap.live.moment import Moment

MEMORY = 8_000_000  # bytes: 5 s of the whole iCub's raw values and pressures at 50 Hz
LENGTH = 500  # moments, however small they are


class History:
    """The last moments, oldest first."""

    def __init__(self) -> None:
        self._moments: deque[Moment] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._moments)

    @property
    def newest(self) -> Moment | None:
        """What came last."""
        return self._moments[-1] if self._moments else None

    def moments(self) -> tuple[Moment, ...]:
        """All that is remembered, oldest first."""
        return tuple(self._moments)

    def add(self, moment: Moment) -> None:
        """Remember a moment, and forget the oldest where it gets too much."""
        self._moments.append(moment)
        self._bytes += size(moment)
        while len(self._moments) > LENGTH or (self._bytes > MEMORY and len(self._moments) > 2):
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


def size(moment: Moment) -> int:
    """Bytes of the moment's arrays."""
    return sum(v.nbytes for v in moment.pressures.values()) + sum(
        v.nbytes for v in moment.raw.values()
    )

"""Content of a recording, second by second, to be read at once whatever its length."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray

NAME = "overview.csv"  # the attachment
COLUMNS = "second,part,largest,taxels,marks"
TOUCHED = 12.0  # counts from its rest at which a taxel counts as touched, as for contacts
FOLLOWS = 0.1  # of what a taxel at rest differs from its rest, taken over each second
HANGS = 60  # seconds after which what never moved is its rest


@dataclass(frozen=True, eq=False, slots=True)
class Overview:
    """Seconds in which parts are touched, or a marked touch begins.

    Attributes
    ----------
    seconds : (k,) int
        By the recording's clock, rounded down.
    parts : (k,) int
        Numbers of the parts.
    largest : (k,) float
        Largest change of a taxel from its rest [counts].
    taxels : (k,) int
        That changed by more than `TOUCHED`.
    marks : (k,) int
        Touches that were marked and begin in that second.
    """

    seconds: IntArray
    parts: IntArray
    largest: FloatArray
    taxels: IntArray
    marks: IntArray

    @classmethod
    def parse(cls, data: bytes, names: Sequence[str]) -> Overview | None:
        """An overview of some parts from its table; None where there is none, or it is damaged."""
        numbers = {name: number for number, name in enumerate(names)}
        head, *lines = data.decode("utf-8", "replace").split("\n")
        cells = [line.split(",") for line in lines if line]
        if head != COLUMNS or any(len(row) != 5 or row[1] not in numbers for row in cells):
            return None
        try:
            table = np.array([(row[0], *row[2:]) for row in cells], np.float64).reshape(-1, 4)
        except ValueError:
            return None
        parts = np.array([numbers[row[1]] for row in cells], np.int64)
        if not np.isfinite(table).all():
            return None
        second, taxels, marks = table[:, [0, 2, 3]].astype(np.int64).T
        return cls(second, parts, table[:, 1], taxels, marks)

    def to_bytes(self, names: Sequence[str]) -> bytes:
        """The table, the parts by their names."""
        columns = (self.seconds, self.parts, self.largest, self.taxels, self.marks)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        lines = [f"{a},{names[b]},{c:.4g},{d},{e}" for a, b, c, d, e in rows]
        return "\n".join([COLUMNS, *lines, ""]).encode()

    def marked(self, began: Iterable[tuple[int, float]]) -> Overview:
        """The same with other marks: number of the part and beginning [s] of each."""
        keys = zip(self.seconds.tolist(), self.parts.tolist(), strict=True)
        felt = zip(self.largest.tolist(), self.taxels.tolist(), strict=True)
        table = {key: [*own, 0] for key, own in zip(keys, felt, strict=True) if own[1]}
        for part, time in began:
            table.setdefault((math.floor(time), part), [0.0, 0, 0])[2] += 1
        order = sorted(table)
        rows = np.array([(*key, *table[key]) for key in order], np.float64).reshape(-1, 5)
        seconds, parts, taxels, marks = rows[:, [0, 1, 3, 4]].astype(np.int64).T
        return replace(
            self, seconds=seconds, parts=parts, largest=rows[:, 2], taxels=taxels, marks=marks
        )

    def touched(self, part: int) -> list[tuple[float, float]]:
        """Beginning and end [s] of the runs of seconds in which a part was touched."""
        own = self.seconds[(self.parts == part) & (self.taxels > 0)]
        runs = np.split(own, np.flatnonzero(np.diff(own) > 1) + 1) if len(own) else []
        return [(float(run[0]), float(run[-1]) + 1.0) for run in runs]


@dataclass(eq=False, slots=True)
class OverviewMaker:
    """Sums samples up while they are written.

    Attributes
    ----------
    widths : sequence of int
        Channels of each part.
    raw : bool
        Whether the values are raw; pressures rest at 0.
    even : bool
        Whether all samples had as many values as there are channels.
    """

    widths: Sequence[int]
    raw: bool
    even: bool = True
    _rows: list[tuple[int, int, float, int]] = field(default_factory=list)
    _marks: set[tuple[int, int, float]] = field(default_factory=set)
    _second: int | None = None
    _count: int = 0
    _low: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    _high: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    _rest: NDArray[np.float32] | None = None
    _held: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def add(self, time: float, values: NDArray[Any]) -> None:
        """Take a sample (channels,) of a time [s]."""
        second = math.floor(time)
        self.even &= len(values) == sum(self.widths)
        if not self.even:
            return
        if second != self._second:
            self._end()
            self._second = second
            self._low, self._high = values.astype(np.float32), values.astype(np.float32)
        else:
            np.fmin(self._low, values, out=self._low, casting="unsafe")
            np.fmax(self._high, values, out=self._high, casting="unsafe")
        self._count += 1

    def mark(self, part: int, event: int, time: float) -> None:
        """Take the beginning of a marked touch [s], once however often it comes."""
        self._marks.add((part, event, time))

    def overview(self) -> Overview:
        """All that was taken."""
        self._end()
        self._second = None
        rows = np.array(self._rows, np.float64).reshape(-1, 4)
        seconds, parts, taxels = rows[:, [0, 1, 3]].astype(np.int64).T
        made = Overview(seconds, parts, rows[:, 2], taxels, np.zeros_like(taxels))
        return made.marked((part, time) for part, _, time in self._marks)

    def _end(self) -> None:
        """Sum up the second that is over."""
        if self._second is None or self._count == 0:
            return
        low, high = self._low, self._high
        middle = (low + high) / 2
        if self._rest is None:
            # A pressure that is high from the beginning hangs, or will be known to be touched.
            known = self.raw | (low > TOUCHED)
            self._rest = np.where(known, middle, np.float32(0.0))
            self._held = np.zeros(len(middle), np.int64)
        rest = self._rest
        change = np.nan_to_num(np.maximum(high - rest, rest - low), nan=0.0, posinf=0.0)
        touched = change > TOUCHED
        self._held = np.where(touched, self._held + 1, 0)
        over = self._held > HANGS
        moved = np.where(over, 1.0, np.where(touched, 0.0, FOLLOWS if self.raw else 0.0))
        self._rest = np.where(np.isfinite(middle), rest + moved * (middle - rest), rest)
        starts = np.concatenate([[0], np.cumsum(self.widths)[:-1]]).astype(np.int64)
        counts = np.add.reduceat(touched, starts, dtype=np.int64)
        largest = np.maximum.reduceat(change, starts)
        for part in np.flatnonzero(counts).tolist():
            self._rows.append((self._second, part, float(largest[part]), int(counts[part])))
        self._count = 0

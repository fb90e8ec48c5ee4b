"""Streams of samples: their descriptions, and streams as they were recorded.

An overview holds a recording second by second, so that one of any length is read at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray, check_finite, freeze
from skinmap.errors import DataFormatError, InvalidArrayError, check_known, warn
from skinmap.skin.skin import Skin
from skinmap.skin.taxels import TaxelTable
from skinmap.touch.recording import Recording, TrueMotion

OVERVIEW = "overview.csv"  # the attachment
OVERVIEW_COLUMNS = "second,part,largest,taxels,marks"
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
    def of(cls, rows: Iterable[Sequence[Any]]) -> Overview:
        """Of rows with the five numbers each; InvalidArrayError for what is none."""
        table = check_finite(np.array(list(rows), np.float64).reshape(-1, 5), "rows", (None, 5))
        seconds, parts, taxels, marks = table[:, [0, 1, 3, 4]].astype(np.int64).T
        return cls(seconds, parts, table[:, 2], taxels, marks)

    @classmethod
    def parse(cls, data: bytes, names: Sequence[str]) -> Overview | None:
        """An overview of some parts from its table; None where there is none, or it is damaged."""
        numbers = {name: number for number, name in enumerate(names)}
        head, *lines = data.decode("utf-8", "replace").split("\n")
        cells = [line.split(",") for line in lines if line]
        if head != OVERVIEW_COLUMNS or any(len(row) != 5 or row[1] not in numbers for row in cells):
            return None
        try:
            return cls.of((row[0], numbers[row[1]], *row[2:]) for row in cells)
        except ValueError:
            return None

    def to_bytes(self, names: Sequence[str]) -> bytes:
        """The table, the parts by their names."""
        columns = (self.seconds, self.parts, self.largest, self.taxels, self.marks)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        lines = [f"{a},{names[b]},{c:.4g},{d},{e}" for a, b, c, d, e in rows]
        return "\n".join([OVERVIEW_COLUMNS, *lines, ""]).encode()

    def marked(self, began: Iterable[tuple[int, float]]) -> Overview:
        """The same with other marks: number of the part and beginning [s] of each."""
        columns = (self.seconds, self.parts, self.largest, self.taxels)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        table = {(second, part): [largest, n, 0] for second, part, largest, n in rows if n}
        for part, time in began:
            table.setdefault((math.floor(time), part), [0.0, 0, 0])[2] += 1
        return Overview.of((*key, *table[key]) for key in sorted(table))

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

    def mark(self, part: int, event: int, time: float) -> None:
        """Take the beginning of a marked touch [s], once however often it comes."""
        self._marks.add((part, event, time))

    def overview(self) -> Overview:
        """All that was taken."""
        self._end()
        self._second = None
        made = Overview.of((*row, 0) for row in self._rows)
        return made.marked((part, time) for part, _, time in self._marks)

    def _end(self) -> None:
        """Sum up the second that is over."""
        if self._second is None:
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


Kind = Literal["raw", "pressure"]
BLOCK = 1024  # samples that are read at once
GAP = 1.5  # median steps between two samples that count as a gap
EVEN = 20  # steps that a told rate is compared with, at least
UNEVEN = 0.4  # of the median step: what half of the steps differ by where they are of any length
ENOUGH = 8  # samples to judge that
COARSE = 0.9  # of steps that move a clock fine enough to tell samples apart
NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """What a source says of itself before the first sample.

    Attributes
    ----------
    name : str
        Of the stream.
    parts : tuple of str
        Parts of the robot whose values follow each other in every sample.
    widths : tuple of int
        Channels of each part in the sample: its taxels in dense order, or its live vector (the
        taxels then stand at `Skin.channels`).
    rate : float
        Nominal samples a second; 0 where they come when they like.
    kind : {"raw", "pressure"}
        What the sensors send, or what a response calibration made of it (0 at rest, to 255).
    robot : str
        Name of the robot; empty where unknown.
    fingerprints : mapping of str to str
        Of the skin of each part (`skinmap.skin.skin.fingerprint(skin)`),
        where known.
    clock : str
        Whose seconds the times are: "recording", "local" (this machine's monotonic clock) ...
    """

    name: str
    parts: tuple[str, ...]
    widths: tuple[int, ...]
    rate: float
    kind: Kind = "pressure"
    robot: str = ""
    fingerprints: Mapping[str, str] = field(default_factory=dict)
    clock: str = "recording"

    def __post_init__(self) -> None:
        if len(self.parts) != len(self.widths) or len(set(self.parts)) != len(self.parts):
            raise InvalidArrayError(
                f"stream {self.name!r}: {len(self.parts)} parts (each once) and as many widths "
                f"expected, got {self.parts} and {self.widths}"
            )
        if not self.parts or min(self.widths) < 1:
            raise InvalidArrayError(f"stream {self.name!r}: no channels")
        if not np.isfinite(self.rate) or self.rate < 0:
            raise InvalidArrayError(f"stream {self.name!r}: rate {self.rate} samples a second")

    @property
    def channels(self) -> int:
        """Values in one sample."""
        return sum(self.widths)

    def part_slice(self, part: str) -> slice:
        """Where a part's channels stand in a sample.

        Raises
        ------
        UnknownNameError
            The stream has no such part.
        """
        check_known(f"part in stream {self.name!r}", [part], self.parts)
        row = self.parts.index(part)
        start = sum(self.widths[:row])
        return slice(start, start + self.widths[row])

    def only(self, parts: Sequence[str]) -> tuple[StreamInfo, IntArray]:
        """Some parts, each once, and the columns (k,) of their channels.

        Raises
        ------
        UnknownNameError
            The stream has no such part.
        """
        slices = {part: self.part_slice(part) for part in dict.fromkeys(parts)}
        known = {part: mark for part, mark in self.fingerprints.items() if part in slices}
        widths = tuple(one.stop - one.start for one in slices.values())
        some = replace(self, parts=tuple(slices), widths=widths, fingerprints=known)
        return some, np.concatenate([np.arange(one.start, one.stop) for one in slices.values()])


class Samples(Protocol):
    """Rows of values: an array (t, channels), or a file that reads them when asked."""

    def __len__(self) -> int:
        """Samples."""

    def __getitem__(self, rows: slice, /) -> NDArray[Any]:
        """Some of them (k, channels), float32 or uint8."""


@dataclass(frozen=True, slots=True)
class MarkedTouch:
    """A touch that was marked while recording.

    Attributes
    ----------
    part : str
    event : int
        Number of the touch on its part.
    label : str
    first, last : int
        Rows of its first and last sample; last < first where it has none.
    subject : int
        Who touched.
    owners : mapping of str to list of int, or None
        Taxels (dense rows) of each of the touches that the label joins, by their number.
    session, person : str
        When it was recorded, and who touched, in words; empty where nobody said.
    motion : TrueMotion, optional
        Its true way, presses and speed, where they are known.
    channels : tuple of int
        Places of its taxels in the live vector of the part; empty where nobody noted them.
    answers : mapping, optional
        `kind`, `motion` and `hand` as JSON has them, where a model answered.
    """

    part: str
    event: int
    label: str
    first: int
    last: int
    subject: int = 0
    owners: Mapping[str, list[int]] | None = None
    session: str = ""
    person: str = ""
    motion: TrueMotion | None = None
    channels: tuple[int, ...] = ()
    answers: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Loss:
    """What a recording lacks.

    Attributes
    ----------
    recovered : bool
        Whether the file was cut off or damaged, so that its samples had to be collected.
    seconds : float
        Time whose samples are lost: those missing inside, by their numbers, and at the end what
        the last chunk says of itself, or as much as a chunk may hold.
    damage : tuple of str
        What was wrong, and where.
    """

    recovered: bool = False
    seconds: float = 0.0
    damage: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class RecordedStream:
    """Samples of one kind, all parts beside each other.

    Attributes
    ----------
    info : StreamInfo
        Whose samples they are; its rate is the measured one where nobody said.
    times : (t,) float
        [s], not decreasing.
    values : Samples
    touches : tuple of MarkedTouch
    joints : tuple of str
    angles : (t, j) float
        Joint angles [rad] of each sample; NaN where none was recorded.
    tables : mapping of str to TaxelTable
        The skin that came with the recording.
    loss : Loss
    samples : mapping of str to int
        How many of the first samples each part really has; the others rest at zero.
    manifest : str
        What `skinmap.load_robot` loads the robot by; empty where the file does not say.
    overview : Overview, optional
        What is in it second by second, where the file has that.
    """

    info: StreamInfo
    times: FloatArray
    values: Samples
    touches: tuple[MarkedTouch, ...] = ()
    joints: tuple[str, ...] = ()
    angles: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    tables: Mapping[str, TaxelTable] = field(default_factory=dict)
    loss: Loss = field(default_factory=Loss)
    samples: Mapping[str, int] = field(default_factory=dict)
    manifest: str = ""
    overview: Overview | None = None

    def __post_init__(self) -> None:
        times = check_finite(self.times, "times", (None,))
        if len(times) != len(self.values):
            raise InvalidArrayError(f"{len(times)} times for {len(self.values)} samples")
        if (np.diff(times) < 0).any():
            raise InvalidArrayError("times must not run backwards")
        freeze(self, times=times)
        if self.info.rate == 0:
            object.__setattr__(self, "info", replace(self.info, rate=measured_rate(times)))

    @property
    def kind(self) -> Kind:
        """Raw values or pressures."""
        return self.info.kind

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts whose values stand beside each other."""
        return self.info.parts

    def columns(self, part: str) -> slice:
        """Where the values of a part stand in a sample."""
        return self.info.part_slice(part)

    def blocks(self) -> Iterator[tuple[slice, NDArray[Any]]]:
        """Rows and samples, `BLOCK` at a time: a day of a whole robot fits no memory."""
        for start in range(0, len(self.times), BLOCK):
            rows = slice(start, min(start + BLOCK, len(self.times)))
            yield rows, self.values[rows]

    @property
    def seconds(self) -> float:
        """From the first sample to the end of the last."""
        if len(self.times) == 0:
            return 0.0
        step = 1.0 / self.info.rate if self.info.rate > 0 else 0.0
        return float(self.times[-1] - self.times[0]) + step

    @property
    def gaps(self) -> int | None:
        """How often more than one and a half steps, or ticks of the clock, passed unseen.

        None where no rate is known and the steps vary: no step is too long then.
        """
        if self.info.rate == measured_rate(self.times) and _uneven(self.times):
            return None
        return int((np.diff(self.times) > GAP * max(_step_and_tick(self.times))).sum())


def measured_rate(times: FloatArray) -> float:
    """Samples a second by the usual step; 0 where two samples are not there."""
    return 1.0 / step if (step := _step_and_tick(times)[0]) else 0.0


def rate_by_times(times: FloatArray, told: float) -> float:
    """Samples a second: the told rate, unless even steps contradict it.

    Steps that vary, as of samples that are lost or stamped on arrival, contradict nothing.
    """
    steps = np.diff(times)
    if told <= 0 or len(steps) < EVEN:
        return told
    low, usual, high = np.quantile(steps, (0.25, 0.5, 0.75)).tolist()
    mean = float(steps[steps <= max(1.0, 3.0 * usual)].mean())
    even = min(low, mean) > 0.75 * usual and max(high, mean) < 1.25 * usual
    off = not 0.75 < usual * told < 1.33 and usual * told < 100.0  # more: another unit
    return 1.0 / usual if even and off else told


def _uneven(times: FloatArray) -> bool:
    """Whether steps vary so that their median is no rate."""
    step, tick = _step_and_tick(times)
    if tick or len(times) < ENOUGH:
        return False
    low, high = np.percentile(np.diff(times), (25, 75))
    return bool(high - low > UNEVEN * step)


def _step_and_tick(times: FloatArray) -> tuple[float, float]:
    """The usual step between samples [s], and that of a clock too coarse to tell them apart."""
    steps = np.diff(times)
    if (moved := steps[steps > 0]).size > COARSE * len(steps):
        return float(np.median(steps)), 0.0
    tick = float(np.median(moved)) if len(moved) else 0.0
    return float(steps[steps <= GAP * tick].mean()) if tick else 0.0, tick


def whole_counts(values: NDArray[Any]) -> bool:
    """Whether values are whole and lie in 0..255, so that a byte holds each."""
    if values.dtype == np.uint8:
        return True
    if not (values.min(initial=0) >= 0 and values.max(initial=0) <= 255):
        return False  # NaN too
    return bool((values == np.floor(values)).all())


def seconds_of(nanoseconds: NDArray[np.uint64]) -> FloatArray:
    """Whole nanoseconds as the nearest seconds; a hair off beyond 104 days."""
    # Up to 2^53 both numbers are exact as floats, so that one division rounds once.
    if nanoseconds.max(initial=0) < 2**53:
        return nanoseconds / NS
    whole, rest = np.divmod(nanoseconds, NS)
    return np.where(nanoseconds < 2**53, nanoseconds / NS, whole + rest / NS)


SMALLER = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}


def nanoseconds_of(seconds: float) -> int:
    """Seconds as whole nanoseconds; never negative, as MCAP knows none.

    Raises
    ------
    InvalidArrayError
        Before zero, not finite, or after the year 2500.
    """
    if not 0.0 <= seconds < 2**34:
        fits = [unit for unit, scale in SMALLER.items() if 0.0 <= seconds / scale < 2**34]
        hint = f": are these {fits[0]}?" if fits else ""
        raise InvalidArrayError(
            f"a sample's time must lie in 0..{2**34} seconds, got {seconds}{hint}"
        )
    whole = int(seconds)
    return whole * NS + round((seconds - whole) * NS)


def warn_of_loss(track: RecordedStream, path: Path) -> RecordedStream:
    """The same recording, with a warning where it was cut off or damaged: what it lost and where.

    For whoever goes on with the samples that are left; `skinmap info` prints the same as facts.
    """
    loss = track.loss
    if loss.recovered:
        warn(
            f"{str(path)!r} was cut off or damaged: {loss.seconds:.2f} s of samples are lost "
            f"({'; '.join(loss.damage[:2]) or 'stated by the file itself'})",
            above=1,
        )
    elif len(track.times) == 0:
        warn(f"{path.name}: no samples", above=1)
    return track


@dataclass(frozen=True, eq=False, slots=True)
class PartEvents:
    """Event of each sample (t,), and of each event what is known of it; see `Recording`."""

    events: IntArray
    labels: tuple[str, ...]
    subjects: IntArray
    owners: IntArray | None
    sessions: tuple[str, ...]
    people: tuple[str, ...]
    motions: tuple[TrueMotion | None, ...]  # empty where none is known

    def known(self) -> dict[str, Any]:
        """As `Recording` takes them."""
        return {one.name: getattr(self, one.name) for one in fields(self)}


def touches_of(part: str, of: Recording | PartEvents) -> list[MarkedTouch]:
    """Where each event begins and ends; more than once where it was interrupted."""
    events = of.events
    changes = np.flatnonzero(np.diff(events, prepend=-1, append=-1))
    return [
        MarkedTouch(
            part,
            event,
            of.labels[event],
            first,
            after - 1,
            int(of.subjects[event]),
            _owners(of, event),
            of.sessions[event],
            of.people[event],
            of.motions[event] if of.motions else None,
        )
        for first, after in zip(changes[:-1].tolist(), changes[1:].tolist(), strict=True)
        if (event := int(events[first])) >= 0
    ]


def _owners(of: Recording | PartEvents, event: int) -> dict[str, list[int]] | None:
    if of.owners is None:
        return None
    owners = of.owners[event]
    return {
        str(one): np.flatnonzero(owners == one).tolist()
        for one in range(int(owners.max(initial=-1)) + 1)
    }


def taxel_columns(
    channels: NDArray[Any] | None, width: int, part: str, path: Path
) -> IntArray | slice:
    """Columns of a part's taxels among its values: all, or their channels in the live vector.

    Raises
    ------
    DataFormatError
        Fewer values than the taxels need.
    """
    if channels is None or len(channels) == width:
        return slice(None)
    if int(np.max(channels, initial=-1)) >= width:
        raise DataFormatError(f"{width} channels of {part!r}, its taxels need more", path)
    return np.asarray(channels, np.int64)


def sample_columns(skins: Iterable[Skin], widths: Sequence[int]) -> IntArray:
    """Columns (n,) of a sample in which the taxels of some parts stand, part after part.

    Where a part has as many columns as taxels they are in dense order, else the live vector.
    """
    starts = np.cumsum([0, *widths[:-1]]).tolist()
    return np.concatenate([
        start + (np.arange(width) if width == len(skin) else skin.channels)
        for skin, width, start in zip(skins, widths, starts, strict=True)
    ])  # fmt: skip


def part_events(touches: Sequence[MarkedTouch], count: int, taxels: int, path: Path) -> PartEvents:
    """Events of the first samples of a part.

    Raises
    ------
    DataFormatError
        Owners that are no taxels.
    """
    marked = {one.event: one for one in touches if 0 <= one.first <= one.last < count}
    place = {number: row for row, number in enumerate(sorted(marked))}
    events = np.full(count, -1)
    for touch in touches:
        if 0 <= touch.first <= touch.last < count:
            span = events[touch.first : touch.last + 1]
            span[span < 0] = place[touch.event]  # what began first keeps its samples
    own = [marked[number] for number in place]
    owners = None
    if any(touch.owners for touch in touches):
        rows = [_owner_row(one.owners or {}, taxels, path) for one in own]
        owners = np.array(rows, np.int64).reshape(-1, taxels)
    motions = tuple(one.motion for one in own)
    return PartEvents(
        events,
        tuple(one.label for one in own),
        np.array([one.subject for one in own], np.int64),
        owners,
        tuple(one.session for one in own),
        tuple(one.person for one in own),
        motions if any(motions) else (),
    )


def _owner_row(owners: Mapping[str, list[int]], taxels: int, path: Path) -> IntArray:
    row = np.full(taxels, -1)
    for name, members in owners.items():
        try:
            row[np.asarray(members, np.int64)] = int(name)
        except (ValueError, IndexError, TypeError, OverflowError):
            raise DataFormatError(f"owner {name!r} of a touch is damaged", path) from None
    return row


def overview_of(track: RecordedStream, touches: Sequence[MarkedTouch]) -> bytes:
    """The overview of a recording with these touches, by its own samples where it has none."""
    made = track.overview
    if made is None:
        maker = OverviewMaker(track.info.widths, track.kind == "raw")
        for rows, values in track.blocks():
            for time, row in zip(track.times[rows].tolist(), values, strict=True):
                maker.add(time, row)
        made = maker.overview()
    began = [(track.parts.index(one.part), float(track.times[one.first])) for one in touches]
    return made.marked(began).to_bytes(track.parts)

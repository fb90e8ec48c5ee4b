"""Where samples come from: one contract for recordings, the simulator and live streams.

for block in skinmap.live.open_source("lsl:demo"):
    block.times, block.values

What has happened to the samples of a stream, on the way and here: one set of names.

What a stream says of the skin it comes from, and whether it is the skin we have.

`PolledSource` is a source of one part, made of a function that asks a device for new samples.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray, check_finite, freeze
from skinmap.errors import BrokenPluginError, InvalidArrayError, SkinMismatchError, UnreachableError
from skinmap.io.recordings.recorded_stream import Kind, StreamInfo, sample_columns
from skinmap.live.bounded_queue import BoundedQueue
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, fingerprint


@dataclass(slots=True)
class Counts:
    """Counts of a stream's samples; each station keeps its own.

    Attributes
    ----------
    received : int
        Number of samples that arrived.
    used : int
        Number of samples used for contacts.
    lost : int
        Number of samples missing by the transport's numbers or by the times.
    dropped : int
        Left out because they were not used in time.
    refused : int
        Messages that do not follow their layout.
    late, repeated : int
        Older than one that came before; of the same time: left out.
    short, long : int
        With too few or too many values: left out.
    nan, out_of_range : int
        With such values: those of the last sample stand in, or the end of the range.
    restarts : int
        Times that the clock began anew.
    stale, reconnects : int
        Times that nothing came for a while, and that a lost source was had again.
    failed : int
        Calls of subscribers that failed.
    """

    received: int = 0
    used: int = 0
    lost: int = 0
    dropped: int = 0
    refused: int = 0
    late: int = 0
    repeated: int = 0
    short: int = 0
    long: int = 0
    nan: int = 0
    out_of_range: int = 0
    restarts: int = 0
    stale: int = 0
    reconnects: int = 0
    failed: int = 0

    def as_dict(self) -> dict[str, int]:
        """By name."""
        return asdict(self)

    def faults(self) -> str:
        """What went wrong on the way, in words; empty where nothing did.

        Examples
        --------
        >>> from skinmap.live.sources.source import Counts
        >>> Counts(received=300, lost=23, refused=4).faults()
        '23 lost, 4 messages refused'
        """
        found = ((getattr(self, name), words) for name, words in FAULTS.items())
        return ", ".join(f"{count} {words}" for count, words in found if count)

    def add_misfits(self, samples: int, width: int, channels: int) -> None:
        """Count samples of another number of values than the stream's channels."""
        self.short += samples * (width < channels)
        self.long += samples * (width > channels)

    def joined(self, theirs: Counts) -> Counts:
        """These and what a source counted on the way."""
        both = {name: getattr(self, name) + getattr(theirs, name) for name in self.__slots__}
        # Both see these: the larger one knows more.
        for name in ("received", "lost"):
            both[name] = max(getattr(self, name), getattr(theirs, name))
        return Counts(**both)


FAULTS = {
    "lost": "lost",
    "refused": "messages refused",
    "late": "late",
    "repeated": "given twice",
    "short": "with too few values",
    "long": "with too many values",
    "nan": "with NaN",
    "out_of_range": "out of 0 to 255 counts",
    "restarts": "restarts of the clock",
    "reconnects": "reconnections",
}


__all__ = [
    "MAX_BLOCK",
    "Block",
    "Kind",
    "Relay",
    "Seekable",
    "Source",
    "SourceEnded",
    "StreamInfo",
    "blocks",
    "is_live",
]


MAX_BLOCK = 256  # samples in one: what is given at once stays small
logger = logging.getLogger(__name__)
SIMULATION = "simulation"  # the clock of samples that are made when they are asked for


@dataclass(frozen=True, eq=False, slots=True)
class Block:
    """k samples that came together.

    Attributes
    ----------
    times : (k,) float
        In the source's clock [s].
    values : (k, channels) float32 or uint8
        As sent.
    arrived : float
        `time.perf_counter()` when the newest of them came.
    """

    times: FloatArray
    values: NDArray[Any]
    arrived: float

    def __post_init__(self) -> None:
        times = check_finite(self.times, "times", (None,))
        values = np.asarray(self.values)
        if values.ndim != 2 or len(values) != len(times):
            raise InvalidArrayError(f"{len(times)} times with values of shape {values.shape}")
        freeze(self, times=times, values=values)

    def __len__(self) -> int:
        return len(self.times)


class Source(ABC):
    """Where samples come from. A source of your own derives from this one.

    It says in `info` what it sends, and defines `read` and `close`. The other members have the
    answers of a live source that counts nothing; override those for which yours knows better.

    Parameters
    ----------
    info : StreamInfo
        Skin, channels, rate and clock.

    Examples
    --------
    >>> import time
    >>> import numpy as np
    >>> from skinmap.live.sources.source import Block, SourceEnded, StreamInfo
    >>> class Ten(Source):
    ...     left = 10
    ...     def read(self, timeout):
    ...         if not self.left:
    ...             raise SourceEnded
    ...         self.left -= 1
    ...         return Block(np.array([-0.1 * self.left]), np.zeros((1, 3)), time.perf_counter())
    ...     def close(self):
    ...         self.left = 0
    >>> source = Ten(StreamInfo("ten", ("palm",), (3,), 10.0))
    >>> source.read(1.0).values.shape, source.alive
    ((1, 3), True)
    """

    def __init__(self, info: StreamInfo) -> None:
        self._info = info
        self._counts = Counts()
        self._last_seen = math.nan

    @abstractmethod
    def read(self, timeout: float) -> Block | None:
        """What has come since the last call; None when nothing comes within `timeout` [s].

        Raises
        ------
        SourceEnded
            Nothing more will come: a recording is over, or the source was closed.
        UnreachableError
            A live source died and cannot be had again.
        """

    @abstractmethod
    def close(self) -> None:
        """Give threads, sockets and files back; may be called twice."""

    @property
    def info(self) -> StreamInfo:
        """Skin, channels, rate and clock."""
        return self._info

    @property
    def counts(self) -> Counts:
        """What became of the samples on the way."""
        return self._counts

    @property
    def last_seen(self) -> float:
        """`time.perf_counter()` of the last sign of life; NaN where it is not noted."""
        return self._last_seen

    @property
    def alive(self) -> bool:
        """Whether it is there: that it gave a sign of life within the last second, where noted."""
        return not time.perf_counter() - self._last_seen >= SILENT

    @property
    def seekable(self) -> bool:
        """Whether its times may jump: a recording is led, and starts again."""
        return False

    @property
    def speed(self) -> float:
        """Speed as a multiple of its clock's; `inf` gives all at once, 0 halts."""
        return 1.0

    def angles_at(self, time: float) -> Mapping[str, float]:
        """Joint angles [rad] at a sample's time [s]; empty where there are none."""
        return {}

    def _refuse(self, where: str, why: Exception) -> None:
        """Count a message that is none of this stream; only the first one is a warning."""
        level = logging.DEBUG if self._counts.refused else logging.WARNING
        self._counts.refused += 1
        logger.log(level, "%s: refused: %s", where, why)


class Seekable(Source):
    """A source that can be led through time: a recording.

    Attributes
    ----------
    speed : float
        Speed as a multiple of the recorded one; `inf` gives all at once, 0 halts.
    loop : bool
        Whether it starts again at its end.
    duration, position : float
        Length, and place of the sample that comes next, from the beginning [s].

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> touches = skinmap.simulate(robot.skin("torso"), gestures=["poke"], per_gesture=1, rng=0)
    >>> skinmap.save_recordings(touches, "touches.mcap", robot=robot)
    >>> source = skinmap.live.open_recording("touches.mcap", speed=float("inf"))
    >>> isinstance(source, skinmap.live.Seekable)
    True
    >>> source.seek(0.2)
    >>> round(source.position, 3)
    0.2
    """

    speed: float
    loop: bool

    @property
    def seekable(self) -> bool:
        """Always."""
        return True

    @property
    @abstractmethod
    def duration(self) -> float:
        """[s]."""

    @property
    @abstractmethod
    def position(self) -> float:
        """Seconds from its beginning."""

    @abstractmethod
    def seek(self, seconds: float) -> None:
        """Go on from there."""


def _theirs(name: str) -> Any:
    """A member that is the other source's own."""
    return property(
        lambda self: getattr(self.source, name),
        lambda self, value: setattr(self.source, name, value),
        doc="Theirs.",
    )


class Relay(Source):
    """A source that hands on another one's samples; what it does not change is the other's.

    Parameters
    ----------
    source : Source
        Closed with this.

    Attributes
    ----------
    source : Source
        The other one.

    Examples
    --------
    >>> import skinmap
    >>> class Halved(skinmap.live.Relay):
    ...     def read(self, timeout):
    ...         block = self.source.read(timeout)
    ...         return block and type(block)(block.times, block.values // 2, block.arrived)
    >>> robot = skinmap.load_robot("kaspar")
    >>> source = skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    >>> half = Halved(source)
    >>> half.info == source.info
    True
    >>> half.close()
    """

    def __init__(self, source: Source) -> None:
        super().__init__(source.info)
        self.source = source

    def read(self, timeout: float) -> Block | None:
        """What the source gives."""
        return self.source.read(timeout)

    def close(self) -> None:
        """Close the source."""
        self.source.close()

    counts, last_seen, alive = map(_theirs, ("counts", "last_seen", "alive"))
    seekable, speed, angles_at = map(_theirs, ("seekable", "speed", "angles_at"))


def is_live(source: Source) -> bool:
    """Whether samples come whether or not the reader keeps up.

    What is no recording and no simulation is live. Only with a live source may the clock of this
    machine decide how much is done with a sample.
    """
    return not source.seekable and source.info.clock != SIMULATION


class SourceEnded(EOFError):  # noqa: N818 - no error: a recording has an end
    """Nothing more will come."""

    def __init__(self, words: str = "the source has ended: nothing more will come") -> None:
        super().__init__(words)


def blocks(source: Source, *, timeout: float = 1.0) -> Iterator[Block]:
    """All that comes, until the source ends; nothing is yielded while it is silent."""
    while True:
        try:
            block = source.read(timeout)
        except SourceEnded:
            return
        if block is not None:
            yield block


def live_width(skin: Skin) -> int:
    """Channels of a part's live vector as far as taxels use it."""
    return int(skin.channels.max(initial=-1)) + 1


PATCH = 192  # channels of a board of the iCub's skin: its ports send whole boards


def _widths_of(skins: Sequence[Skin]) -> list[tuple[int, ...]]:
    """Channels of some parts: in dense order, of live vectors as far as used, of whole boards."""
    live = tuple(map(live_width, skins))
    return [tuple(map(len, skins)), live, tuple(-(-one // PATCH) * PATCH for one in live)]


def check_skin(info: StreamInfo, robot: Robot) -> None:
    """Refuse a stream that cannot come from a robot's skin.

    Raises
    ------
    UnknownNameError
        A part that the robot has not.
    SkinMismatchError
        A part with too few channels for its taxels, or with another layout.
    """
    for part, width in zip(info.parts, info.widths, strict=True):
        skin = robot.skin(part)
        if width != len(skin) and width < live_width(skin):
            raise SkinMismatchError(
                f"stream {info.name!r} has {width} channels for {part!r}; its {len(skin)} taxels "
                f"on {robot.name!r} need {len(skin)}, or {live_width(skin)} of the live vector"
            )
        theirs = info.fingerprints.get(part)
        if theirs is not None and theirs != fingerprint(robot.skin(part)):
            raise SkinMismatchError(
                f"stream {info.name!r} comes from another skin: the layout of {part!r} "
                f"is not that of {robot.name!r}"
            )


def gather(info: StreamInfo, skins: Mapping[str, Skin]) -> IntArray:
    """(N,) place in a stream's sample of each taxel of some parts, in dense rows."""
    some, columns = info.only(tuple(skins))
    return columns[sample_columns(skins.values(), some.widths)]


def describe_skins(
    name: str, robot: str, skins: Iterable[Skin], rate: float, kind: Kind, clock: str
) -> StreamInfo:
    """What a stream says that sends each skin's taxels in dense order."""
    known = {skin.part: skin for skin in skins}
    widths = tuple(map(len, known.values()))
    prints = {part: fingerprint(skin) for part, skin in known.items()}
    return StreamInfo(name, tuple(known), widths, rate, kind, robot, prints, clock)


def of_robot(
    info: StreamInfo, robot: Robot, parts: Sequence[str] | None, what: str = "channels"
) -> StreamInfo:
    """A stream that names no part, as that of all parts asked for, or of the only one of its width.

    Raises
    ------
    SkinMismatchError
        None or several have so many taxels, or live vectors so long.
    """
    asked = [robot.skin(part) for part in parts or robot.parts]
    for kind in range(3):  # dense order first: it is the surest
        choices = [asked] if len(asked) > 1 else []
        choices += [[skin] for skin in asked]
        fitting = [one for one in choices if sum(_widths_of(one)[kind]) == info.channels]
        if fitting:
            break
    if len(fitting) == 1 or (fitting and fitting[0] is asked):
        skins, widths = fitting[0], _widths_of(fitting[0])[kind]
        found = describe_skins(info.name, robot.name, skins, info.rate, info.kind, info.clock)
        return replace(found, widths=widths)
    names = [one[0].part for one in fitting] or [skin.part for skin in asked]
    sizes = ", ".join(f"{one.part} {len(one)} or {live_width(one)}" for one in asked)
    few = f" (taxels or live vector: {sizes})" if len(asked) < 5 else ""  # a line is short
    none = f"none of {', '.join(names)} has so many on {robot.name!r}{few}"
    none += "; --robot names another robot, one's own too"
    raise SkinMismatchError(
        f"stream {info.name!r} names no part and has {info.channels} {what}; "
        + (f"{', '.join(names)} have so many: give --part" if fitting else none)
    )


def check_same_skin(before: StreamInfo, now: StreamInfo, what: str) -> None:
    """Refuse to go on with a stream that came back with another skin.

    Raises
    ------
    SkinMismatchError
    """
    names = "parts", "widths", "kind", "fingerprints"
    if any(getattr(before, name) != getattr(now, name) for name in names):
        layout = before.fingerprints != now.fingerprints
        raise SkinMismatchError(
            f"{what}: {now.channels} {now.kind} channels of {', '.join(now.parts)}"
            + " in another layout" * layout
        )


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


POLL = 0.2  # asked for at a time [s]
MARGIN = 1.0  # after which a `read` has not kept its timeout, on a busy machine [s]


def check_source(make: Callable[[], Any], *, samples: int = 20, seconds: float = 10.0) -> None:
    """The contract of sources, as a test that any plug-in can run on itself.

    Nothing happens where all of this holds:

    1. it is a `Source`, and its `info` is a `StreamInfo`;
    2. something comes within the time given;
    3. `read` gives a `Block` of at least one sample, or None once its timeout is over, or raises
       `SourceEnded`;
    4. each sample has as many values as `info` says, uint8 or float32, finite, and pressures lie
       within 0 to 255 counts;
    5. times do not run backwards, and `arrived` does not lie in the future;
    6. after `close`, which may be called twice, `read` ends at once;
    7. a recording (`Seekable`) gives the same samples again when it is led back to its beginning.

    Parameters
    ----------
    make : callable
        Opens the source; something must be sending to a live one.
    samples : int
        So many are looked at, or all there are.
    seconds : float
        Time for them.

    Raises
    ------
    BrokenPluginError
        Which promise is broken, and how.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> def made():
    ...     return skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    >>> skinmap.live.check_source(made)
    """
    try:
        source = make()
    except Exception as error:
        raise BrokenPluginError(f"cannot be opened: {error!r}") from error
    kind = type(source).__name__
    _require(isinstance(source, Source), f"{kind} does not derive from skinmap.live.Source")
    info: object = source.info
    _require(isinstance(info, StreamInfo), f"info is a {type(info).__name__}, expected StreamInfo")
    counts: object = source.counts
    _require(isinstance(counts, Counts), f"counts is a {type(counts).__name__}, expected Counts")
    angles: Any = source.angles_at(0.0)
    sound = isinstance(angles, Mapping) and all(isinstance(one, float) for one in angles.values())
    _require(sound, f"angles_at gives {angles!r}, expected angles [rad] by joint")
    blocks = _read(source, samples, seconds)
    _require(bool(blocks), f"nothing came within {seconds:g} s")
    steps = np.diff(np.concatenate([block.times for block in blocks]))
    _require(bool((steps >= 0).all()), "times run backwards")
    if isinstance(source, Seekable):
        _check_seeking(source, blocks[0], seconds)
    for _ in range(2):
        try:
            source.close()
        except Exception as error:
            raise BrokenPluginError(f"close, called twice, fails: {error!r}") from error
    began = time.perf_counter()
    try:
        source.read(60.0)
        ended = False
    except (SourceEnded, UnreachableError):
        ended = True
    except Exception as error:
        raise BrokenPluginError(f"read after close raises {error!r}, not SourceEnded") from error
    _require(ended, "read after close must raise SourceEnded")
    _require(time.perf_counter() - began < 30.0, "read after close must end at once")


def _read(source: Any, samples: int, seconds: float) -> list[Block]:
    """Blocks of at least so many samples, each looked at."""
    blocks: list[Block] = []
    until = time.perf_counter() + seconds
    while sum(map(len, blocks)) < samples and time.perf_counter() < until:
        began = time.perf_counter()
        try:
            block = source.read(POLL)
        except SourceEnded:
            break
        except Exception as error:
            raise BrokenPluginError(f"read fails: {error!r}") from error
        took = time.perf_counter() - began
        _require(took < POLL + MARGIN, f"read takes {took:.2f} s with a timeout of {POLL} s")
        if block is not None:
            _check_block(source.info, block)
            blocks.append(block)
    return blocks


def _check_block(info: StreamInfo, block: Any) -> None:
    _require(isinstance(block, Block), f"read gives a {type(block).__name__}, expected a Block")
    _require(len(block) > 0, "read gives a block without samples; return None for silence")
    width = block.values.shape[1]
    _require(width == info.channels, f"{width} values in a sample, info states {info.channels}")
    kind = block.values.dtype
    _require(kind in (np.uint8, np.float32), f"values are {kind}, expected uint8 or float32")
    _require(bool(np.isfinite(block.values).all()), "values hold NaN or infinity")
    inside = block.values.min() >= 0 and block.values.max() <= 255
    _require(info.kind == "raw" or bool(inside), "pressures must lie within 0 to 255 counts")
    _require(block.arrived <= time.perf_counter(), "arrived lies in the future (perf_counter)")


def _check_seeking(source: Seekable, first: Block, seconds: float) -> None:
    try:
        source.speed, source.loop = float("inf"), False
        source.seek(0.0)
        again = _read(source, len(first), seconds)
    except BrokenPluginError:
        raise
    except Exception as error:
        raise BrokenPluginError(f"cannot be led back to its beginning: {error!r}") from error
    _require(bool(again), "nothing comes from the beginning, once it is led back there")
    count = min(len(first), len(again[0]))
    same = np.array_equal(first.values[:count], again[0].values[:count])
    _require(same, "gives other samples when it is led back to its beginning")
    _require(source.duration >= 0.0, f"lasts {source.duration} seconds")


def _require(holds: bool, broken: str) -> None:
    if not holds:
        raise BrokenPluginError(broken)


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


MAX_BYTES = 64_000_000  # kept for a slow reader: 3.7 s of a whole iCub at 1 kHz in float32
OVERHEAD = 512  # bytes of a block beside its numbers: narrow ones weigh little else
STOPS = 0.1  # the thread looks so often whether it is to stop [s]
SILENT = 0.8  # without a sign of life, a source counts as dead: well within a second [s]


class Receiver(Relay):
    """Reads a source in a thread of its own; itself a `Source`.

    Parameters
    ----------
    source : Source
        Read from the thread only, and closed with this.
    most_bytes : int
        Kept for a slow reader, blocks with all that they weigh; the oldest samples go first.

    Notes
    -----
    Samples are handed on as they came: who uses them looks at them (`SampleChecks`).
    `read` gives all that was kept. What a source raises is raised again by whoever reads.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> source = skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    >>> receiver = skinmap.live.Receiver(source)
    >>> block = receiver.read(30.0)
    >>> len(block) > 0, block.values.shape[1] == source.info.channels
    (True, True)
    >>> receiver.close()
    """

    def __init__(self, source: Source, *, most_bytes: int = MAX_BYTES) -> None:
        super().__init__(source)
        self._kept: BoundedQueue[Block] = BoundedQueue(most_bytes)
        self._last_seen = time.perf_counter()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="receiver", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> Counts:
        """What happened so far; a copy."""
        theirs = self.source.counts
        return replace(
            self._counts, lost=theirs.lost, refused=theirs.refused, reconnects=theirs.reconnects
        )

    @property
    def last_seen(self) -> float:
        """`time.perf_counter()` of the last sign of life.

        A source that knows it is asked: this thread takes a block a moment after it came, and two
        moments would let `alive` and `last_seen` contradict each other.
        """
        theirs = self.source.last_seen
        return self._last_seen if np.isnan(theirs) else theirs

    @property
    def alive(self) -> bool:
        """Whether there was a sign of life within the last second."""
        return self.source.alive and time.perf_counter() - self.last_seen < SILENT

    def read(self, timeout: float) -> Block | None:
        """All samples that were kept, as one block; None where none come within `timeout` [s]."""
        blocks = self._kept.take_all(timeout)
        if not blocks:
            return None
        if len(blocks) == 1:
            return blocks[0]
        return Block(
            np.concatenate([block.times for block in blocks]),
            np.concatenate([block.values for block in blocks]),
            blocks[-1].arrived,
        )

    def close(self) -> None:
        """Stop the thread and close the source; may be called twice."""
        self._stop.set()
        self._kept.end(SourceEnded(), at_once=True)
        if threading.current_thread() is not self._thread:
            self._thread.join()
        self.source.close()

    def _work(self) -> None:
        while not self._stop.is_set():
            try:
                block = self.source.read(STOPS)
            except Exception as error:  # noqa: BLE001 - whoever reads is told
                self._kept.end(error)
                return
            if block is not None and len(block):
                self._last_seen = time.perf_counter()
                self._counts.received += len(block)
                size = block.values.nbytes + block.times.nbytes + OVERHEAD
                self._counts.dropped += sum(map(len, self._kept.push(block, size)))

"""Where samples come from: one protocol for recordings, the simulator and live streams.

for block in skinmap.live.open_source("lsl:demo"):
    block.times, block.values
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import FloatArray, check_finite, freeze
from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError

Kind = Literal["raw", "pressure"]


@dataclass(frozen=True, eq=False, slots=True)
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
        Of the skin of each part (`skinmap.skin.fingerprint.fingerprint(skin)`),
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
        if part not in self.parts:
            raise UnknownNameError(f"part in stream {self.name!r}", part, self.parts)
        row = self.parts.index(part)
        start = sum(self.widths[:row])
        return slice(start, start + self.widths[row])


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


@runtime_checkable
class Source(Protocol):
    """Anything that samples come from.

    `read` raises `SourceEnded` when nothing more will come (a recording's end), and
    `UnreachableError` when a live source died and cannot be had again.
    """

    @property
    def info(self) -> StreamInfo:
        """Skin, channels, rate and clock."""

    def read(self, timeout: float) -> Block | None:
        """What has come since the last call; None when nothing comes within `timeout` [s]."""

    def close(self) -> None:
        """Give threads, sockets and files back; may be called twice."""


@runtime_checkable
class Seekable(Source, Protocol):
    """A source that can be led through time: a recording.

    Attributes
    ----------
    speed : float
        How many times faster than recorded; `inf` gives all at once, 0 halts.
    loop : bool
        Whether it starts again at its end.
    """

    speed: float
    loop: bool

    @property
    def duration(self) -> float:
        """[s]."""

    @property
    def position(self) -> float:
        """Seconds from its beginning."""

    def seek(self, seconds: float) -> None:
        """Go on from there."""


class SourceEnded(EOFError):  # noqa: N818 - no error: a recording has an end
    """Nothing more will come."""


def blocks(source: Source, *, timeout: float = 1.0) -> Iterator[Block]:
    """All that comes, until the source ends; nothing is yielded while it is silent."""
    while True:
        try:
            block = source.read(timeout)
        except SourceEnded:
            return
        if block is not None:
            yield block


def check_block(info: StreamInfo, times: ArrayLike, values: ArrayLike, arrived: float) -> Block:
    """A block of the stream that `info` describes.

    Raises
    ------
    SkinMismatchError
        Another number of channels (says both).
    InvalidArrayError
        Times that are not finite, not one for each sample.
    """
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[1] != info.channels:
        raise SkinMismatchError(
            f"stream {info.name!r}: {array.shape[-1] if array.ndim else 0} values in a sample, "
            f"its skin has {info.channels} channels"
        )
    return Block(np.asarray(times, np.float64), array, arrived)

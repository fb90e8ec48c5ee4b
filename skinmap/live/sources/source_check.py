"""The contract of sources, as a test that any plug-in can run on itself.

`check_source(make)` opens what `make()` gives, reads it, closes it, and checks that

1. it is a `Source`, its `info` is a `StreamInfo`, and its other members are of their kind;
2. something comes within the time given;
3. `read` gives a `Block` of at least one sample, or None once its timeout is over, or raises
   `SourceEnded`;
4. each sample has as many values as `info` says, uint8 or float32, finite, and pressures lie
   within 0 to 255 counts;
5. times do not run backwards, and `arrived` does not lie in the future;
6. after `close`, which may be called twice, `read` ends at once;
7. a recording (`Seekable`) gives the same samples again when it is led back to its beginning.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from skinmap.errors import BrokenPluginError, UnreachableError
from skinmap.live.sources.source import (
    Block,
    Counts,
    Seekable,
    Source,
    SourceEnded,
    StreamInfo,
)

POLL = 0.2  # asked for at a time [s]
MARGIN = 1.0  # after which a `read` has not kept its timeout, on a busy machine [s]


def check_source(make: Callable[[], Any], *, samples: int = 20, seconds: float = 10.0) -> None:
    """Check what the module's description lists; nothing happens where all of it holds.

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
    _check_members(source)
    blocks = _read(source, samples, seconds)
    _require(bool(blocks), f"nothing came within {seconds:g} s")
    _check_times(blocks)
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


def _check_members(source: Source) -> None:
    """What a source need not define, where it does."""
    counts: object = source.counts
    _require(isinstance(counts, Counts), f"counts is a {type(counts).__name__}, expected Counts")
    for name in ("speed", "last_seen"):
        value = getattr(source, name)
        _require(isinstance(value, int | float), f"{name} is {value!r}, expected a number")
    told: object = source.angles_at(0.0)
    sound = isinstance(told, Mapping) and all(isinstance(one, float) for one in told.values())
    _require(sound, f"angles_at gives {told!r}, expected angles [rad] by joint")


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


def _check_times(blocks: list[Block]) -> None:
    steps = np.diff(np.concatenate([block.times for block in blocks]))
    _require(bool((steps >= 0).all()), "times run backwards")


def _check_seeking(source: Seekable, first: Block, seconds: float) -> None:
    try:
        source.speed = float("inf")
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

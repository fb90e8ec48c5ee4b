"""What LabRecorder wrote: XDF, read by pyxdf.

pyxdf believes the sizes that a file states. So the file's chunks are gone through first, and pyxdf
is given those that are whole and of streams of numbers; the rest is said to be lost.
Format: https://github.com/sccn/xdf/wiki/Specifications
"""

from __future__ import annotations

import io
import logging
import struct
import warnings
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, UnknownNameError, warn
from skinmap.io.recordings.dumper import PartLog, at_shared_times
from skinmap.io.recordings.recorded_stream import (
    Kind,
    Loss,
    RecordedStream,
    StreamInfo,
    measured_rate,
    whole_counts,
)
from skinmap.io.text import check_file
from skinmap.skin.robot import Robot

MAGIC = b"XDF:"
BOUNDARY = bytes.fromhex("43A546DCCBF5410FB30ED5467383CBE4")
HEADER, STREAM, SAMPLES, CLOCK, MARK, FOOTER = 1, 2, 3, 4, 5, 6
SIZES = {"int8": 1, "int16": 2, "int32": 4, "int64": 8, "float32": 4, "double64": 8}
MAX_BYTES = 2 * 2**30  # it is held in memory
LOST = 3.0  # usual steps that are a gap and no jitter
NEAR = 25  # samples on either side that tell whether times stay late
FAR = 10  # times as many
PLACES = 200  # at which the scatter of times is looked at
WILD = 5.0  # times that scatter
OFF = 0.05  # share by which a real rate differs from one that was only meant
MAX_CHANNELS = 1_000_000
# What pyxdf may raise for contents that make no sense.
DAMAGED = (ValueError, LookupError, TypeError, ArithmeticError, RuntimeError, EOFError,
           AttributeError, OSError, SyntaxError, struct.error)  # fmt: skip


@dataclass(slots=True)
class _Sound:
    """The whole chunks of a file, and what was left out."""

    data: io.BytesIO = field(default_factory=io.BytesIO)
    sample_bytes: dict[int, int] = field(default_factory=dict)
    ignored: set[int] = field(default_factory=set)
    damage: list[str] = field(default_factory=list)


def read_xdf(path: Path, *, robot: Robot | None = None) -> RecordedStream:
    """Read the stream of a skin: one that describes its parts, else those called like a part.

    Parameters
    ----------
    path : Path
    robot : Robot, optional
        A stream whose name holds that of one of its parts ("skin_left_arm") is that part; without
        a robot every stream of numbers is a part.

    Returns
    -------
    RecordedStream
        Raw values, unless the stream says otherwise, at the times of the stream with most
        samples; times have the clocks' offsets and their jitter taken out, between gaps.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, not XDF, or no stream of numbers in it.
    UnknownNameError
        No stream that is called like a part of the robot.
    """
    sound = _sound_chunks(path)
    parts, told = _read_parts(sound, robot, path)
    irregular = [part for part, rate in told.rates.items() if rate == 0]
    times, columns = at_shared_times(parts, path, kept=irregular)
    joined = np.concatenate(columns, axis=1)
    rate = told.rates[max(parts, key=lambda part: len(parts[part][0]))]
    real = measured_rate(times)
    return RecordedStream(
        StreamInfo(
            path.stem,
            tuple(parts),
            tuple(one.shape[1] for one in columns),
            rate if abs(rate - real) <= OFF * rate else 0.0,
            told.kind,
            told.robot,
            told.fingerprints,
            clock="lsl",
        ),
        times,
        joined.astype(np.uint8 if whole_counts(joined) else np.float32),
        loss=Loss(True, 0.0, tuple(sound.damage[:100])) if sound.damage else Loss(),
    )


def read_xdf_parts(path: Path) -> dict[str, PartLog]:
    """Samples of each part at its own times, in the order of the file; errors as `read_xdf`."""
    return _read_parts(_sound_chunks(path), None, path)[0]


@dataclass(slots=True)
class _Told:
    """Parts of the streams by their own descriptions."""

    kind: Kind
    robot: str
    fingerprints: dict[str, str] = field(default_factory=dict)
    rates: dict[str, float] = field(default_factory=dict)  # nominal [Hz], 0 where there is none


def _read_parts(sound: _Sound, robot: Robot | None, path: Path) -> tuple[dict[str, PartLog], _Told]:
    import pyxdf

    logger = logging.getLogger("pyxdf.pyxdf")
    before, logger.disabled = logger.disabled, True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # Its own line through all times of a stream would spread a gap over the recording.
            streams, _ = pyxdf.load_xdf(sound.data, dejitter_timestamps=False)
    except DAMAGED as error:
        raise DataFormatError(f"not XDF that can be read: {error}", path) from error
    finally:
        logger.disabled = before
    there = [one for one in streams if len(one["time_stamps"])]
    return _described_parts(there, path) or _named_parts(there, robot, path)


def _sound_chunks(path: Path) -> _Sound:
    """Collect the chunks of a file that are whole and consistent."""
    check_file(path, "an XDF recording", MAX_BYTES)
    data = path.read_bytes()
    if data[: len(MAGIC)] != MAGIC:
        raise DataFormatError("an empty file" if not data else "not an XDF file", path)
    sound = _Sound()
    sound.data.write(MAGIC)
    offset = len(MAGIC)
    while offset < len(data):
        found = _length(data, offset)
        end = found[1] + found[0] if found else len(data) + 1
        if found is None or found[0] < 2 or end > len(data):
            following = data.find(BOUNDARY, offset)
            sound.damage.append(f"unreadable from byte {offset}")
            offset = following + len(BOUNDARY) if following >= 0 else len(data)
            continue
        body = data[found[1] : end]
        try:
            if _keep(body, sound):
                sound.data.write(b"\x08" + struct.pack("<Q", len(body)) + body)
        except DAMAGED as error:
            sound.damage.append(f"byte {offset}: {error}")
        offset = end
    sound.data.seek(0)
    return sound


def _length(data: bytes, offset: int) -> tuple[int, int] | None:
    """A number of variable length and where it ends; None where there is none."""
    size = data[offset] if offset < len(data) else 0
    if size not in (1, 4, 8) or offset + 1 + size > len(data):
        return None
    return int.from_bytes(data[offset + 1 : offset + 1 + size], "little"), offset + 1 + size


def _keep(body: bytes, sound: _Sound) -> bool:
    """Whether pyxdf may see a chunk; ValueError where it is damaged."""
    tag = int.from_bytes(body[:2], "little")
    if tag == HEADER:
        _xml(body[2:])
        return True
    if tag not in (STREAM, SAMPLES, CLOCK):
        return False  # nothing that we need
    (stream,) = struct.unpack_from("<I", body, 2)
    content = body[6:]
    if tag == STREAM:
        return _keep_stream(stream, content, sound)
    if stream in sound.ignored:
        return False
    if stream not in sound.sample_bytes:
        raise ValueError(f"samples of stream {stream}, which was not described")
    if tag == CLOCK:
        if len(content) != 16 or not np.isfinite(struct.unpack("<dd", content)).all():
            raise ValueError("not a valid clock offset")
        return True
    _check_samples(content, sound.sample_bytes[stream])
    return True


def _keep_stream(stream: int, content: bytes, sound: _Sound) -> bool:
    info = _xml(content)
    kind, count = info.findtext("channel_format"), int(info.findtext("channel_count") or 0)
    if stream in sound.sample_bytes or stream in sound.ignored:
        raise ValueError(f"stream {stream} is described twice")
    if kind not in SIZES:
        sound.ignored.add(stream)
        return False
    if not 1 <= count <= MAX_CHANNELS:
        raise ValueError(f"a stream of {count} channels")
    sound.sample_bytes[stream] = count * SIZES[kind]
    return True


def _xml(content: bytes) -> Any:
    """Root of a chunk's XML; entities are refused, as they can unfold to anything."""
    from xml.etree.ElementTree import fromstring

    if b"<!" in content.replace(b"<!--", b""):
        raise ValueError("XML with declarations")
    return fromstring(content.decode("utf-8", "replace"))


def _check_samples(content: bytes, sample_bytes: int) -> None:
    found = _length(content, 0)
    if found is None:
        raise ValueError("a chunk without its number of samples")
    count, offset = found
    for _ in range(min(count, len(content))):
        if offset >= len(content) or content[offset] not in (0, 8):
            raise ValueError("not a valid sample")
        offset += 1 + content[offset] + sample_bytes
    if offset != len(content):
        raise ValueError(f"{count} samples do not fill their chunk")


def _described_parts(streams: list[Any], path: Path) -> tuple[dict[str, PartLog], _Told] | None:
    """Parts of all streams that describe their skin as the first one does."""
    parts: dict[str, PartLog] = {}
    told: _Told | None = None
    left_out = []
    for stream in streams:
        info = _described(stream)
        if info is None:
            continue
        told = told or _Told(info.kind, info.robot)
        if (info.kind, info.robot) != (told.kind, told.robot) or not parts.keys().isdisjoint(
            info.parts
        ):
            left_out.append(f"{stream['info']['name'][0]} ({info.kind}, {', '.join(info.parts)})")
            continue
        times, values = _samples(stream, path)
        parts |= {part: (times, values[:, info.part_slice(part)], "") for part in info.parts}
        told.rates |= dict.fromkeys(info.parts, _nominal_rate(stream))
        told.fingerprints |= info.fingerprints
    if left_out:
        warn(
            f"{path.name}: streams of another kind or robot, or of the same parts, were left out: "
            + "; ".join(left_out),
            above=3,
        )
    return None if told is None else (parts, told)


def _named_parts(
    streams: list[Any], robot: Robot | None, path: Path
) -> tuple[dict[str, PartLog], _Told]:
    """Parts by the names of their streams."""
    named: dict[str, PartLog] = {}
    told = _Told("raw", "" if robot is None else robot.name)
    names = [str(one["info"]["name"][0]) for one in streams]
    for name, stream in zip(names, streams, strict=True):
        fitting = [name] if robot is None else [each for each in robot.parts if each in name]
        if not fitting:
            continue
        part = max(fitting, key=len)
        if part in named:
            raise DataFormatError(f"two streams of {part!r}", path)
        named[part] = (*_samples(stream, path), "")
        told.rates[part] = _nominal_rate(stream)
    if not named and robot is not None and names:
        raise UnknownNameError(f"part of {robot.name} among the streams", ", ".join(names),
                               robot.parts)  # fmt: skip
    if not named:
        raise DataFormatError("no stream of numbers in it", path)
    return named, told


def _described(stream: Any) -> StreamInfo | None:
    """Skin described by a stream (see `skinmap.live.network.lsl_stream`), or None."""
    try:
        skin = stream["info"]["desc"][0]["skinmap"][0]
        rows = [
            (part["name"][0], int(part["channels"][0]), part["fingerprint"][0])
            for part in skin["parts"][0]["part"]
        ]
        parts, widths, prints = zip(*rows, strict=True)
        kind, robot = skin["kind"][0], skin["robot"][0] or ""
    except (LookupError, TypeError, ValueError):
        return None
    whole = sum(widths) == np.shape(stream["time_series"])[1] and min(widths) > 0
    if kind not in ("raw", "pressure") or not whole or len(set(parts)) < len(parts):
        return None
    known = {part: print_ for part, print_ in zip(parts, prints, strict=True) if print_}
    return StreamInfo("", parts, widths, 0.0, kind, robot, known)


def _nominal_rate(stream: Any) -> float:
    rate = float(stream["info"]["nominal_srate"][0])
    return max(rate, 0.0) if np.isfinite(rate) else 0.0


def _samples(stream: Any, path: Path) -> tuple[FloatArray, NDArray[Any]]:
    """Times (t,) without their jitter [s], and values (t, channels)."""
    times = np.asarray(stream["time_stamps"], np.float64)
    if not np.isfinite(times).all():
        raise DataFormatError(f"stream of {stream['info']['name'][0]!r} has invalid times", path)
    try:  # as cameras do: pyxdf leaves their times, too
        drops = stream["info"]["desc"][0]["synchronization"][0]["can_drop_samples"][0]
    except (LookupError, TypeError):
        drops = ""
    if _nominal_rate(stream) > 0 and str(drops).lower() != "true":
        for first, after in pairwise([0, *_breaks(times).tolist(), len(times)]):
            rows = np.arange(first, after)[:, None]  # as pyxdf itself does
            line = np.linalg.lstsq(np.hstack([np.ones_like(rows), rows]), times[rows], rcond=-1)[0]
            times[rows] = line[0] + line[1] * rows
    return times, np.asarray(stream["time_series"])


def _breaks(times: FloatArray) -> IntArray:
    """Rows from which times stay later, or earlier, than those before them went on.

    A burst makes up for the pause before it, a loss of samples does not.
    """
    count = len(times)
    near = min(NEAR, count // 10)
    if near < 2:
        return np.zeros(0, np.int64)
    step = float(np.median(times[near:] - times[:-near])) / near
    steps = np.diff(times)
    found = np.flatnonzero((steps > LOST * step) | (steps < -step)) + 1
    lags = times - step * np.arange(count)
    for wide in (near, min(FAR * near, count // 4)):  # the wide one sees beyond a burst
        some = np.linspace(near, count - near, PLACES).astype(int)
        usual = float(np.median(np.abs(_jumps(lags, some, wide))))
        found = found[np.abs(_jumps(lags, found, wide)) > max(LOST * step, WILD * usual)]
    return found


def _jumps(lags: FloatArray, rows: IntArray, wide: int) -> FloatArray:
    """How much later the rows from each on are than those before it [s]."""
    sides = [(lags[row : row + wide], lags[max(row - wide, 0) : row]) for row in rows]
    return np.array([np.median(after) - np.median(before) for after, before in sides])

"""What LabRecorder wrote: XDF, read by pyxdf.

pyxdf believes the sizes that a file states. So the file's chunks are gone through first, and pyxdf
is given those that are whole and of streams of numbers; the rest is said to be lost.
Format: https://github.com/sccn/xdf/wiki/Specifications
"""

from __future__ import annotations

import gzip
import io
import logging
import struct
import warnings
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import DataFormatError, UnknownNameError
from skinmap.io.recordings.recorded_stream import Loss, RecordedStream, StreamInfo, whole_counts
from skinmap.io.text import check_file
from skinmap.skin.robot import Robot

MAGIC = b"XDF:"
BOUNDARY = bytes.fromhex("43A546DCCBF5410FB30ED5467383CBE4")
HEADER, STREAM, SAMPLES, CLOCK, MARK, FOOTER = 1, 2, 3, 4, 5, 6
SIZES = {"int8": 1, "int16": 2, "int32": 4, "int64": 8, "float32": 4, "double64": 8}
MAX_BYTES = 2 * 2**30  # it is held in memory
MAX_UNFOLDED = 512 * 2**20  # of a compressed file, which may come from anywhere
MAX_RATIO = 100  # of a compressed file; recordings of sensors reach 10
PIECE = 2**20  # unfolded at once
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
        samples; times have the clocks' offsets and their jitter taken out.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, not XDF, or no stream of numbers in it.
    UnknownNameError
        No stream that is called like a part of the robot.
    """
    import pyxdf

    sound = _sound_chunks(_bytes(path), path)
    logger = logging.getLogger("pyxdf")
    before, logger.disabled = logger.disabled, True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            streams, _ = pyxdf.load_xdf(sound.data)
    except DAMAGED as error:
        raise DataFormatError(f"not XDF that can be read: {error}", path) from error
    finally:
        logger.disabled = before
    chosen = _parts([one for one in streams if len(one["time_stamps"])], robot, path)
    return _track(chosen, robot, sound, path)


def _bytes(path: Path) -> bytes | bytearray:
    check_file(path, "an XDF recording", MAX_BYTES)
    with path.open("rb") as file:
        if path.suffix.lower() != ".xdfz":
            return file.read()
        most = min(MAX_UNFOLDED, max(PIECE, MAX_RATIO * path.stat().st_size))
        data = bytearray()
        try:
            unfolded = gzip.GzipFile(fileobj=file)
            while piece := unfolded.read(PIECE):
                data += piece
                if len(data) > most:
                    raise DataFormatError(f"unfolds to more than {most / 2**20:.0f} MB", path)
        except (OSError, EOFError, zlib.error) as error:
            raise DataFormatError(f"not a compressed XDF file: {error}", path) from None
    return data


def _sound_chunks(data: bytes | bytearray, path: Path) -> _Sound:
    """Collect the chunks that are whole and consistent."""
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
        body = bytes(data[found[1] : end])
        try:
            if _keep(body, sound):
                sound.data.write(b"\x08" + struct.pack("<Q", len(body)) + body)
        except DAMAGED as error:
            sound.damage.append(f"byte {offset}: {error}")
        offset = end
    sound.data.seek(0)
    return sound


def _length(data: bytes | bytearray, offset: int) -> tuple[int, int] | None:
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


def _parts(streams: list[Any], robot: Robot | None, path: Path) -> dict[str, Any]:
    """Streams by the part that each is of."""
    for stream in streams:
        if _described(stream) is not None:
            return {"": stream}
    named: dict[str, Any] = {}
    names = [str(one["info"]["name"][0]) for one in streams]
    for name, stream in zip(names, streams, strict=True):
        part: str | None = name
        if robot is not None:
            part = max((each for each in robot.parts if each in name), key=len, default=None)
        if part is None:
            continue
        if part in named:
            raise DataFormatError(f"two streams of {part!r}", path)
        named[part] = stream
    if not named and robot is not None and names:
        raise UnknownNameError(f"part of {robot.name} among the streams", ", ".join(names),
                               robot.parts)  # fmt: skip
    if not named:
        raise DataFormatError("no stream of numbers in it", path)
    return named


def _described(stream: Any) -> StreamInfo | None:
    """Skin described by a stream (see `skinmap.live.network.lsl_settings`), or None."""
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


def _track(
    chosen: dict[str, Any], robot: Robot | None, sound: _Sound, path: Path
) -> RecordedStream:
    longest = max(chosen.values(), key=lambda one: len(one["time_stamps"]))
    times = np.sort(np.asarray(longest["time_stamps"], np.float64), kind="stable")
    columns = [_held(stream, times, part, path) for part, stream in chosen.items()]
    joined = np.concatenate(columns, axis=1)
    rate = float(longest["info"]["nominal_srate"][0])
    told = _described(longest) if len(chosen) == 1 else None
    if told is None:
        name = "" if robot is None else robot.name
        told = StreamInfo("", tuple(chosen), tuple(c.shape[1] for c in columns), 0.0, "raw", name)
    rate = max(rate, 0.0) if np.isfinite(rate) else 0.0
    return RecordedStream(
        replace(told, name=path.stem, rate=rate, clock="lsl"),
        times,
        joined.astype(np.uint8 if whole_counts(joined) else np.float32),
        loss=Loss(True, 0.0, tuple(sound.damage[:100])) if sound.damage else Loss(),
    )


def _held(stream: Any, times: FloatArray, part: str, path: Path) -> NDArray[Any]:
    """Values (t, channels) at other times: what was sent last, the first sample before that."""
    stamps = np.asarray(stream["time_stamps"], np.float64)
    if not np.isfinite(stamps).all():
        raise DataFormatError(f"stream of {part!r} has invalid times", path)
    order = np.argsort(stamps, kind="stable")
    rows = np.searchsorted(stamps[order], times, side="right") - 1
    return np.asarray(stream["time_series"])[order][rows.clip(0)]

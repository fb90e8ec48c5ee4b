"""Going through an MCAP file record by record, whatever happened to it.

A file that was cut off has no index, and one with a damaged byte may have a wrong one. So no index
is used: records are followed from the beginning, sizes are checked before anything is read, and
after damage the next chunk is searched for. Each chunk proves itself by its checksum.
"""

from __future__ import annotations

import io
import json
import mmap
import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import DataFormatError, MissingFileError
from skinmap.io.text import is_file

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, times logged and published
SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, STATISTICS, METADATA = 3, 4, 5, 6, 9, 11, 12
TOTALS = struct.Struct("<QHIIII")  # messages, schemas, channels, attachments, metadata, chunks
FOOTER, LAST_OPCODE, PRIVATE = 2, 15, 0x80
MESSAGE_INDEX, CHUNK_INDEX, ATTACHMENT_INDEX, METADATA_INDEX = 7, 8, 10, 13
FOOTER_BODY, CHUNK_PLACE = struct.Struct("<QQI"), struct.Struct("<QQQQI")
PLACE, NUMBER, INDEX_HEAD = struct.Struct("<QQ"), struct.Struct("<Q"), struct.Struct("<HI")
WHOLE = "whole.json"  # an attachment: how many bytes stand before it, and their checksum
END = HEAD.size + FOOTER_BODY.size + len(MAGIC)  # bytes of a footer and what follows
CONTENT = HEAD.size + MESSAGE_HEAD.size  # from a message's record to its bytes
# Where to go on after damage: a chunk record, told by the name of its compression.
NAME = re.compile(rb"\x04\0\0\0zstd|\x03\0\0\0lz4")
LONGEST_NAME = 8  # bytes that it matches
CHUNK_HEAD = struct.Struct("<QQQII")  # times, size, checksum, length of the compression's name
BEFORE_NAME = HEAD.size + CHUNK_HEAD.size - 4
WINDOW = 2**20
MAX_COPIES = 1000  # channel records that are kept; ours have four of six
LONGEST = 60 * 10**9  # [ns] that a chunk may last; a head that says more is damaged too
# What decoding damaged records may raise.
DAMAGED = (ValueError, struct.error, OverflowError)
MAX_RECORD = 64 * 2**20  # bytes of one record, and of what a chunk unfolds to; ours have 64 kB
PIECE = 2**20  # unfolded at once [bytes]

Found = TypeVar("Found")  # by a way of reading


@dataclass(frozen=True, slots=True)
class Place:
    """Where a chunk stands: its offset in the file and the bytes of its record."""

    offset: int
    length: int


@dataclass(slots=True)
class Scan:
    """What was found in a file.

    Attributes
    ----------
    path : Path
    size : int
        Bytes.
    finished : bool
        Whether it ends as it should.
    damage : list of str
        What was wrong, and where.
    schemas, channels : dict
        Records by number.
    metadata : dict
        Tables of words by name.
    attachments : dict
        Small files by name.
    copies : list
        All channel records: those of the end repeat the first, so that damage in one is known.
    promised : int
        Latest message time [ns] that the head of an unreadable or cut chunk states; 0 where none.
    stated : int
        Number of messages stated at the end of the file; 0 where it is missing.
    """

    path: Path
    size: int
    finished: bool = False
    damage: list[str] = field(default_factory=list)
    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    copies: list[Any] = field(default_factory=list)
    promised: int = 0
    stated: int = 0


Take = Callable[[int, int, int, int, int, Place], None]


def scan(path: Path, take: Take) -> Scan:
    """Go through a file once.

    Parameters
    ----------
    path : Path
    take : callable
        Called for each message with its channel, sequence number, time [ns], where its bytes
        begin in the chunk's content, how many they are, and the place of the chunk.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not MCAP at all.
    """
    if not is_file(path):
        raise MissingFileError(path, "an MCAP recording")
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise DataFormatError("an empty file" if size == 0 else "not an MCAP file", path)
        found = Scan(path, size)
        offset = len(MAGIC)
        while offset < size and not found.finished:
            offset = _record(file, offset, found, take)
    return found


# What an index says: all but the messages, the chunks, and by channel the times and places of its
# messages (k, 2) and the chunks (k,) that they stand in.
FileIndex = tuple[Scan, list[Place], dict[int, tuple[NDArray[np.uint64], NDArray[np.uint32]]]]


def scan_index(path: Path) -> FileIndex | None:
    """Go through the index of a file that is whole; None of one that cannot be known to be.

    Our files state the checksum of their bytes. No chunk is unfolded.
    """
    return _of_whole(path, _by_index)


def scan_summary(path: Path) -> Scan | None:
    """What a file that ends as ours do says of itself, without its messages; else None."""
    found = _of_whole(path, _summary)
    return None if found is None else found[0]


def _of_whole(path: Path, read: Callable[[mmap.mmap, Path], Found | None]) -> Found | None:
    size = path.stat().st_size if is_file(path) else 0
    if size < len(MAGIC) + END:
        return None
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        try:
            return read(data, path)
        except (*DAMAGED, KeyError, TypeError):  # no such index, or not a true one
            return None


def _summary(data: mmap.mmap, path: Path) -> tuple[Scan, list[tuple[Place, int]]] | None:
    """Its summary, and each chunk with the length of its index."""
    size = len(data)
    footer = size - END
    opcode, length = HEAD.unpack_from(data, footer)
    start, _, checksum = FOOTER_BODY.unpack_from(data, footer + HEAD.size)
    ended = data[:8] == MAGIC == data[size - 8 :]
    if opcode != FOOTER or length != FOOTER_BODY.size or not ended or not 0 < start <= footer:
        return None
    summary = data[start:footer]
    if zlib.crc32(summary + data[footer : size - 12]) != checksum:
        return None
    found = Scan(path, size, finished=True)
    chunks: list[tuple[Place, int]] = []
    offset = 0
    while offset < len(summary):
        opcode, length = HEAD.unpack_from(summary, offset)
        offset += HEAD.size
        if opcode in (SCHEMA, CHANNEL):
            _content(opcode, summary[offset : offset + length], Place(0, 0), found, _nothing)
        elif opcode == CHUNK_INDEX:
            _, _, place, record, several = CHUNK_PLACE.unpack_from(summary, offset)
            (after,) = NUMBER.unpack_from(summary, offset + CHUNK_PLACE.size + several)
            chunks.append((Place(place, record), after))
        elif opcode in (ATTACHMENT_INDEX, METADATA_INDEX):
            place, record = PLACE.unpack_from(summary, offset)
            body = data[place + HEAD.size : place + record]
            kind = ATTACHMENT if opcode == ATTACHMENT_INDEX else METADATA
            _content(kind, body, Place(place, record), found, _nothing)
        offset += length
    return found, chunks


def _by_index(data: mmap.mmap, path: Path) -> FileIndex | None:
    summary = _summary(data, path)
    if summary is None:
        return None
    found, chunks = summary
    whole = json.loads(found.attachments[WHOLE])
    with memoryview(data) as view, view[: int(whole["bytes"])] as before:
        if not len(before) or zlib.crc32(before) != int(whole["crc32"]):
            return None
    places: dict[int, list[tuple[int, bytes]]] = {}
    for number, (place, after) in enumerate(chunks):
        offset = place.offset + place.length
        end = offset + after
        while offset < end:
            opcode, length = HEAD.unpack_from(data, offset)
            offset += HEAD.size
            if opcode == MESSAGE_INDEX:
                channel, several = INDEX_HEAD.unpack_from(data, offset)
                begin = offset + INDEX_HEAD.size
                places.setdefault(channel, []).append((number, data[begin : begin + several]))
            offset += length
    joined = {channel: _joined(pieces) for channel, pieces in places.items()}
    return found, [place for place, _ in chunks], joined


def _nothing(*_: object) -> None:
    """Take no message: a summary has none."""


def _joined(
    pieces: list[tuple[int, bytes]],
) -> tuple[NDArray[np.uint64], NDArray[np.uint32]]:
    """The index of one channel from its pieces, each of them a chunk's number and its pairs."""
    numbers, pairs = zip(*pieces, strict=True)
    counts = np.array([len(each) for each in pairs]) // PLACE.size
    both = np.frombuffer(bytearray().join(pairs), "<u8").reshape(-1, 2)
    both[:, 1] += CONTENT
    return both, np.repeat(np.array(numbers, np.uint32), counts)


def _record(file: IO[bytes], offset: int, found: Scan, take: Take) -> int:
    """Read the record at an offset; where the next one begins."""
    file.seek(offset)
    head = file.read(HEAD.size)
    if len(head) < HEAD.size:
        found.damage.append(f"cut off at byte {offset}")
        return found.size
    opcode, length = HEAD.unpack(head)
    end = offset + HEAD.size + length
    known = 1 <= opcode <= LAST_OPCODE or opcode >= PRIVATE
    if not known or end > found.size:
        return _after_damage(file, offset, opcode, found, take)
    if opcode == FOOTER:
        file.seek(end)
        found.finished = file.read(len(MAGIC)) == MAGIC
        if not found.finished:
            found.damage.append(f"cut off at byte {end}")
        return end if found.finished else found.size
    if opcode == STATISTICS and length >= TOTALS.size:
        found.stated = TOTALS.unpack(file.read(TOTALS.size))[0]
    if opcode in (SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA):
        if length > MAX_RECORD:
            found.damage.append(f"a record of {length / 2**20:.0f} MB at byte {offset}")
            return end if opcode == ATTACHMENT else _resync(file, offset + 1, found)
        body = file.read(length)
        try:
            _content(opcode, body, Place(offset, HEAD.size + length), found, take)
        except DAMAGED as error:
            found.damage.append(f"byte {offset}: {error or type(error).__name__}")
            if opcode == CHUNK:
                _note_end(body, found)
            if opcode == CHUNK and not _follows(file, end, found.size):
                return _resync(file, offset + 1, found)
    return end


def _follows(file: IO[bytes], offset: int, size: int) -> bool:
    """Whether something like a record begins there."""
    file.seek(offset)
    head = file.read(HEAD.size)
    if len(head) < HEAD.size:
        return True  # the end of the file: nothing else to go to
    opcode, length = HEAD.unpack(head)
    return 1 <= opcode <= LAST_OPCODE and offset + HEAD.size + length <= size


def _after_damage(file: IO[bytes], offset: int, opcode: int, found: Scan, take: Take) -> int:
    """A record that cannot be: another chunk further on, or the file was cut in this one."""
    following = _resync(file, offset + 1, found)
    if following < found.size or opcode != CHUNK:
        found.damage.append(f"unreadable from byte {offset} to {following}")
        return following
    found.damage.append(f"cut off in the chunk at byte {offset}")
    file.seek(offset + HEAD.size)
    body = file.read(MAX_RECORD)
    _note_end(body, found)
    place = Place(offset, HEAD.size + len(body))
    try:
        _messages(unfold(body, whole=False), place, found, take)
    except DAMAGED:
        found.damage.append(f"nothing to be had from the chunk at byte {offset}")
    return found.size


def _resync(file: IO[bytes], offset: int, found: Scan) -> int:
    """Where the next chunk begins at or after an offset; the end of the file where none does."""
    overlap = BEFORE_NAME + LONGEST_NAME
    while offset < found.size:
        file.seek(offset)
        window = file.read(WINDOW + overlap)
        for name in NAME.finditer(window, BEFORE_NAME):
            place = name.start() - BEFORE_NAME
            opcode, length = HEAD.unpack_from(window, place)
            if opcode == CHUNK and length <= MAX_RECORD:
                return offset + place
        offset += WINDOW
    return found.size


def _content(opcode: int, body: bytes, place: Place, found: Scan, take: Take) -> None:
    """Keep what a record holds."""
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.records import Attachment, Channel, Metadata, Schema

    if opcode == CHUNK:
        _messages(unfold(body), place, found, take)
        return
    if opcode == MESSAGE:  # some writers make no chunks
        _message(body, 0, len(body), place, take)
        return
    stream = ReadDataStream(io.BytesIO(body))
    try:
        if opcode == SCHEMA:
            schema = Schema.read(stream)
            found.schemas.setdefault(schema.id, schema)
        elif opcode == CHANNEL:
            channel = Channel.read(stream)
            found.channels.setdefault(channel.id, channel)
            if len(found.copies) < MAX_COPIES:
                found.copies.append(channel)
        elif opcode == METADATA:
            table = Metadata.read(stream)
            found.metadata.setdefault(table.name, table.metadata)
        elif zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
            raise ValueError("an attachment with a wrong checksum")
        else:
            attachment = Attachment.read(stream)
            found.attachments.setdefault(attachment.name, attachment.data)
    except McapError as error:
        raise ValueError(str(error) or "a record that ends too soon") from None


def _note_end(body: bytes, found: Scan) -> None:
    """Remember up to when a lost chunk reached, if its head can be believed."""
    if len(body) >= CHUNK_HEAD.size:
        start, end = CHUNK_HEAD.unpack_from(body)[:2]
        if 0 <= end - start <= LONGEST:
            found.promised = max(found.promised, end)


def _messages(data: bytes, place: Place, found: Scan, take: Take) -> None:
    """Hand out all whole messages of a chunk's content."""
    offset = 0
    while offset + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, offset)
        offset += HEAD.size
        if offset + length > len(data):
            return
        if opcode == MESSAGE:
            _message(data, offset, length, place, take)
        elif opcode in (SCHEMA, CHANNEL):
            _content(opcode, data[offset : offset + length], place, found, take)
        offset += length


def _message(data: bytes, offset: int, length: int, place: Place, take: Take) -> None:
    if length < MESSAGE_HEAD.size:
        raise ValueError(f"a message of {length} bytes")
    channel, sequence, nanoseconds, _ = MESSAGE_HEAD.unpack_from(data, offset)
    start = offset + MESSAGE_HEAD.size
    take(channel, sequence, nanoseconds, start, length - MESSAGE_HEAD.size, place)


def read_chunk(file: IO[bytes], place: Place) -> bytes:
    """What a place that `scan` gave holds, whole or as much as there is.

    Raises
    ------
    ValueError
        The file has changed since.
    """
    file.seek(place.offset)
    record = file.read(place.length)
    if len(record) < place.length:
        raise ValueError("it has become shorter")
    opcode, length = HEAD.unpack_from(record)
    body = record[HEAD.size :]
    return body if opcode == MESSAGE else unfold(body, whole=length == len(body))


def unfold(body: bytes, *, whole: bool = True) -> bytes:
    """Uncompressed content of a chunk; of one that was cut, as much as can be had.

    Raises
    ------
    ValueError
        Sizes beyond what is read, an unknown compression, a wrong checksum.
    """
    _, _, size, checksum, letters = CHUNK_HEAD.unpack_from(body)
    start = CHUNK_HEAD.size + letters + 8
    compression = body[CHUNK_HEAD.size : CHUNK_HEAD.size + min(letters, 8)]
    if size > MAX_RECORD:
        raise ValueError(f"a chunk with a stated size of {size / 2**20:.0f} MB")
    if whole and int.from_bytes(body[start - 8 : start], "little") != len(body) - start:
        raise ValueError("a chunk of another length than stated")
    data = _decompress(compression, body[start:], size, whole=whole)
    if whole and (len(data) != size or (checksum and zlib.crc32(data) != checksum)):
        raise ValueError("a chunk with a wrong checksum")
    return data


def _decompress(compression: bytes, data: bytes, size: int, *, whole: bool) -> bytes:
    """At most `size` bytes of what is compressed in `data`, whatever it says of itself."""
    if compression == b"":
        return data[:size]
    if compression == b"zstd":
        return _zstd(data, size, whole=whole)
    if compression == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        try:
            return bytes(LZ4FrameDecompressor().decompress(data, max_length=size))
        except RuntimeError as error:
            raise ValueError(str(error)) from None
    raise ValueError(f"compressed by {compression!r}")


def _zstd(data: bytes, size: int, *, whole: bool) -> bytes:
    """In pieces, so that what a cut frame holds is had before its end is missed."""
    from zstandard import ZstdDecompressor, ZstdError

    reader = ZstdDecompressor(max_window_size=2**26).stream_reader(data)
    pieces, left = [], size
    try:
        while left > 0 and (piece := reader.read(min(left, PIECE))):
            pieces.append(piece)
            left -= len(piece)
    except ZstdError as error:
        if whole:
            raise ValueError(str(error)) from None
    return b"".join(pieces)

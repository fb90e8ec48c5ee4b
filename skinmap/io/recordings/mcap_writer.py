"""Writing MCAP so that whatever ends the process leaves a file that opens.

The records are those of the package `mcap`. Its own writer closes a chunk by size only: at 50
samples a second of a whole robot, 64 kB last 0.3 s, and what is not yet in a closed chunk dies
with the process. Here a chunk closes by size or by time and reaches the system in one write.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Mapping
from typing import IO, Any

from skinmap import __version__

CHUNK_BYTES = 64 * 1024
CHUNK_SECONDS = 0.1  # half of what may be lost; the other half is for a busy machine
LEVEL = 3  # of zstd; higher ones gain a percent or two on noise
NS = 1_000_000_000
MAGIC = b"\x89MCAP0\r\n"


class McapWriter:
    """Records of an MCAP file, in chunks that close by size or by age.

    Parameters
    ----------
    file : binary file
        Unbuffered (`open(path, "wb", buffering=0)`), at its beginning.
    chunk_bytes : int
        Uncompressed size that closes a chunk.
    chunk_seconds : float
        Age that closes a chunk, in messages' time and by the clock.
    clock : callable
        Seconds.

    Notes
    -----
    An `OSError` (no space left) is passed on after the half-written record was taken back; then
    only `finish` may follow. It ends the file in fifty bytes, at the cost of its last chunk where
    even these do not fit.
    """

    def __init__(
        self,
        file: IO[bytes],
        *,
        chunk_bytes: int = CHUNK_BYTES,
        chunk_seconds: float = CHUNK_SECONDS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        from mcap.data_stream import RecordBuilder
        from mcap.records import Header, Statistics
        from zstandard import ZstdCompressor

        self._file, self._clock = file, clock
        self._most, self._age = chunk_bytes, chunk_seconds
        self._chunk, self._records = RecordBuilder(), RecordBuilder()
        self._places: dict[int, list[tuple[int, int]]] = {}  # of the open chunk, by channel
        self._span = (0, 0)  # of its messages [ns]
        self._compress = ZstdCompressor(level=LEVEL).compress
        self._began = 0.0
        self._broken = False
        self._schemas: list[Any] = []
        self._channels: list[Any] = []
        self._indexes: dict[str, bytearray] = {}  # packed: a day of chunks stays small
        self._last_chunks: list[int] = []  # where the newest of them begin
        self._counts = Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
        self.size = 0
        self._put(MAGIC)
        self._record(Header("", f"skinmap {__version__}"))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Describe a kind of message; its number."""
        from mcap.records import Schema

        schema = Schema(len(self._schemas) + 1, data, encoding, name)
        self._schemas.append(schema)
        self._record(schema)
        return int(schema.id)

    def add_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Open a channel for messages of one kind; its number."""
        from mcap.records import Channel

        channel = Channel(len(self._channels) + 1, topic, encoding, dict(metadata or {}), schema)
        self._channels.append(channel)
        self._counts.channel_message_counts[channel.id] = 0
        self._record(channel)
        return int(channel.id)

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a table of words."""
        from mcap.records import Metadata, MetadataIndex

        offset = self.size
        self._record(Metadata(name, dict(content)))
        self._counts.metadata_count += 1
        self._index(MetadataIndex(offset, self.size - offset, name))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write a small file into this one."""
        from mcap.records import Attachment, AttachmentIndex

        offset = self.size
        self._record(Attachment(0, 0, name, media_type, data))
        self._counts.attachment_count += 1
        self._index(AttachmentIndex(offset, self.size - offset, 0, 0, len(data), name, media_type))

    def add_message(self, channel: int, nanoseconds: int, data: bytes, sequence: int) -> None:
        """Add a message to the open chunk; close the chunk if it is large or old enough."""
        from mcap.records import Message

        chunk, counts = self._chunk, self._counts
        if not self._places:
            self._began = self._clock()
            self._span = (nanoseconds, nanoseconds)
        self._span = (min(self._span[0], nanoseconds), max(self._span[1], nanoseconds))
        self._places.setdefault(channel, []).append((nanoseconds, chunk.count))
        Message(channel, nanoseconds, data, nanoseconds, sequence & 0xFFFFFFFF).write(chunk)
        if counts.message_count == 0:
            counts.message_start_time = nanoseconds
        counts.message_start_time = min(nanoseconds, counts.message_start_time)
        counts.message_end_time = max(nanoseconds, counts.message_end_time)
        counts.channel_message_counts[channel] += 1
        counts.message_count += 1
        old = max(self.age, (self._span[1] - self._span[0]) / NS) >= self._age
        if old or chunk.count >= self._most:
            self.flush()

    @property
    def age(self) -> float:
        """Seconds since the first message that is not yet in a closed chunk; 0 where none is."""
        return self._clock() - self._began if self._places else 0.0

    def flush(self) -> None:
        """Close the open chunk and give it to the system."""
        from mcap.records import Chunk, ChunkIndex, MessageIndex

        if not self._places:
            return
        data, indexes, (start, end) = self._chunk.end(), self._places, self._span
        self._places = {}
        chunk = Chunk("zstd", self._compress(data), end, start, zlib.crc32(data), len(data))
        offset, records = self.size, self._records
        chunk.write(records)
        length, places = records.count, {}
        for channel, messages in indexes.items():
            places[channel] = offset + records.count
            MessageIndex(channel, messages).write(records)
        after = records.count - length
        self._put(records.end())
        self._counts.chunk_count += 1
        self._last_chunks = [*self._last_chunks[-3:], offset]
        self._index(
            ChunkIndex(
                length, offset, "zstd", len(chunk.data), end, after, places, start, len(data)
            )
        )

    def finish(self) -> None:
        """End the file, with its index where there is room for it."""
        if not self._broken:
            try:
                self.flush()
                self._end(self._summary())
                return
            except OSError:
                self._end_shortly()
                raise
        self._end_shortly()

    def _end_shortly(self) -> None:
        """End without an index: readers then go through the file from its beginning."""
        while True:
            try:
                self._end([])
                return
            except OSError:
                if not self._last_chunks:
                    return  # not even a header fits: nothing was recorded
                self.size = self._last_chunks.pop()
                self._file.truncate(self.size)
                self._file.seek(self.size)

    def _summary(self) -> list[bytes]:
        """Groups of records that repeat and index what the file holds."""
        from mcap.data_stream import RecordBuilder

        self._counts.schema_count = len(self._schemas)
        self._counts.channel_count = len(self._channels)
        groups = []
        for records in (self._schemas, self._channels, [self._counts]):
            builder = RecordBuilder()
            for record in records:
                record.write(builder)
            groups.append(builder.end())
        return [group for group in [*groups, *map(bytes, self._indexes.values())] if group]

    def _end(self, groups: list[bytes]) -> None:
        from mcap.data_stream import RecordBuilder
        from mcap.records import DataEnd, Footer, SummaryOffset

        builder = RecordBuilder()
        DataEnd(0).write(builder)
        summary_start = self.size + builder.count
        summary = RecordBuilder()
        offsets = RecordBuilder()
        for group in groups:
            SummaryOffset(group[0], summary_start + summary.count, len(group)).write(offsets)
            summary.write(group)
        offset_start = summary_start + summary.count if groups else 0
        content = summary.end() + offsets.end()
        footer = RecordBuilder()
        Footer(summary_start if groups else 0, offset_start, 0).write(footer)
        fixed = footer.end()
        # The sum covers the summary and the footer as far as the sum itself.
        crc = zlib.crc32(fixed[:-4], zlib.crc32(content))
        self._put(builder.end() + content + fixed[:-4] + crc.to_bytes(4, "little") + MAGIC)

    def _index(self, record: Any) -> None:
        from mcap.data_stream import RecordBuilder

        builder = RecordBuilder()
        record.write(builder)
        self._indexes.setdefault(type(record).__name__, bytearray()).extend(builder.end())

    def _record(self, record: Any) -> None:
        record.write(self._records)
        self._put(self._records.end())

    def _put(self, data: bytes) -> None:
        """All of it or nothing."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            self._broken = True
            self._file.truncate(self.size)
            self._file.seek(self.size)
            raise
        self.size += len(data)

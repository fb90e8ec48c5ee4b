"""Writing MCAP so that whatever ends the process leaves a file that opens.

The writer is that of the package `mcap`. Here it is told to close a chunk by age as well as by
size; a chunk reaches the system in one write, and a write that fails is taken back.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import IO, Any

from skinmap import __version__

CHUNK_BYTES = 64 * 1024
CHUNK_SECONDS = 0.1  # half of what may be lost; the other half is for a busy machine
NS = 1_000_000_000
MAGIC = b"\x89MCAP0\r\n"
KEPT = 4  # of the newest writes whose places are known: a file ends where one of them began


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
        from mcap.writer import Writer

        self._sink, self._clock, self._age = _WholeWrites(file), clock, chunk_seconds
        self._writer: Any = Writer(self._sink, chunk_size=chunk_bytes)  # type: ignore[arg-type]
        self._span: tuple[int, int] | None = None  # of the open chunk's messages [ns]
        self._began = 0.0
        self._writer.start(profile="ros2", library=f"skinmap {__version__}")
        self._sink.flush()

    @property
    def size(self) -> int:
        """Bytes that the system has."""
        return self._sink.size

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Describe a kind of message; its number."""
        from mcap.records import Schema

        number = int(self._writer.register_schema(name, encoding, data))
        self._say(Schema(number, data, encoding, name))
        return number

    def add_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Open a channel for messages of one kind; its number."""
        from mcap.records import Channel

        known = dict(metadata or {})
        number = int(self._writer.register_channel(topic, encoding, schema, known))
        self._say(Channel(number, topic, encoding, known, schema))
        return number

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a table of words."""
        self._writer.add_metadata(name, dict(content))
        self._sink.flush()

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write a small file into this one."""
        self._writer.add_attachment(0, 0, name, media_type, data)
        self._sink.flush()

    def add_message(self, channel: int, nanoseconds: int, data: bytes, sequence: int) -> None:
        """Add a message to the open chunk; close the chunk if it is large or old enough."""
        if self._span is None:
            self._began, self._span = self._clock(), (nanoseconds, nanoseconds)
        low, high = min(self._span[0], nanoseconds), max(self._span[1], nanoseconds)
        self._span = (low, high)
        self._writer.add_message(channel, nanoseconds, data, nanoseconds, sequence & 0xFFFFFFFF)
        if self._sink.waiting or max(self.age, (high - low) / NS) >= self._age:
            self.flush()

    @property
    def age(self) -> float:
        """Seconds since the first message that is not yet in a closed chunk; 0 where none is."""
        return 0.0 if self._span is None else self._clock() - self._began

    def flush(self) -> None:
        """Close the open chunk and give it to the system."""
        self._span = None
        self._writer.flush()

    @property
    def broken(self) -> bool:
        """Whether the system refused a write: only `finish` may follow."""
        return self._sink.broken

    def finish(self, metadata: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """End the file, with last tables of words and its index where there is room for them."""
        if not self.broken:
            try:
                self.flush()
                for name, content in (metadata or {}).items():
                    self._writer.add_metadata(name, dict(content))
                self._writer.finish()
                self._sink.flush()
                return
            except OSError:
                self._end_shortly()
                raise
        self._end_shortly()

    def _say(self, record: Any) -> None:
        """Write a description at once; the writer's own stands in a chunk, which may be lost."""
        from mcap.data_stream import RecordBuilder

        builder = RecordBuilder()
        record.write(builder)
        self._sink.write(builder.end())
        self._sink.flush()

    def _end_shortly(self) -> None:
        """End without an index: readers then go through the file from its beginning."""
        from mcap.data_stream import RecordBuilder
        from mcap.records import DataEnd, Footer

        builder = RecordBuilder()
        DataEnd(0).write(builder)
        Footer(0, 0, 0).write(builder)  # no checksum is asked for
        end = builder.end() + MAGIC
        while True:
            self._sink.write(end)
            try:
                self._sink.flush()
                return
            except OSError:
                if not self._sink.step_back():
                    return  # not even a header fits: nothing was recorded


class _WholeWrites:
    """A file for `mcap.writer.Writer` that gets all that came between two flushes, or nothing."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._waiting = bytearray()
        self._starts: list[int] = []
        self.size = 0
        self.broken = False

    @property
    def waiting(self) -> bool:
        """Whether something was not yet given to the system."""
        return bool(self._waiting)

    def write(self, data: bytes) -> int:
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        return self.size + len(self._waiting)

    def flush(self) -> None:
        rest = memoryview(bytes(self._waiting))
        self._waiting.clear()
        length = len(rest)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            self.broken = True
            self._cut(self.size)
            raise
        self._starts = [*self._starts[1 - KEPT :], self.size]
        self.size += length

    def step_back(self) -> bool:
        """Take the newest write back; False where its place is not known."""
        if not self._starts:
            return False
        self._cut(self._starts.pop())
        return True

    def _cut(self, size: int) -> None:
        self.size = size
        self._file.truncate(size)
        self._file.seek(size)

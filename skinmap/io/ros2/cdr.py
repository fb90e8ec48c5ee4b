"""CDR, the bytes of ROS 2's messages: numbers at multiples of their size, lengths before texts.

Plain CDR of DDS-XTypes 1.3, little-endian, as rmw implementations write it. Alignment counts from
the end of the four bytes that say so.
"""

from __future__ import annotations

import struct
from typing import Any

from skinmap.errors import MessageError

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
HEAD = len(LITTLE_ENDIAN)
MAX_TEXT = 1 << 24  # bytes of one text; a robot's description is the longest [bytes]


class CdrWriter:
    """A message that is being written."""

    def __init__(self) -> None:
        self._data = bytearray(LITTLE_ENDIAN)

    def __len__(self) -> int:
        return len(self._data)

    def put(self, form: str, *values: float) -> None:
        """Add numbers of one `struct` format letter, aligned to its size."""
        self.align(struct.calcsize(form))
        self._data += struct.pack(f"<{len(values)}{form}", *values)

    def text(self, text: str) -> None:
        """Add a text."""
        data = text.encode() + b"\0"
        self.put("I", len(data))
        self._data += data

    def sequence(self, data: bytes, count: int, size: int) -> None:
        """Add a sequence of `count` numbers of `size` bytes that are packed already."""
        self.put("I", count)
        if count:
            self.align(size)
            self._data += data

    def time(self, nanoseconds: int) -> None:
        """Add a `builtin_interfaces/Time`."""
        whole, rest = divmod(nanoseconds, 1_000_000_000)
        # ROS 2's seconds are an int32, MCAP's times reach further: beyond 2038 they stop there.
        self.put("i", min(whole, 2**31 - 1))
        self.put("I", rest)

    def header(self, nanoseconds: int, frame: str) -> None:
        """Add a `std_msgs/Header`."""
        self.time(nanoseconds)
        self.text(frame)

    def align(self, size: int) -> None:
        """Fill up to a multiple of a size."""
        self._data += bytes(-(len(self._data) - HEAD) % size)

    def done(self) -> bytes:
        """The message."""
        return bytes(self._data)


class CdrReader:
    """A message that is being read.

    Raises
    ------
    MessageError
        Not CDR in one of both byte orders; here and below: it ends before what it promises.
    """

    def __init__(self, message: bytes) -> None:
        if len(message) < HEAD or message[0] != 0 or message[1] not in (0, 1):
            raise MessageError(f"not a CDR message: it begins with {message[:HEAD].hex()}")
        self._data, self._at = message, HEAD
        self.order = "<" if message[1] else ">"

    def get(self, form: str) -> Any:
        """The next number of a `struct` format letter."""
        size = struct.calcsize(form)
        self._at += -(self._at - HEAD) % size
        (value,) = struct.unpack(self.order + form, self.raw(size))
        return value

    def text(self) -> str:
        """The next text."""
        length = self.get("I")
        if length > MAX_TEXT:
            raise MessageError(f"a text of {length} bytes, at most {MAX_TEXT} are read")
        return self.raw(length).rstrip(b"\0").decode(errors="replace")

    def raw(self, size: int) -> bytes:
        """The next bytes."""
        if self._at + size > len(self._data):
            raise MessageError(f"a message of {len(self._data)} bytes promises more")
        data = self._data[self._at : self._at + size]
        self._at += size
        return data

    def sequence(self, size: int) -> bytes:
        """The bytes of a sequence of numbers of `size` bytes."""
        count = self.get("I")
        if count:
            self._at += -(self._at - HEAD) % size
        return self.raw(count * size)

    def header(self) -> tuple[int, str]:
        """Time [ns] and frame of a `std_msgs/Header`."""
        whole, rest = self.get("i"), self.get("I")
        return whole * 1_000_000_000 + rest, self.text()

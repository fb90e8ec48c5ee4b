"""Arrays as ROS 2 messages: `std_msgs/msg/UInt8MultiArray` and `Float32MultiArray` in CDR.

Readers of ROS 2 messages decode them from the definition that stands in the file, so that
a recording needs no reader of ours. A message is 36 bytes and the values; all but the values is
the same in every sample and costs nothing once compressed.
"""

from __future__ import annotations

import struct
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Number = Literal["UInt8", "Float32"]
DTYPES: dict[Number, np.dtype[Any]] = {"UInt8": np.dtype("u1"), "Float32": np.dtype("<f4")}
LITTLE_ENDIAN = b"\x00\x01\x00\x00"
LABEL = b"channel\0"
# One dimension, its label, size and stride, the offset of the data and their number.
HEAD = struct.Struct(f"<4sII{len(LABEL)}sIIII")


def array_type(number: Number) -> str:
    """The message type of an array."""
    return f"std_msgs/{number}MultiArray"


def encode(values: NDArray[Any], number: Number) -> bytes:
    """One sample (n,) as a message."""
    n = len(values)
    head = HEAD.pack(LITTLE_ENDIAN, 1, len(LABEL), LABEL, n, n, 0, n)
    return head + values.astype(DTYPES[number], copy=False).tobytes()


def decode(message: bytes, number: Number) -> NDArray[Any]:
    """The values (n,) of a message that `encode` made.

    Raises
    ------
    ValueError
        Another kind of message, or one whose length is not what it says.
    """
    if len(message) < HEAD.size:
        raise ValueError(f"a message of {len(message)} bytes")
    start, dimensions, length, label, size, _, _, n = HEAD.unpack_from(message)
    kind = DTYPES[number]
    if (start, dimensions, length, label, size) != (LITTLE_ENDIAN, 1, len(LABEL), LABEL, n):
        raise ValueError("not one row of values")
    if len(message) != HEAD.size + n * kind.itemsize:
        raise ValueError(f"{n} values expected, got {len(message) - HEAD.size} bytes")
    return np.frombuffer(message, kind, offset=HEAD.size)

"""ROS 2's message types by rosbags: definitions, hashes, messages as CDR, and bags.

Types are named in short, `std_msgs/String`. rosbags is imported when a message is written or read.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import MessageError


@lru_cache
def type_store() -> Any:
    """Types of Jazzy; those that are used here are the same in Humble, but for constants."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def full_name(kind: str) -> str:
    """The name as ROS 2 writes it: std_msgs/msg/String."""
    return kind.replace("/", "/msg/")


def dds_name(kind: str) -> str:
    """The name as it stands in keys of rmw_zenoh: std_msgs::msg::dds_::String_."""
    return kind.replace("/", "::msg::dds_::") + "_"


@lru_cache
def type_hash(kind: str) -> str:
    """The hash of a type, as rmw_zenoh puts it into its keys."""
    return str(type_store().hash_rihs01(full_name(kind)))


@lru_cache
def definition(kind: str) -> bytes:
    """A message type as text, with all types that it holds (MCAP's encoding `ros2msg`)."""
    text, _ = type_store().generate_msgdef(full_name(kind), ros_version=2)
    return str(text).encode()


def build(kind: str, *fields: Any) -> Any:
    """A message, or a part of one, of the values of its fields in their order."""
    return type_store().types[full_name(kind)](*fields)


def time_message(nanoseconds: int) -> Any:
    """A `builtin_interfaces/Time`; its seconds are an int32, so beyond 2038 they stop there."""
    whole, rest = divmod(nanoseconds, 1_000_000_000)
    return build("builtin_interfaces/Time", min(whole, 2**31 - 1), rest)


def header(nanoseconds: int, frame: str) -> Any:
    """A `std_msgs/Header`."""
    return build("std_msgs/Header", time_message(nanoseconds), frame)


def write(kind: str, *fields: Any) -> bytes:
    """A message of the values of its fields as bytes, little-endian."""
    found = build(kind, *fields)
    return bytes(type_store().serialize_cdr(found, full_name(kind), little_endian=True))


def read(kind: str, data: bytes) -> Any:
    """A message out of its bytes.

    Raises
    ------
    MessageError
        Another message, or one that promises more than it holds.
    """
    from rosbags.serde import SerdeError

    try:
        return type_store().deserialize_cdr(data, full_name(kind))
    except SerdeError as error:
        raise MessageError(f"not a message of type {kind}: {error}") from error


def nanoseconds_of(head: Any) -> int:
    """Time [ns] of a `std_msgs/Header`."""
    return int(head.stamp.sec) * 1_000_000_000 + int(head.stamp.nanosec)


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


# What rosbag2 keeps of a bag beside its messages: topics, counts, times, quality of service.
# Version 5 of the format, as ROS 2 Humble writes it; later ones read it.
BAG_METADATA, BAG_KEY = "rosbag2", "serialized_metadata"
QOS_KEY = "offered_qos_profiles"
FOREVER = "{sec: 9223372036, nsec: 854775807}"  # how rosbag2 writes an infinite duration
DEPTH = 10  # messages that a publisher keeps, ROS 2's own default


@dataclass(slots=True)
class TopicFacts:
    """What is known of a topic.

    Attributes
    ----------
    kind : str
        Its type's full name.
    latched : bool
        Whether who comes late gets its last message.
    messages : int
        How many were written.
    first, last : int
        Times of the earliest and latest [ns].
    """

    kind: str
    latched: bool
    messages: int = 0
    first: int = 2**63 - 1
    last: int = 0

    def count(self, stamp: int) -> None:
        """Take note of a message of a time [ns]."""
        self.messages += 1
        self.first, self.last = min(self.first, stamp), max(self.last, stamp)


def qos_profile(*, latched: bool) -> str:
    """The quality of service that a topic was offered with, as YAML in one line."""
    depth, durability = (1, 1) if latched else (DEPTH, 2)
    return (
        f"[{{history: 1, depth: {depth}, reliability: 1, durability: {durability}, "
        f"deadline: {FOREVER}, lifespan: {FOREVER}, liveliness: 1, "
        f"liveliness_lease_duration: {FOREVER}, avoid_ros_namespace_conventions: false}}]"
    )


def bag_metadata(file: str, topics: Mapping[str, TopicFacts]) -> str:
    """The content of `metadata.yaml` for a bag of one MCAP file.

    Parameters
    ----------
    file : str
        Its name.
    topics : mapping of str to TopicFacts
    """
    total = sum(one.messages for one in topics.values())
    first = min((one.first for one in topics.values()), default=0) if total else 0
    span = max((one.last for one in topics.values()), default=0) - first if total else 0
    name = json.dumps(file)
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 5",
        "  storage_identifier: mcap",
        f"  duration: {{nanoseconds: {span}}}",
        f"  starting_time: {{nanoseconds_since_epoch: {first}}}",
        f"  message_count: {total}",
        "  topics_with_message_count:",
    ]
    for topic, one in topics.items():
        lines += [
            "    - topic_metadata:",
            f"        name: {topic}",
            f"        type: {one.kind}",
            "        serialization_format: cdr",
            f"        {QOS_KEY}: {json.dumps(qos_profile(latched=one.latched))}",
            f"      message_count: {one.messages}",
        ]
    lines += [
        '  compression_format: ""',
        '  compression_mode: ""',
        f"  relative_file_paths: [{name}]",
        "  files:",
        f"    - path: {name}",
        f"      starting_time: {{nanoseconds_since_epoch: {first}}}",
        f"      duration: {{nanoseconds: {span}}}",
        f"      message_count: {total}",
    ]
    return "\n".join(lines) + "\n"

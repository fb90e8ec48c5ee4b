"""ROS 2's message types by rosbags: definitions, hashes, messages as CDR, and bags.

Types are named in short, `std_msgs/String`. rosbags is imported when a message is written or read.

Transforms, clouds of points, markers, joint angles and texts are made as bytes.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
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
# The whole of it, a topic in it, and the quality of service that a topic was offered with.
BAG, COUNTS, QOS = (
    Path(__file__).with_name("metadata.yaml").read_text(encoding="ascii").split("---\n")
)
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
    return QOS.format(depth=depth, durability=durability)


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
    counts = "".join(
        COUNTS.format(topic, one.kind, json.dumps(qos_profile(latched=one.latched)), one.messages)
        for topic, one in topics.items()
    )
    file = json.dumps(file)
    return BAG.format(file=file, topics=counts, first=first, span=span, total=total)


FLOAT32 = 7
# How `sensor_msgs/PointField` numbers its types.
FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", FLOAT32: "f4", 8: "f8"}
MAX_TEXT = 1 << 24  # bytes of a text; a robot's description is the longest
BODY, STAMP = 4, struct.Struct("<iI")  # where a message begins that has a header, and its time
MAX_FIELDS = 64  # of a cloud; lidars with a dozen are the richest
SPHERE, WORDS = 2, 9  # kinds of markers
SPACES = {SPHERE: "touch", WORDS: "name"}
ADD, DELETE = 0, 2
TOUCH_SIZE, WORD_SIZE = 0.015, 0.03  # [m]: a fingertip; readable beside a forearm
WORD_HEIGHT = 0.03  # of a name above its touch [m]
RED = (0.94, 0.25, 0.16, 0.9)
WHITE = (1.0, 1.0, 1.0, 1.0)


def text_message(text: str) -> bytes:
    """A `std_msgs/String`."""
    return write("std_msgs/String", text)


def read_text(data: bytes) -> str:
    """The text of a `std_msgs/String`.

    Raises
    ------
    MessageError
        Another message, or a text above 16 MB.
    """
    if len(data) > MAX_TEXT:
        raise MessageError(f"a text of {len(data)} bytes, at most {MAX_TEXT} are read")
    return str(read("std_msgs/String", data).data)


def transforms_message(
    stamp: int, pairs: Sequence[tuple[str, str]], T_parent_child: FloatArray
) -> bytes:
    """A `tf2_msgs/TFMessage`.

    Parameters
    ----------
    stamp : int
        [ns].
    pairs : sequence of (str, str)
        Parent and child of each of n transforms.
    T_parent_child : (n, 4, 4) float
        [m].
    """
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(T_parent_child[:, :3, :3]).as_quat() if pairs else []
    rows = zip(pairs, T_parent_child[:, :3, 3].tolist(), np.asarray(turns).tolist(), strict=True)
    transforms = [
        build(
            "geometry_msgs/TransformStamped",
            header(stamp, parent),
            child,
            build(
                "geometry_msgs/Transform",
                build("geometry_msgs/Vector3", *place),
                build("geometry_msgs/Quaternion", *turn),
            ),
        )
        for (parent, child), place, turn in rows
    ]
    return write("tf2_msgs/TFMessage", transforms)


def joints_message(stamp: int, angles: Mapping[str, float]) -> bytes:
    """A `sensor_msgs/JointState` of positions [rad or m]."""
    values, none = np.array(list(angles.values()), np.float64), np.zeros(0)
    return write("sensor_msgs/JointState", header(stamp, ""), list(angles), values, none, none)


def read_joints(data: bytes) -> dict[str, float]:
    """The positions in a `sensor_msgs/JointState` by joint."""
    told = read("sensor_msgs/JointState", data)
    return dict(zip(told.name, told.position.tolist(), strict=False))


class Cloud:
    """A `sensor_msgs/PointCloud2` whose points stay where they are while one value changes.

    Parameters
    ----------
    frame : str
    positions : (n, 3) float
        In the frame [m].
    field : str
        Name of the value beside x, y and z; all are float32.
    """

    def __init__(self, frame: str, positions: FloatArray, field: str) -> None:
        names = ["x", "y", "z", field]
        kind = np.dtype([(name, "<f4") for name in names])
        fields = [
            build("sensor_msgs/PointField", name, 4 * place, FLOAT32, 1)
            for place, name in enumerate(names)
        ]
        count, step = len(positions), kind.itemsize
        data = np.zeros(count * step, np.uint8)
        self._message = bytearray(
            write("sensor_msgs/PointCloud2", header(0, frame), 1, count, fields, False, step,
                  count * step, data, True)
        )  # fmt: skip
        start = len(self._message) - 1 - len(data)  # behind the points: whether all are finite
        self._points = np.frombuffer(self._message, kind, len(positions), start)
        self._field = field
        self.move(positions)

    def move(self, positions: FloatArray) -> None:
        """Put the points elsewhere [m]."""
        for name, column in zip("xyz", np.asarray(positions, np.float32).T, strict=True):
            self._points[name] = column

    def message(self, stamp: int, values: NDArray[Any]) -> bytes:
        """The cloud with values (n,) at a time [ns]."""
        when = time_message(stamp)
        STAMP.pack_into(self._message, BODY, when.sec, when.nanosec)
        self._points[self._field] = values
        return bytes(self._message)


def read_cloud(data: bytes) -> tuple[int, NDArray[Any]]:
    """Time [ns] and points (n,) of a `sensor_msgs/PointCloud2`.

    Raises
    ------
    MessageError
        Another message, or one whose sizes contradict each other.
    """
    cloud = read("sensor_msgs/PointCloud2", data)
    if len(cloud.fields) > MAX_FIELDS:
        raise MessageError(f"a cloud of {len(cloud.fields)} fields, at most {MAX_FIELDS} are read")
    return nanoseconds_of(cloud.header), points_of(cloud)


def points_of(cloud: Any) -> NDArray[Any]:
    """The points (n,) of a `sensor_msgs/PointCloud2` as a structured array.

    Raises
    ------
    MessageError
        Fields that do not fit into a point, or points that are not there.
    """
    order = ">" if cloud.is_bigendian else "<"
    step, row_step = int(cloud.point_step), int(cloud.row_step)
    height, width = int(cloud.height), int(cloud.width)
    data = np.asarray(cloud.data).tobytes()
    fields = [
        (str(f.name), int(f.offset), order + FIELD_TYPES[int(f.datatype)])
        for f in cloud.fields
        if int(f.datatype) in FIELD_TYPES and int(f.count) == 1
    ]
    names, offsets = [one[0] for one in fields], [one[1] for one in fields]
    formats = [one[2] for one in fields]
    try:
        kind = np.dtype({"names": names, "offsets": offsets, "formats": formats, "itemsize": step})
        if height * width == 0:
            return np.zeros(0, kind)
        row = width * step
        between = row_step if height > 1 else row
        if step < 1 or between < row or (height - 1) * between + row > len(data):
            raise ValueError(
                f"{height} rows of {row_step} bytes for {width} points of {step} bytes in "
                f"{len(data)} bytes"
            )
        rows = [np.frombuffer(data, kind, width, number * between) for number in range(height)]
    except ValueError as error:
        raise MessageError(f"a cloud that contradicts itself: {error}") from error
    return np.concatenate(rows)


@dataclass(frozen=True, eq=False, slots=True)
class TouchMarker:
    """A touch to be marked: its number, link, centre (3,) [m] in the link's frame, and name.

    Where its load is known, `wrench (6,)` is the force on the skin [N] and its moment about the
    origin of the link [N m], `covariance (6, 6)` that of both.
    """

    identity: int
    link: str
    centre: FloatArray
    name: str
    wrench: FloatArray | None = None
    covariance: FloatArray | None = None


def wrench_message(stamp: int, link: str, wrench: FloatArray) -> bytes:
    """A `geometry_msgs/WrenchStamped` of force and moment (6,) in the frame of a link."""
    parts = (build("geometry_msgs/Vector3", *each) for each in wrench.reshape(2, 3).tolist())
    return write(
        "geometry_msgs/WrenchStamped", header(stamp, link), build("geometry_msgs/Wrench", *parts)
    )


def covariance_message(covariance: FloatArray) -> bytes:
    """A `std_msgs/Float64MultiArray` of a covariance (6, 6), row by row."""
    layout = build("std_msgs/MultiArrayLayout", [], 0)
    return write("std_msgs/Float64MultiArray", layout, np.ravel(covariance).astype(np.float64))


def markers_message(stamp: int, touches: Sequence[TouchMarker], gone: Sequence[int]) -> bytes:
    """A `visualization_msgs/MarkerArray`: a ball and a name for each touch.

    Parameters
    ----------
    stamp : int
        [ns].
    touches : sequence of TouchMarker
    gone : sequence of int
        Numbers of touches whose marks are to be taken away.
    """
    marks = []
    for one in touches:
        above = one.centre + np.array([0.0, 0.0, WORD_HEIGHT])
        marks.append(_marker(stamp, one.link, one.identity, SPHERE, one.centre))
        marks.append(_marker(stamp, one.link, one.identity, WORDS, above, one.name))
    marks += [_marker(stamp, "", identity, kind) for identity in gone for kind in SPACES]
    return write("visualization_msgs/MarkerArray", marks)


def _marker(
    stamp: int, frame: str, identity: int, kind: int, at: FloatArray | None = None, words: str = ""
) -> Any:
    """One `visualization_msgs/Marker`, field by field; without a place the old one goes."""
    size = WORD_SIZE if kind == WORDS else TOUCH_SIZE
    nothing = np.zeros(0, np.uint8)
    pose = build(
        "geometry_msgs/Pose",
        build("geometry_msgs/Point", *(np.zeros(3) if at is None else at).tolist()),
        build("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 1.0),
    )
    return build(
        "visualization_msgs/Marker",
        header(stamp, frame),
        SPACES[kind],
        identity,
        kind,
        DELETE if at is None else ADD,
        pose,
        build("geometry_msgs/Vector3", size, size, size),
        build("std_msgs/ColorRGBA", *(WHITE if kind == WORDS else RED)),
        build("builtin_interfaces/Duration", 0, 0),  # until it is taken away
        True,  # moves with its link
        [],  # points, colours
        [],
        "",  # texture and its image
        build("sensor_msgs/CompressedImage", header(0, ""), "", nothing),
        [],
        words,
        "",  # mesh and its file
        build("visualization_msgs/MeshFile", "", nothing),
        False,
    )

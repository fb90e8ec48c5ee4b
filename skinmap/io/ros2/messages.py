"""Messages of ROS 2 as bytes: transforms, clouds of points, markers, joint angles, texts."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import MessageError
from skinmap.io.ros2.cdr import HEAD, CdrReader, CdrWriter

FLOAT32 = 7
# How `sensor_msgs/PointField` numbers its types.
FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", FLOAT32: "f4", 8: "f8"}
MAX_FIELDS = 64  # of a cloud; lidars with a dozen are the richest
SPHERE, WORDS = 2, 9  # kinds of markers
ADD, DELETE = 0, 2
TOUCH_SIZE, WORD_SIZE = 0.015, 0.03  # [m]: a fingertip; readable beside a forearm
WORD_HEIGHT = 0.03  # of a name above its touch [m]
RED = (0.94, 0.25, 0.16, 0.9)
WHITE = (1.0, 1.0, 1.0, 1.0)


def text_message(text: str) -> bytes:
    """A `std_msgs/String`."""
    message = CdrWriter()
    message.text(text)
    return message.done()


def read_text(message: bytes) -> str:
    """The text of a `std_msgs/String`."""
    return CdrReader(message).text()


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

    message = CdrWriter()
    message.put("I", len(pairs))
    turns = Rotation.from_matrix(T_parent_child[:, :3, :3]).as_quat() if pairs else []
    rows = zip(pairs, T_parent_child[:, :3, 3].tolist(), np.asarray(turns).tolist(), strict=True)
    for (parent, child), place, turn in rows:
        message.header(stamp, parent)
        message.text(child)
        message.put("d", *place, *turn)
    return message.done()


def joints_message(stamp: int, angles: Mapping[str, float]) -> bytes:
    """A `sensor_msgs/JointState` of positions [rad or m]."""
    message = CdrWriter()
    message.header(stamp, "")
    message.put("I", len(angles))
    for name in angles:
        message.text(name)
    values = np.array(list(angles.values()), "<f8")
    message.sequence(values.tobytes(), len(values), 8)
    message.put("I", 0)
    message.put("I", 0)
    return message.done()


def read_joints(message: bytes) -> dict[str, float]:
    """The positions in a `sensor_msgs/JointState` by joint."""
    reader = CdrReader(message)
    reader.header()
    names = [reader.text() for _ in range(reader.get("I"))]
    values = np.frombuffer(reader.sequence(8), f"{reader.order}f8")
    return dict(zip(names, values.tolist(), strict=False))


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
        head = CdrWriter()
        head.header(0, frame)
        head.put("I", 1, len(positions), len(names))
        for place, name in enumerate(names):
            head.text(name)
            head.put("I", 4 * place)
            head.put("B", FLOAT32)
            head.put("I", 1)
        head.put("B", 0)
        size = kind.itemsize * len(positions)
        head.put("I", kind.itemsize, size)
        head.sequence(bytes(size), size, 1)
        start = len(head) - size
        head.put("B", 1)
        self._message = bytearray(head.done())
        self._points = np.frombuffer(self._message, kind, len(positions), start)
        self._field = field
        self.move(positions)

    def move(self, positions: FloatArray) -> None:
        """Put the points elsewhere [m]."""
        for name, column in zip("xyz", np.asarray(positions, np.float32).T, strict=True):
            self._points[name] = column

    def message(self, stamp: int, values: NDArray[Any]) -> bytes:
        """The cloud with values (n,) at a time [ns]."""
        whole, rest = divmod(stamp, 1_000_000_000)
        struct.pack_into("<iI", self._message, HEAD, min(whole, 2**31 - 1), rest)
        self._points[self._field] = values
        return bytes(self._message)


@dataclass(frozen=True, eq=False, slots=True)
class ReadCloud:
    """A cloud that came.

    Attributes
    ----------
    stamp : int
        [ns].
    frame : str
    points : (n,) structured array
        A column for each field of one number.
    """

    stamp: int
    frame: str
    points: NDArray[Any]


def read_cloud(message: bytes) -> ReadCloud:
    """Read a `sensor_msgs/PointCloud2`.

    Raises
    ------
    MessageError
        Another message, or one whose sizes contradict each other.
    """
    reader = CdrReader(message)
    stamp, frame = reader.header()
    height, width, count = (reader.get("I") for _ in range(3))
    if count > MAX_FIELDS:
        raise MessageError(f"a cloud of {count} fields, at most {MAX_FIELDS} are read")
    told = [
        (reader.text(), reader.get("I"), reader.get("B"), reader.get("I")) for _ in range(count)
    ]
    order = ">" if reader.get("B") else "<"
    step, row_step = reader.get("I"), reader.get("I")
    data = reader.sequence(1)
    return ReadCloud(stamp, frame, cloud_points(told, order, step, row_step, (height, width), data))


def cloud_points(
    fields: Sequence[tuple[str, int, int, int]],
    order: str,
    step: int,
    row_step: int,
    shape: tuple[int, int],
    data: bytes,
) -> NDArray[Any]:
    """The points (n,) of a cloud as a structured array.

    Parameters
    ----------
    fields : sequence of (str, int, int, int)
        Name, offset, type and count of each.
    order : {"<", ">"}
        Of the bytes.
    step, row_step : int
        Bytes from point to point and from row to row.
    shape : (int, int)
        Rows, and points in one.
    data : bytes

    Raises
    ------
    MessageError
        Fields that do not fit into a point, or points that are not there.
    """
    kinds = [(name, at, FIELD_TYPES.get(code, ""), count) for name, at, code, count in fields]
    held = [(name, at, order + kind) for name, at, kind, count in kinds if kind and count == 1]
    try:
        kind = np.dtype(
            {
                "names": [name for name, _, _ in held],
                "offsets": [at for _, at, _ in held],
                "formats": [form for _, _, form in held],
                "itemsize": step,
            }
        )
        height, width = shape
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
    """A touch to be marked: its number, link, centre (3,) [m] in the link's frame, and name."""

    identity: int
    link: str
    centre: FloatArray
    name: str


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
    message = CdrWriter()
    message.put("I", 2 * (len(touches) + len(gone)))
    for one in touches:
        above = one.centre + np.array([0.0, 0.0, WORD_HEIGHT])
        _marker(message, stamp, one.link, "touch", one.identity, SPHERE, ADD, one.centre)
        _marker(message, stamp, one.link, "name", one.identity, WORDS, ADD, above, one.name)
    for identity in gone:
        for space, kind in (("touch", SPHERE), ("name", WORDS)):
            _marker(message, stamp, "", space, identity, kind, DELETE, np.zeros(3))
    return message.done()


def _marker(
    message: CdrWriter,
    stamp: int,
    frame: str,
    space: str,
    identity: int,
    kind: int,
    action: int,
    place: FloatArray,
    words: str = "",
) -> None:
    """One `visualization_msgs/Marker`, field by field."""
    size = WORD_SIZE if kind == WORDS else TOUCH_SIZE
    message.header(stamp, frame)
    message.text(space)
    message.put("i", identity, kind, action)
    message.put("d", *place.tolist(), 0.0, 0.0, 0.0, 1.0, size, size, size)
    message.put("f", *(WHITE if kind == WORDS else RED))
    message.put("i", 0)  # lifetime: until it is taken away
    message.put("I", 0)
    message.put("B", 1)  # moves with its link
    message.put("I", 0, 0)  # points, colours
    message.text("")  # texture and its image
    message.header(0, "")
    message.text("")
    message.put("I", 0, 0)  # bytes of the image, coordinates on it
    message.text(words)
    message.text("")  # mesh and its file
    message.text("")
    message.put("I", 0)
    message.put("B", 0)

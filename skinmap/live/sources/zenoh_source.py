"""Follow a topic of ROS 2 over Zenoh: a Skinmap stream, or a foreign cloud or array."""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import MessageError, SkinMismatchError, UnknownNameError, UnreachableError
from skinmap.io.ros2.message_types import dds_name, read
from skinmap.io.ros2.messages import read_cloud, read_text
from skinmap.live.network.addresses import warn_if_open
from skinmap.live.network.network_messages import unpack_info
from skinmap.live.network.zenoh_ros2 import (
    ATTACHMENT,
    SKIN,
    ZenohAddress,
    domain,
    open_session,
    parse_zenoh,
)
from skinmap.live.sources.receiver import SILENT, follow
from skinmap.live.sources.source import (
    MAX_BLOCK,
    Block,
    Source,
    SourceEnded,
    StreamInfo,
    check_skin,
)
from skinmap.skin.robot import Robot
from skinmap.skin.skin import fingerprint

logger = logging.getLogger(__name__)

WAIT = 3.0  # for a first message [s]
QUEUED = 1000  # samples kept here between two reads: 20 s at 50 Hz
CLOUD = dds_name("sensor_msgs/PointCloud2")
ARRAYS = {
    dds_name(kind): kind
    for name in ("Float32", "Float64", "UInt8", "UInt16", "Int16", "Int32", "UInt32")
    for kind in [f"std_msgs/{name}MultiArray"]
}


class ZenohSource(Source):
    """Samples of one topic; to be read from one thread (`open_zenoh` puts a `Receiver` around it).

    Parameters
    ----------
    where : ZenohAddress
    robot : Robot, optional
        Whose skin it must be.
    parts : sequence of str, optional
        Of a foreign topic: whose values follow each other in it.
    wait : float
        For a first message [s].

    Raises
    ------
    UnreachableError
        Nothing is published there.
    MessageError
        Something that is neither a cloud nor an array.
    SkinMismatchError
        Another number of values than the robot's taxels.
    """

    def __init__(
        self,
        where: ZenohAddress,
        *,
        robot: Robot | None = None,
        parts: Sequence[str] | None = None,
        wait: float = WAIT,
    ) -> None:
        warn_if_open(where.address, "reading from")
        self._where = where
        self._came: queue.Queue[tuple[float, str, bytes, bytes]] = queue.Queue(QUEUED)
        self._numbers: dict[bytes, int] = {}
        self._closed = False
        self._stamped: bool | None = None  # whether messages have times of the sender
        self._beats = time.perf_counter()
        self._session = open_session(where.address, listen=False)
        try:
            ours = where.topic == SKIN
            super().__init__(self._ask(wait) if ours else self._meet(wait, robot, parts))
            if robot is not None:
                check_skin(self._info, robot)
            self._last_seen = time.perf_counter()
            if ours:
                self._subscribe(f"{SKIN}/{self._info.kind}", self._take)
        except BaseException:
            self._session.close()
            raise

    @property
    def alive(self) -> bool:
        """Whether a sample or heartbeat came within the last second."""
        return time.perf_counter() - max(self._beats, self._last_seen) < SILENT

    def read(self, timeout: float) -> Block | None:
        """Samples that came, at most 256; None where none does within `timeout` [s]."""
        if self._closed:
            raise SourceEnded
        found: list[tuple[float, NDArray[Any]]] = []
        deadline = time.perf_counter() + timeout
        arrived = self._last_seen
        while len(found) < MAX_BLOCK:
            left = 0.0 if found else max(0.0, deadline - time.perf_counter())
            try:
                arrived, kind, message, beside = (
                    self._came.get(timeout=left) if left else (self._came.get_nowait())
                )
            except queue.Empty:
                break
            sample = self._sample(arrived, kind, message, beside)
            if sample is not None:
                found.append(sample)
        if not found:
            return None
        self._last_seen = arrived
        times = np.array([stamp for stamp, _ in found])  # they may step back: `SampleChecks`
        return Block(times, np.array([values for _, values in found]), arrived)

    def close(self) -> None:
        """End the session; may be called twice."""
        if not self._closed:
            self._closed = True
            self._session.close()

    def _sample(
        self, arrived: float, kind: str, message: bytes, beside: bytes
    ) -> tuple[float, NDArray[Any]] | None:
        """Time and values; None, and counted, where the message is none of this stream."""
        try:
            stamp, values = values_of(kind, message, self._where.field)
            number, sent, sender = _beside(beside)
            if len(values) != self._info.channels or not np.isfinite(values).all():
                raise MessageError(f"{len(values)} values, expected {self._info.channels} numbers")
        except MessageError as error:
            self._counts.refused += 1
            logger.debug("%s: %s", self._where.topic, error)
            return None
        before = self._numbers.get(sender)
        if before is not None and number > before + 1:
            self._counts.lost += number - before - 1
        self._numbers[sender] = number
        moment = stamp or sent
        if self._stamped is None:  # one clock for all of them: the sender's, or ours
            self._stamped = moment > 0
        if self._stamped and not moment:
            self._counts.refused += 1
            return None
        return (moment / 1e9 if self._stamped else arrived), values

    def _subscribe(self, topic: str, callback: Any) -> Any:
        return self._session.declare_subscriber(f"{domain()}{topic}/*/*", callback)

    def _take(self, message: Any) -> None:
        """Messages handed over by Zenoh's thread; the newest is dropped where none is read."""
        kind = str(message.key_expr).split("/")[-2]
        beside = b"" if message.attachment is None else message.attachment.to_bytes()
        try:
            self._came.put_nowait((time.perf_counter(), kind, message.payload.to_bytes(), beside))
        except queue.Full:
            self._counts.dropped += 1

    def _ask(self, wait: float) -> StreamInfo:
        """What our own publisher says of its stream, again and again."""
        told: queue.Queue[bytes] = queue.Queue()

        def hear(message: Any) -> None:
            self._beats = time.perf_counter()
            if told.empty():
                told.put(message.payload.to_bytes())

        self._subscribe(f"{SKIN}/info", hear)
        try:
            said = unpack_info(read_text(told.get(timeout=wait)).encode())
            return replace(said, clock="sender")
        except queue.Empty:
            raise self._nothing(wait) from None

    def _meet(self, wait: float, robot: Robot | None, parts: Sequence[str] | None) -> StreamInfo:
        """What the first message of a foreign stream shows."""
        self._subscribe(self._where.topic, self._take)
        try:
            first = self._came.get(timeout=wait)
        except queue.Empty:
            raise self._nothing(wait) from None
        _, kind, message, _ = first
        _, values = values_of(kind, message, self._where.field)
        info = StreamInfo(self._where.topic, ("all",), (len(values),), 0.0, "raw", clock="sender")
        return info if robot is None else _of_robot(info, robot, parts)

    def _nothing(self, wait: float) -> UnreachableError:
        where = self._where
        return UnreachableError(
            f"nothing is published on {where.topic} at {where.address.host}:{where.address.port} "
            f"in ROS 2's domain {domain()} (waited {wait:g} s)"
        )


def values_of(kind: str, message: bytes, field: str = "") -> tuple[int, NDArray[Any]]:
    """Time [ns], 0 where the type has none, and values (n,) of a message.

    Parameters
    ----------
    kind : str
        Its type as keys of rmw_zenoh have it.
    message : bytes
        CDR.
    field : str
        Of a cloud; the last by default.

    Raises
    ------
    MessageError
        Another type, or a message that contradicts itself.
    """
    if kind == CLOUD:
        cloud = read_cloud(message)
        names = cloud.points.dtype.names or ()
        if not names or (field and field not in names):
            raise MessageError(str(UnknownNameError("field of the cloud", field, names)))
        return cloud.stamp, _plain(np.asarray(cloud.points[field or names[-1]]))
    if kind not in ARRAYS:
        raise MessageError(f"messages of type {kind}; clouds and arrays are read")
    return 0, _plain(np.asarray(read(ARRAYS[kind], message).data))


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    return values if values.dtype == np.uint8 else values.astype(np.float32)


def _beside(attachment: bytes) -> tuple[int, int, bytes]:
    """Number, time [ns] and sender; zeros where a message came without."""
    if len(attachment) != ATTACHMENT.size:
        return 0, 0, b""
    number, sent, _, sender = ATTACHMENT.unpack(attachment)
    return number, sent, sender


def _of_robot(info: StreamInfo, robot: Robot, parts: Sequence[str] | None) -> StreamInfo:
    """The stream as that of some parts of a robot, by its number of values."""
    wanted = tuple(parts or robot.parts)
    widths = {part: len(robot.skin(part)) for part in wanted}
    alone = [part for part, width in widths.items() if width == info.channels]
    if sum(widths.values()) == info.channels:
        chosen = wanted
    elif len(alone) == 1:
        chosen = (alone[0],)
    else:
        raise SkinMismatchError(
            f"{info.name} has {info.channels} values; {', '.join(wanted)} of {robot.name} have "
            f"{sum(widths.values())} taxels together: choose one by --part"
        )
    prints = {part: fingerprint(robot.skin(part)) for part in chosen}
    sizes = tuple(widths[part] for part in chosen)
    return replace(info, parts=chosen, widths=sizes, robot=robot.name, fingerprints=prints)


def open_zenoh(
    address: str,
    *,
    robot: Robot | None,
    parts: Sequence[str] | None,
    seed: int,
    speed: float,
    loop: bool,
) -> Source:
    """Follow "[PORT|HOST:PORT][/TOPIC][#FIELD]" in a thread; see `skinmap.live.open_source`."""
    return follow(ZenohSource(parse_zenoh(address), robot=robot, parts=parts), parts)

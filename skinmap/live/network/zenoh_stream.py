"""Zenoh as ROS 2's rmw_zenoh speaks it: sessions, keys, and what travels beside a message.

A topic is the key DOMAIN/TOPIC/TYPE/HASH, a message plain CDR with an attachment of 33 bytes, and
each publisher shows itself to ROS 2's graph by a liveliness token (the design page of rmw_zenoh).
"""

from __future__ import annotations

import os
import queue
import secrets
import struct
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import (
    InvalidArrayError,
    MessageError,
    OutputError,
    UnknownNameError,
    UnreachableError,
)
from skinmap.imports import import_optional
from skinmap.io.ros2.messages import dds_name, read, read_cloud, read_text, text_message, type_hash
from skinmap.io.ros2.robot_topics import LATCHED
from skinmap.live.network.network_messages import (
    HERE,
    Address,
    pack_info,
    parse_address,
    unpack_info,
    warn_if_open,
)
from skinmap.live.publishing.publish import HEARTBEAT, OurTimes, Topic, played, repeated
from skinmap.live.publishing.ros2_topics import TEXT, Ros2Publisher
from skinmap.live.sources.source import (
    MAX_BLOCK,
    SILENT,
    Block,
    Source,
    SourceEnded,
    StreamInfo,
    check_skin,
    follow,
    of_robot,
)
from skinmap.skin.robot import Robot

PORT = 7447  # of the router that ROS 2 expects on each machine
DOMAIN = "ROS_DOMAIN_ID"  # the environment variable by which ROS 2 divides a network
MAX_DOMAIN = 232  # of ROS 2
ATTACHMENT = struct.Struct("<qqB16s")  # number, time [ns], length and number of the sender
SENDER_BYTES = 16
# rmw_zenoh's short form: what differs from ROS 2's defaults.
QOS, LATCHED_QOS = "::,10:,:,:,,", ":1:,1:,:,:,,"
SKIN = "/skin"


class ZenohAddress(NamedTuple):
    """Where a stream is to be had.

    Attributes
    ----------
    address : Address
    topic : str
        Of ROS 2; "/skin" is the beginning of our own.
    field : str
        Of a cloud.
    """

    address: Address
    topic: str
    field: str


def parse_zenoh(text: str) -> ZenohAddress:
    """Read "[PORT|HOST:PORT][/TOPIC][#FIELD]".

    Raises
    ------
    InvalidArrayError
        Anything else.
    """
    where, slash, rest = text.partition("/")
    topic, _, field = rest.partition("#")
    address = parse_address(where) if where else Address(HERE, PORT)
    words = topic.split("/") if slash else [SKIN[1:]]
    if not all(word.replace("_", "a").isalnum() and word.isascii() for word in words):
        raise InvalidArrayError(
            f"{text!r}: no topic of ROS 2; expected [PORT|HOST:PORT][/TOPIC][#FIELD], such as "
            f"{PORT}/tactile/points#pressure"
        )
    return ZenohAddress(address, "/" + "/".join(words), field)


def domain() -> int:
    """ROS 2's domain, by its environment variable; 0 where it is not set."""
    said = os.environ.get(DOMAIN, "0") or "0"
    if not said.isascii() or not said.isdigit() or len(said) > 3 or int(said) > MAX_DOMAIN:
        raise InvalidArrayError(f"{DOMAIN} is {said!r}; expected 0 to {MAX_DOMAIN}")
    return int(said)


def key_of(topic: str, kind: str) -> str:
    """The key of a topic of one of the types that we write."""
    return f"{domain()}{topic}/{dds_name(kind)}/{type_hash(kind)}"


def token_of(session: str, number: int, topic: str, kind: str, *, latched: bool) -> str:
    """The key by which a publisher shows itself in ROS 2's graph."""
    return (
        f"@ros2_lv/{domain()}/{session}/0/{number}/MP/%/%/skinmap/{topic.replace('/', '%')}/"
        f"{dds_name(kind)}/{type_hash(kind)}/{LATCHED_QOS if latched else QOS}"
    )


def node_token(session: str) -> str:
    """The key by which a node called skinmap shows itself."""
    return f"@ros2_lv/{domain()}/{session}/0/0/NN/%/%/skinmap"


def import_zenoh() -> Any:
    """The package, or one line on how to get it."""
    return import_optional(
        "zenoh", "Zenoh needs the package eclipse-zenoh: pip install 'skinmap[zenoh]'"
    )


def open_session(address: Address, *, listen: bool) -> Any:
    """A session that listens at an address, or goes there.

    Nothing is searched for by multicast, as in rmw_zenoh. Where a router already listens at the
    address, a session that should listen goes there instead.

    Raises
    ------
    OutputError
        The address is not of this machine.
    UnreachableError
        Zenoh refuses the address.
    """
    zenoh = import_zenoh()
    host = f"[{address.host}]" if ":" in address.host else address.host
    place = f'["tcp/{"0.0.0.0" if host == "*" else host}:{address.port}"]'
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", place if listen else "[]")
    config.insert_json5("connect/endpoints", "[]" if listen else place)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if not listen:
            raise UnreachableError(f"cannot reach {place[2:-2]}: {_short(error)}") from error
        if "in use" not in str(error) or not address.is_here:
            raise OutputError(f"cannot publish at {place[2:-2]}: {_short(error)}") from error
    return open_session(address, listen=False)


def _short(error: Exception) -> str:
    """What Zenoh says, without where in its own source."""
    return str(error).split(" at /")[0][:200]


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
        self, where: ZenohAddress, *, robot: Robot | None, parts: Sequence[str] | None
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
            super().__init__(self._ask() if ours else self._meet(robot, parts))
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
                arrived, kind, message, beside = self._came.get(left > 0.0, left)
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
            self._refuse(self._where.topic, error)
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

    def _ask(self) -> StreamInfo:
        """What our own publisher says of its stream, again and again."""
        told: queue.Queue[bytes] = queue.Queue()

        def hear(message: Any) -> None:
            self._beats = time.perf_counter()
            if told.empty():
                told.put(message.payload.to_bytes())

        self._subscribe(f"{SKIN}/info", hear)
        return replace(unpack_info(read_text(self._first(told)).encode()), clock="sender")

    def _meet(self, robot: Robot | None, parts: Sequence[str] | None) -> StreamInfo:
        """What the first message of a foreign stream shows."""
        self._subscribe(self._where.topic, self._take)
        _, kind, message, _ = self._first(self._came)
        _, values = values_of(kind, message, self._where.field)
        info = StreamInfo(self._where.topic, ("all",), (len(values),), 0.0, "raw", clock="sender")
        return info if robot is None else of_robot(info, robot, parts, "values")

    def _first(self, came: queue.Queue[Any]) -> Any:
        where = self._where
        try:
            return came.get(timeout=WAIT)
        except queue.Empty:
            raise UnreachableError(
                f"nothing is published on {where.topic} at {where.address.host}:"
                f"{where.address.port} in ROS 2's domain {domain()} (waited {WAIT:g} s)"
            ) from None


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
        stamp, points = read_cloud(message)
        names = points.dtype.names or ()
        if not names or (field and field not in names):
            raise MessageError(str(UnknownNameError("field of the cloud", field, names)))
        return stamp, _plain(np.asarray(points[field or names[-1]]))
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


def open_zenoh(
    address: str, *, robot: Robot | None, parts: Sequence[str] | None, **_: object
) -> Source:
    """Follow "[PORT|HOST:PORT][/TOPIC][#FIELD]" in a thread; see `skinmap.live.open_source`."""
    return follow(ZenohSource(parse_zenoh(address), robot=robot, parts=parts), parts)


INFO = "/skin/info"
APART = 2.0  # of ROS time and a sample's shifted one [s]


class ZenohPublisher(Ros2Publisher):
    """Topics of ROS 2 under /skin, with transforms, clouds and markers where the robot is known.

    Parameters
    ----------
    address : str
        "", "PORT" or "HOST:PORT"; 127.0.0.1:7447 by default. Where ROS 2's router listens there,
        it is used.
    info : StreamInfo
    topics : sequence of str
    robot : Robot, optional
    speed : float
        Of the source: samples are stamped as far apart as they come.

    Raises
    ------
    MissingLibraryError
        The package `eclipse-zenoh` is not installed.
    OutputError
        The address cannot be listened at.
    """

    def __init__(
        self,
        address: str,
        info: StreamInfo,
        topics: Sequence[Topic],
        robot: Robot | None = None,
        speed: float = 1.0,
    ) -> None:
        super().__init__(played(info, speed), topics, robot)
        self._zenoh = import_zenoh()
        where = parse_zenoh(address).address
        warn_if_open(where, "every machine on the network can read the stream at")
        self._session = open_session(where, listen=True)
        self._number = str(self._session.zid())
        self._sender = secrets.token_bytes(SENDER_BYTES)
        self._sending = threading.RLock()
        self._times, self._stamp = OurTimes(time.time, speed, APART), 0  # ROS time [ns]
        self._publishers: dict[str, Any] = {}
        self._sequences: dict[str, int] = {}
        self._kept: dict[str, tuple[str, bytes]] = {}  # of latched topics, sent again and again
        self._tokens = [self._session.liveliness().declare_token(node_token(self._number))]
        self._info_text = text_message(
            pack_info(self.info, session=0, heartbeat=HEARTBEAT).decode()
        )
        self._stop_beating = repeated(HEARTBEAT, self._beat)

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        """Send samples at their own times, shifted to ROS time by the same each."""
        with self._sending:
            try:
                for now, row in zip(times.tolist(), values, strict=True):
                    own = np.array([now])
                    self._stamp = round(float(self._times.stamps(topic, own)[0]) * 1e9)
                    super()._send_samples(topic, own, row[None])
            finally:
                self._stamp = 0

    def _put(self, topic: str, kind: str, message: bytes) -> None:
        """Send a message; beside it travels the time of its sample, or when it was sent."""
        with self._sending:
            if topic not in self._publishers:
                self._open(topic, kind)
            if topic in LATCHED:
                self._kept[topic] = (kind, message)
            number = self._sequences[topic] = self._sequences.get(topic, 0) + 1
            stamp = self._stamp or time.time_ns()
            beside = ATTACHMENT.pack(number, stamp, SENDER_BYTES, self._sender)
            self._publishers[topic].put(message, attachment=beside)

    def _open(self, topic: str, kind: str) -> None:
        self._publishers[topic] = self._session.declare_publisher(
            key_of(topic, kind),
            congestion_control=self._zenoh.CongestionControl.BLOCK,
            express=True,  # at once: what waits for a fuller packet comes late
        )
        latched = topic in LATCHED
        token = token_of(self._number, len(self._publishers), topic, kind, latched=latched)
        self._tokens.append(self._session.liveliness().declare_token(token))

    def _beat(self) -> None:
        self._put(INFO, TEXT, self._info_text)
        with self._sending:
            kept = list(self._kept.items())
        for topic, (kind, message) in kept:
            self._put(topic, kind, message)

    def close(self) -> None:
        """Stop the heartbeat and end the session; may be called twice."""
        self._stop_beating()
        self._session.close()

"""Follow a ZeroMQ publisher: SUB, with bounded queues and messages, and its death noticed.

A sample is three frames: the topic, a header of 40 bytes, the values; docs/live.md has them byte by
byte. Everything is little-endian.
"""

from __future__ import annotations

import errno
import math
import secrets
import struct
import threading
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import zmq
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import MessageError, OutputError, UnreachableError
from skinmap.live.network.network_messages import (
    VERSION,
    Address,
    pack_info,
    parse_address,
    unpack_info,
    warn_if_open,
)
from skinmap.live.publishing.publish import HEARTBEAT, Publisher, Topic, repeated
from skinmap.live.sources.source import (
    MAX_BLOCK,
    Block,
    Source,
    StreamInfo,
    check_same_skin,
    check_skin,
    follow,
)
from skinmap.skin.robot import Robot

WAIT = 3.0  # for a publisher's description [s]
LARGEST_INFO = 1 << 16  # bytes of a description that are read
QUEUED_BYTES = 16_000_000  # kept by ZeroMQ itself at each end for who reads too slowly
FRAMES = 3  # of a sample: topic, header, values
MAGIC = b"SKIN"
HEADER = struct.Struct("<4sBBHIIQdd")
DTYPES: dict[int, np.dtype[Any]] = {1: np.dtype("u1"), 2: np.dtype("<f4")}


class Header(NamedTuple):
    """What stands before the values of a sample.

    Attributes
    ----------
    dtype : int
        1: uint8, 2: float32.
    channels : int
    session : int
        Drawn by the publisher when it starts: another number is another start.
    sequence : int
        0 for the first sample of a session and topic, then one more for each.
    time : float
        Of the sample, in the source's clock [s].
    sent : float
        When it was sent, by the publisher's monotonic clock [s].
    """

    dtype: int
    channels: int
    session: int
    sequence: int
    time: float
    sent: float

    def pack(self) -> bytes:
        """The 40 bytes."""
        return HEADER.pack(MAGIC, VERSION, self.dtype, 0, *self[1:])


def unpack_header(frame: bytes) -> Header:
    """Read a header.

    Raises
    ------
    MessageError
        Another length, beginning, version or type; a time that is not finite.
    """
    if len(frame) != HEADER.size:
        raise MessageError(f"a header of {len(frame)} bytes, expected {HEADER.size}")
    magic, version, dtype, _, *rest = HEADER.unpack(frame)
    if magic != MAGIC:
        raise MessageError(f"a header that begins with {magic!r}, expected {MAGIC!r}")
    if version != VERSION:
        raise MessageError(f"a message of version {version}, this Skinmap reads {VERSION}")
    if dtype not in DTYPES:
        raise MessageError(f"values of type {dtype}; expected 1 (uint8) or 2 (float32)")
    header = Header(dtype, *rest)
    if not math.isfinite(header.time) or not math.isfinite(header.sent):
        raise MessageError(f"a sample of time {header.time}, sent at {header.sent}")
    return header


def unpack_values(header: Header, frame: bytes, info: StreamInfo) -> NDArray[Any]:
    """The values (channels,) of a sample; a view of the frame.

    Raises
    ------
    MessageError
        Another number of values than the stream's skin has.
    """
    dtype = DTYPES[header.dtype]
    if header.channels != info.channels or len(frame) != info.channels * dtype.itemsize:
        raise MessageError(
            f"{header.channels} channels in {len(frame)} bytes, "
            f"stream {info.name!r} declares {info.channels}"
        )
    return np.frombuffer(frame, dtype)


class ZmqSource(Source):
    """Samples of one publisher.

    Parameters
    ----------
    address : Address
    wait : float
        For its description [s].
    robot : Robot, optional
        Whose skin it must be, by the description.

    Raises
    ------
    UnreachableError
        Nobody publishes there.
    MessageError
        Somebody does, in another language.

    Notes
    -----
    To be read from one thread: `open_zmq` puts a `Receiver` around it.
    """

    def __init__(self, address: Address, *, wait: float = WAIT, robot: Robot | None = None) -> None:

        warn_if_open(address, "reading from")
        self.address = address
        self._context = zmq.Context()
        try:
            self._description, info = self._ask(wait)
            if robot is not None:
                check_skin(info, robot)
            super().__init__(info)
            self._last_seen = time.perf_counter()
            largest = max(4 * info.channels, LARGEST_INFO)
            self._socket = self._connected(largest, "info", info.kind, queued=_queued(info))
        except BaseException:
            self._context.destroy(linger=0)
            raise
        self._session: int | None = None
        self._sequence = -1

    def read(self, timeout: float) -> Block | None:
        """Samples that came, at most 256; None where none does within `timeout` [s].

        Raises
        ------
        SkinMismatchError
            The publisher came back with another skin.
        """
        deadline = time.perf_counter() + timeout
        rows: list[NDArray[Any]] = []
        times: list[float] = []
        while not rows:
            left = deadline - time.perf_counter()
            if self._socket.poll(max(0, int(1e3 * left + 0.999))) == 0:
                return None
            for _ in range(MAX_BLOCK):  # bounded: what is refused must not keep us here
                try:
                    frames = self._receive(zmq.NOBLOCK)
                except zmq.Again:
                    break
                sample = self.take(frames)
                if sample is not None:
                    times.append(sample[0])
                    rows.append(sample[1])
            if not rows and time.perf_counter() >= deadline:
                return None
        return Block(np.array(times), np.array(rows), self.last_seen)

    def take(self, frames: Sequence[bytes]) -> tuple[float, NDArray[Any]] | None:
        """Time and values of a sample that came as frames; None for anything else.

        What does not follow the layout is counted as refused.
        """
        arrived = time.perf_counter()
        try:
            if frames[0] == b"info":
                self._hear(frames[1:])
                self._last_seen = arrived
                return None
            if len(frames) != FRAMES:
                raise MessageError(f"a sample of {len(frames)} frames, expected {FRAMES}")
            header = unpack_header(frames[1])
            values = unpack_values(header, frames[2], self._info)
        except MessageError as error:
            self._refuse(self.address.endpoint, error)
            return None
        self._last_seen = arrived
        self._follow(header)
        return header.time, values

    def close(self) -> None:
        """Give the sockets back; may be called twice."""
        self._context.destroy(linger=0)

    def _hear(self, frames: Sequence[bytes]) -> None:
        """Take a heartbeat, and refuse to go on with another skin."""
        description = frames[0] if len(frames) == 1 else b""
        if description == self._description:
            return
        info = unpack_info(description)
        check_same_skin(self._info, info, f"{self.address.endpoint} sends another skin now")
        self._description = description

    def _follow(self, header: Header) -> None:
        """Count gaps in the numbers of samples."""
        if header.session != self._session:
            if self._session is not None:
                self._counts.reconnects += 1
        elif header.sequence > self._sequence + 1:
            self._counts.lost += header.sequence - self._sequence - 1
        self._session, self._sequence = header.session, header.sequence

    def _receive(self, flags: int) -> list[bytes]:
        """Frames of one message; of one with too many only the first."""
        frames = [self._socket.recv(flags)]
        while self._socket.rcvmore:
            frame = self._socket.recv()
            if len(frames) <= FRAMES:
                frames.append(frame)
        return frames

    def _ask(self, wait: float) -> tuple[bytes, StreamInfo]:
        """The publisher's description."""
        socket = self._connected(LARGEST_INFO, "info")
        try:
            if socket.poll(int(1e3 * wait)) == 0:
                raise UnreachableError(
                    f"nothing is published at {self.address.endpoint} (waited {wait:g} s)"
                )
            frames = socket.recv_multipart()
            if len(frames) != 2 or frames[0] != b"info":
                raise MessageError(f"{self.address.endpoint} does not describe its stream")
            return frames[1], unpack_info(frames[1])
        finally:
            socket.close(linger=0)

    def _connected(self, largest: int, *topics: str, queued: int = 16) -> Any:
        """A socket that reads topics, and cuts the connection where a frame is larger [bytes]."""
        socket = self._context.socket(zmq.SUB)
        socket.maxmsgsize, socket.rcvhwm, socket.linger = largest, queued, 0
        # Half-open connections, as after a pulled cable, end within a second too.
        socket.heartbeat_ivl, socket.heartbeat_timeout = 250, 750
        socket.reconnect_ivl, socket.reconnect_ivl_max = 50, 400
        for topic in topics:
            socket.subscribe(topic.encode())
        try:
            socket.connect(self.address.endpoint)
        except zmq.ZMQError as error:
            raise UnreachableError(f"cannot reach {self.address.endpoint}: {error}") from error
        return socket


def _queued(info: StreamInfo) -> int:
    """Samples that ZeroMQ keeps at most."""
    return int(np.clip(QUEUED_BYTES // (4 * info.channels), 16, 10_000))


def open_zmq(
    address: str, *, robot: Robot | None, parts: Sequence[str] | None, **_: object
) -> Source:
    """Follow "HOST:PORT" or "PORT" in a thread; see `skinmap.live.open_source`."""
    return follow(ZmqSource(parse_address(address), robot=robot), parts)


LINGER = 200  # for what is on its way when the publisher closes [ms]


class ZmqPublisher(Publisher):
    """A PUB socket bound to an address; see docs/live.md for its messages.

    Parameters
    ----------
    address : str
        "PORT" or "HOST:PORT".
    info : StreamInfo
    topics : sequence of str
    robot : Robot, optional
        Not needed.

    Raises
    ------
    OutputError
        The port is in use, or the address is not of this machine.
    """

    def __init__(
        self, address: str, info: StreamInfo, topics: Sequence[Topic], robot: Robot | None = None
    ) -> None:

        super().__init__(info, topics)
        self._address = parse_address(address)
        warn_if_open(self._address, "every machine on the network can read the stream at")
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        # Bounded by bytes: so many float32 samples of this skin.
        self._socket.sndhwm = _queued(info)
        self._socket.linger = 0
        try:
            self._socket.bind(self._address.endpoint)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            used = error.errno == errno.EADDRINUSE
            why = "the port is in use; choose another" if used else error
            raise OutputError(f"cannot publish at {self._address.endpoint}: {why}") from error
        self._session = secrets.randbits(32)
        self._sequences: dict[str, int] = {}
        self._info = pack_info(info, session=self._session, heartbeat=HEARTBEAT)
        self._sending = threading.Lock()
        self._stop_beating = repeated(HEARTBEAT, self._beat)

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        code = 1 if values.dtype == np.uint8 else 2  # as a header names them
        rows = np.ascontiguousarray(values, DTYPES[code])
        with self._sending:
            first = self._sequences.get(topic, 0)
            for step, (moment, row) in enumerate(zip(times.tolist(), rows, strict=True)):
                header = Header(
                    code, len(row), self._session, first + step, moment, time.perf_counter()
                )
                self._socket.send_multipart([topic.encode(), header.pack(), row.tobytes()])
            self._sequences[topic] = first + len(rows)

    def _send_text(self, topic: Topic, time: float, text: str) -> None:
        with self._sending:
            self._socket.send_multipart([topic.encode(), text.encode()])

    def close(self) -> None:
        """Stop the heartbeat and give the port back; may be called twice."""
        self._stop_beating()
        with self._sending:
            self._context.destroy(linger=LINGER)

    def _beat(self) -> None:
        with self._sending:
            self._socket.send_multipart([b"info", self._info])

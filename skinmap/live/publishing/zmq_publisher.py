"""Publish over ZeroMQ: PUB, with a heartbeat that says what the stream is."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import OutputError, SkinError
from skinmap.live.network.addresses import parse_address, warn_if_open
from skinmap.live.network.network_messages import DTYPES, Header, dtype_code, pack_info
from skinmap.live.publishing.publish import Publisher, Topic
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot

HEARTBEAT = 0.2  # between two descriptions, so that a dead publisher shows within 1 s [s]
LINGER = 200  # for what is on its way when the publisher closes [ms]
QUEUED_BYTES = 16_000_000  # for a follower who reads too slowly, before it loses samples


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
        import zmq

        super().__init__(info, topics)
        self._address = parse_address(address)
        warn_if_open(self._address, "every machine on the network can read the stream at")
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        # Bounded by bytes: so many float32 samples of this skin.
        self._socket.sndhwm = int(np.clip(QUEUED_BYTES // (4 * info.channels), 16, 10_000))
        self._socket.linger = 0
        try:
            self._socket.bind(self._address.endpoint)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise _refused(self._address.endpoint, error) from error
        self._session = secrets.randbits(32)
        self._sequences: dict[str, int] = {}
        self._info = pack_info(info, session=self._session, heartbeat=HEARTBEAT)
        self._sending = threading.Lock()
        self._stop = threading.Event()
        self._beating = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        self._beating.start()

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        code = dtype_code(values)
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
        self._stop.set()
        self._beating.join()
        with self._sending:
            self._context.destroy(linger=LINGER)

    def _beat(self) -> None:
        while not self._stop.is_set():
            with self._sending:
                self._socket.send_multipart([b"info", self._info])
            self._stop.wait(HEARTBEAT)


def _refused(endpoint: str, error: Any) -> SkinError:
    import errno

    if error.errno == errno.EADDRINUSE:
        return OutputError(f"cannot publish at {endpoint}: the port is in use; choose another")
    return OutputError(f"cannot publish at {endpoint}: {error}")

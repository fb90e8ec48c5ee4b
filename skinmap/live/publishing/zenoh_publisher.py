"""Publish over Zenoh as a node of ROS 2 would, for rmw_zenoh and for `zenoh:` sources."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.io.ros2.messages import text_message
from skinmap.io.ros2.robot_topics import LATCHED
from skinmap.live.moment import Moment
from skinmap.live.network.addresses import warn_if_open
from skinmap.live.network.network_messages import pack_info
from skinmap.live.network.zenoh_ros2 import (
    ATTACHMENT,
    SENDER_BYTES,
    import_zenoh,
    key_of,
    node_token,
    open_session,
    parse_zenoh,
    token_of,
)
from skinmap.live.publishing.publish import Publisher, Topic
from skinmap.live.publishing.ros2_topics import TEXT, Ros2Topics
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot

HEARTBEAT = 0.2  # between two descriptions, so that a dead publisher shows within 1 s [s]
INFO = "/skin/info"


class ZenohPublisher(Publisher):
    """Topics of ROS 2 under /skin, with transforms, clouds and markers where the robot is known.

    Parameters
    ----------
    address : str
        "", "PORT" or "HOST:PORT"; 127.0.0.1:7447 by default. Where ROS 2's router listens there,
        it is used.
    info : StreamInfo
    topics : sequence of str
    robot : Robot, optional

    Raises
    ------
    MissingLibraryError
        The package `eclipse-zenoh` is not installed.
    OutputError
        The address cannot be listened at.
    """

    def __init__(
        self, address: str, info: StreamInfo, topics: Sequence[Topic], robot: Robot | None = None
    ) -> None:
        super().__init__(info, topics)
        self._zenoh = import_zenoh()
        where = parse_zenoh(address).address
        warn_if_open(where, "every machine on the network can read the stream at")
        self._session = open_session(where, listen=True)
        self._number = str(self._session.zid())
        self._sender = secrets.token_bytes(SENDER_BYTES)
        self._sending = threading.RLock()
        self._publishers: dict[str, Any] = {}
        self._sequences: dict[str, int] = {}
        self._kept: dict[str, tuple[str, bytes]] = {}  # of latched topics, sent again and again
        self._tokens = [self._session.liveliness().declare_token(node_token(self._number))]
        self._topics = Ros2Topics(info, robot, self._put)
        self._info_text = text_message(pack_info(info, session=0, heartbeat=HEARTBEAT).decode())
        self._stop = threading.Event()
        self._beating = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        self._beating.start()

    def send(self, moment: Moment) -> None:
        """Send a moment, with the robot's pose and markers of touches."""
        if not moment.stale:
            self._topics.moment(moment)
        super().send(moment)

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        self._topics.samples(topic, times, values)

    def _send_text(self, topic: Topic, time: float, text: str) -> None:
        self._topics.text(topic, time, text)

    def _put(self, topic: str, kind: str, stamp: int, message: bytes) -> None:
        """Send a message; `stamp` stands in it, beside it travels when it was sent."""
        with self._sending:
            if topic not in self._publishers:
                self._open(topic, kind)
            if topic in LATCHED:
                self._kept[topic] = (kind, message)
            number = self._sequences[topic] = self._sequences.get(topic, 0) + 1
            beside = ATTACHMENT.pack(number, time.time_ns(), SENDER_BYTES, self._sender)
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
        while not self._stop.is_set():
            self._put(INFO, TEXT, 0, self._info_text)
            with self._sending:
                kept = list(self._kept.items())
            for topic, (kind, message) in kept:
                self._put(topic, kind, 0, message)
            self._stop.wait(HEARTBEAT)

    def close(self) -> None:
        """Stop the heartbeat and end the session; may be called twice."""
        self._stop.set()
        self._beating.join()
        self._session.close()

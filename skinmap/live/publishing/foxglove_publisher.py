"""Publish to Foxglove: a server that its app opens, with the skin as triangles and its touches."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import MissingLibraryError, OutputError
from skinmap.io.ros2.definitions import definition, full_name
from skinmap.io.ros2.robot_topics import LATCHED, TF, TYPES
from skinmap.live.moment import Moment
from skinmap.live.network.addresses import HERE, Address, parse_address, warn_if_open
from skinmap.live.network.messages import KINDS
from skinmap.live.publishing.foxglove_scene import SkinScene
from skinmap.live.publishing.publisher import Publisher, Topic
from skinmap.live.publishing.ros2_topics import Ros2Topics, stamps
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot

PORT = 8765  # where Foxglove looks first
SCENE_HZ = 15.0  # a screen shows no more of triangles, and they are the most to send
BACKLOG = 4096  # messages kept for a client who reads too slowly
REPEAT, REPEATS = 1.0, 3  # after someone subscribed, what is said once comes again [s, times]
NS = 1_000_000_000
KEPT = (*LATCHED, TF)
SAMPLES = "std_msgs/Float32MultiArray"


class FoxglovePublisher(Publisher):
    """A WebSocket server; see docs/foxglove.md for its topics and parameters.

    Parameters
    ----------
    address : str
        "", "PORT" or "HOST:PORT"; 127.0.0.1:8765 by default.
    info : StreamInfo
    topics : sequence of str
    robot : Robot, optional
        Without it there are samples, but no scene.

    Raises
    ------
    MissingLibraryError
        The package `foxglove-sdk` is not installed.
    OutputError
        The port is in use, or the address is not of this machine.
    """

    def __init__(
        self, address: str, info: StreamInfo, topics: Sequence[Topic], robot: Robot | None = None
    ) -> None:
        try:
            import foxglove
        except ImportError as error:
            raise MissingLibraryError(
                "Foxglove needs the package foxglove-sdk: pip install 'skinmap[foxglove]'"
            ) from error
        super().__init__(info, topics)
        self._foxglove = foxglove
        where = parse_address(address) if address else Address(HERE, PORT)
        warn_if_open(where, "every machine on the network can read the stream at")
        self._context = foxglove.Context()
        self._channels: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._settings: dict[str, float] = {"colour_max": 255.0, "scene_hz": SCENE_HZ}
        self._scene = None if robot is None else SkinScene(robot, info, self._context)
        self._closed = False
        self._kept: dict[str, bytes] = {}  # what is said once, for who comes late
        self._repeated, self._repeats = 0.0, 0
        self._topics = Ros2Topics(info, robot, self._put)
        # Said before the first sample, so that who subscribes misses none.
        samples = {f"/skin/{topic}": SAMPLES for topic in self.topics if topic in KINDS}
        for topic, kind in {**samples, **({} if robot is None else TYPES)}.items():
            self._channels[topic] = self._open(topic, kind)
        try:
            self._server = foxglove.start_server(
                name=f"Skinmap: {info.robot or info.name}",
                host="0.0.0.0" if where.host == "*" else where.host,
                port=where.port,
                capabilities=[foxglove.Capability.Parameters],
                server_listener=_listener(self),
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except (RuntimeError, OSError) as error:
            raise OutputError(f"cannot publish at {where.host}:{where.port}: {error}") from error

    @property
    def port(self) -> int:
        """Where the server listens."""
        return int(self._server.port)

    def parameters(self) -> dict[str, Any]:
        """What clients are told, and may set where it is a number."""
        told = {"robot": self.info.robot, "parts": ", ".join(self.info.parts)}
        return {**told, "channels": float(self.info.channels), **self._settings}

    def set_parameter(self, name: str, value: Any) -> None:
        """Take a client's number; anything else is left alone."""
        good = isinstance(value, int | float) and np.isfinite(value) and 0 < value <= 1e6
        if name in self._settings and good:
            self._settings[name] = float(value)
            self.show_all()

    def show_all(self) -> None:
        """Send the whole scene with the next sample: a client has connected."""
        if self._scene is not None:
            self._scene.forget()
        self._repeated, self._repeats = 0.0, REPEATS

    def send(self, moment: Moment) -> None:
        """Send a moment, with the robot's pose, and touches with their names."""
        if not moment.stale:
            self._topics.moment(moment)
            if self._scene is not None:
                self._scene.touches(stamps(np.array([moment.time]))[0], moment.touches)
        super().send(moment)

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        self._topics.samples(topic, times, values)
        self._repeat()
        stamp = stamps(times)[-1]
        if self._scene is not None and topic == self.info.kind:
            period = int(0.999 * NS / self._settings["scene_hz"])
            self._scene.skin(stamp, values[-1], self._settings["colour_max"], period)

    def _send_text(self, topic: Topic, time: float, text: str) -> None:
        self._topics.text(topic, time, text)

    def _repeat(self) -> None:
        """Say again what was said once: the app keeps nothing of before it came."""
        now = time.monotonic()
        if self._repeats > 0 and now - self._repeated >= REPEAT:
            self._repeated, self._repeats = now, self._repeats - 1
            for topic, message in list(self._kept.items()):
                self._channels[topic].log(message)

    def _put(self, topic: str, kind: str, stamp: int, message: bytes) -> None:
        with self._lock:
            if topic not in self._channels:
                self._channels[topic] = self._open(topic, kind)
            if topic in KEPT:
                self._kept[topic] = message
        self._channels[topic].log(message)

    def _open(self, topic: str, kind: str) -> Any:
        schema = self._foxglove.Schema(
            name=full_name(kind), encoding="ros2msg", data=definition(kind)
        )
        return self._foxglove.Channel(
            topic, schema=schema, message_encoding="cdr", context=self._context
        )

    def close(self) -> None:
        """Stop the server; may be called twice."""
        if not self._closed:
            self._closed = True
            self._server.stop()


def _listener(publisher: FoxglovePublisher) -> Any:
    """What the server calls, in threads of its own."""
    from foxglove.websocket import Parameter, ServerListener

    class Listener(ServerListener):
        def on_subscribe(self, client: Any, channel: Any) -> None:
            publisher.show_all()

        def on_get_parameters(
            self, client: Any, param_names: list[str], request_id: str | None = None
        ) -> list[Any]:
            told = publisher.parameters()
            chosen = param_names or list(told)
            return [Parameter(name, value=told[name]) for name in chosen if name in told]

        def on_set_parameters(
            self, client: Any, parameters: list[Any], request_id: str | None = None
        ) -> list[Any]:
            for one in parameters:
                publisher.set_parameter(one.name, one.get_value())
            return self.on_get_parameters(client, [one.name for one in parameters])

    return Listener()

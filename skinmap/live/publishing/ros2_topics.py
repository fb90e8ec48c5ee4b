"""A live stream as ROS 2's topics: samples, clouds, transforms, markers, and JSON as texts."""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import OutputError
from skinmap.imports import import_optional
from skinmap.io.recordings.recorded_stream import sample_columns
from skinmap.io.ros2.messages import (
    TouchMarker,
    array_type,
    definition,
    encode,
    full_name,
    text_message,
)
from skinmap.io.ros2.robot_topics import LATCHED, TF, TYPES, RobotTopics, RobotView
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.network.network_messages import HERE, KINDS, Address, parse_address, warn_if_open
from skinmap.live.publishing.publish import Publisher, Topic
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot
from skinmap.surface.surface_mesh import build_surface

POINTS_HZ = 25.0  # clouds a second: as often as a screen needs
TEXT = "std_msgs/String"


class Ros2Publisher(Publisher):
    """Sends all it gets as messages of ROS 2; clouds, transforms and markers need the robot."""

    def __init__(self, info: StreamInfo, topics: Sequence[Topic], robot: Robot | None) -> None:
        super().__init__(info, topics, robot)
        self._view: RobotView | None = None
        if robot is not None:
            known = RobotTopics(robot, info.parts, info.widths, info.kind)
            self._view = RobotView(known, self._shown, POINTS_HZ)

    @abstractmethod
    def _put(self, topic: str, kind: str, message: bytes) -> None:
        """Send a message of a type on a topic."""

    def send(self, moment: Moment) -> None:
        """Send a moment, with the robot's pose, and touches with their names."""
        if not moment.stale and self._view is not None and self.robot is not None:
            (stamp,) = stamps(np.array([moment.time]))
            if moment.angles:
                self._view.angles(stamp, moment.angles)
            self._view.touches(stamp, touch_markers(self.robot, moment))
        super().send(moment)

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        for stamp, row in zip(stamps(times), values, strict=True):
            self._put(f"/skin/{topic}", array_type("Float32"), encode(row, "Float32"))
            if self._view is not None and topic == self.info.kind:
                self._view.sample(stamp, row)

    def _send_text(self, topic: Topic, time: float, text: str) -> None:
        self._put(f"/skin/{topic}", TEXT, text_message(text))

    def _shown(self, topic: str, stamp: int, message: bytes, number: int) -> None:
        self._put(topic, TYPES[topic], message)


def touch_markers(robot: Robot, moment: Moment) -> list[TouchMarker]:
    """The touches of a moment as ROS 2 gets them."""
    found = []
    for one in moment.touches:
        known = None if one.load is None or one.load.refused else one.load.wrench()
        wrench, covariance = (None, None) if known is None else known
        link = robot.part(one.part).link
        found.append(TouchMarker(one.identity, link, one.centre, one.label, wrench, covariance))
    return found


def stamps(times: FloatArray) -> list[int]:
    """Times [s] as whole nanoseconds; none before zero."""
    return [round(max(time, 0.0) * 1e9) for time in np.asarray(times).tolist()]


PORT = 8765  # where Foxglove looks first
BACKLOG = 4096  # messages kept for a client who reads too slowly
REPEAT, REPEATS = 1.0, 3  # after someone subscribed, what is said once comes again [s, times]
# A part is shown 15 times a second at most [ns]: a screen shows no more of triangles, and they are
# the most to send.
PERIOD = int(0.999 * 1_000_000_000 / 15.0)
KEPT = (*LATCHED, TF)
SAMPLES = "std_msgs/Float32MultiArray"
LIFT = 0.002  # taxels lie 0.5 to 1 mm inside the body's mesh [m]
LEVELS, REDDEST = 256, 255.0
AT_ONCE = 800  # taxels coloured with one sample: more would delay the next one (5 us each)
# From untouched to hardest pressed: grey, yellow, red.
RAMP = np.array([[0.55, 0.57, 0.60], [0.98, 0.80, 0.25], [0.86, 0.15, 0.12]])


class FoxglovePublisher(Ros2Publisher):
    """A WebSocket server; see docs/tools.md for its topics.

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
        foxglove = import_optional(
            "foxglove", "Foxglove needs the package foxglove-sdk: pip install 'skinmap[foxglove]'"
        )
        super().__init__(info, topics, robot)
        self._foxglove = foxglove
        where = parse_address(address) if address else Address(HERE, PORT)
        warn_if_open(where, "every machine on the network can read the stream at")
        self._context = foxglove.Context()
        self._lock = threading.Lock()
        self._scene = None if robot is None else SkinScene(robot, info, self._context)
        self._closed = False
        self._kept: dict[str, bytes] = {}  # what is said once, for who comes late
        self._repeated, self._repeats = 0.0, 0
        # Said before the first sample, so that who subscribes misses none.
        samples = {f"/skin/{topic}": SAMPLES for topic in self.topics if topic in KINDS}
        said = {**samples, **({} if robot is None else TYPES)}
        self._channels = {topic: self._open(topic, kind) for topic, kind in said.items()}
        try:
            self._server = foxglove.start_server(
                name=f"Skinmap: {info.robot or info.name}",
                host="0.0.0.0" if where.host == "*" else where.host,
                port=where.port,
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

    def show_all(self) -> None:
        """Send the whole scene with the next sample: a client has connected."""
        if self._scene is not None:
            self._scene.forget()
        self._repeated, self._repeats = 0.0, REPEATS

    def _send_samples(self, topic: Topic, times: FloatArray, values: NDArray[Any]) -> None:
        super()._send_samples(topic, times, values)
        self._repeat()
        if self._scene is not None and topic == self.info.kind:
            self._scene.skin(stamps(times)[-1], values[-1])

    def _repeat(self) -> None:
        """Say again what was said once: the app keeps nothing of before it came."""
        now = time.monotonic()
        if self._repeats > 0 and now - self._repeated >= REPEAT:
            self._repeated, self._repeats = now, self._repeats - 1
            for topic, message in list(self._kept.items()):
                self._channels[topic].log(message)

    def _put(self, topic: str, kind: str, message: bytes) -> None:
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
    from foxglove.websocket import ServerListener

    class Listener(ServerListener):
        def on_subscribe(self, client: Any, channel: Any) -> None:
            publisher.show_all()

    return Listener()


class SkinScene:
    """Scene updates of what has changed."""

    def __init__(self, robot: Robot, info: StreamInfo, context: Any) -> None:
        from foxglove import messages
        from foxglove.channels import SceneUpdateChannel

        self._messages, self._robot = messages, robot
        self._skin = SceneUpdateChannel("/skin/scene", context=context)
        skins = [robot.skin(part) for part in info.parts]
        columns, ends = sample_columns(skins, info.widths), np.cumsum([len(one) for one in skins])
        self._columns = dict(zip(info.parts, np.split(columns, ends[:-1]), strict=True))
        self._points = {part: self._lifted(part) for part in info.parts}
        self._faces = {
            part: build_surface(robot.skin(part)).faces.ravel().tolist() for part in info.parts
        }
        steps = np.linspace(0.0, 2.0, LEVELS)
        shades = np.column_stack([np.interp(steps, range(3), RAMP[:, k]) for k in range(3)])
        self._shades = [messages.Color(r=r, g=g, b=b, a=1.0) for r, g, b in shades.tolist()]
        self._shown: dict[str, NDArray[np.int64]] = {}
        self._shown_at: dict[str, int] = {}
        self._lock = threading.Lock()

    def forget(self) -> None:
        """Take all for changed."""
        with self._lock:
            self._shown = {}

    def skin(self, stamp: int, values: NDArray[Any]) -> None:
        """Show a sample (channels,): parts with other colours, the longest shown first.

        Parameters
        ----------
        stamp : int
            [ns].
        values : (channels,) array
            Counts; 255 is the reddest colour.
        """
        changed, room = [], AT_ONCE
        for part in sorted(self._columns, key=lambda one: self._shown_at.get(one, 0)):
            columns, last = self._columns[part], self._shown_at.get(part)
            if room <= 0:
                break
            if last is not None and part in self._shown and 0 <= stamp - last < PERIOD:
                continue
            share = np.asarray(values[columns], np.float64) * ((LEVELS - 1) / REDDEST)
            levels = np.rint(share).clip(0, LEVELS - 1).astype(np.int64)
            with self._lock:
                if part in self._shown and np.array_equal(self._shown[part], levels):
                    continue
                self._shown[part] = levels
            self._shown_at[part] = stamp
            room -= len(columns)
            changed.append(self._sheet(stamp, part, levels))
        if changed:
            self._skin.log(self._messages.SceneUpdate(entities=changed))

    def _sheet(self, stamp: int, part: str, levels: NDArray[np.int64]) -> Any:
        messages = self._messages
        triangles = messages.TriangleListPrimitive(
            points=self._points[part],
            colors=[self._shades[level] for level in levels.tolist()],
            indices=self._faces[part],
        )
        return messages.SceneEntity(
            timestamp=messages.Timestamp(*divmod(stamp, 1_000_000_000)),
            frame_id=self._robot.part(part).link,
            id=f"skin {part}",
            frame_locked=True,
            triangles=[triangles],
        )

    def _lifted(self, part: str) -> list[Any]:
        """Taxels a little outside of the body, as Foxglove's points."""
        skin = self._robot.skin(part)
        places = (skin.positions + LIFT * skin.normals).tolist()
        return [self._messages.Point3(x=x, y=y, z=z) for x, y, z in places]

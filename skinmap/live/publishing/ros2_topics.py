"""A live stream as ROS 2's topics: samples, clouds, transforms, markers, and JSON as texts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.io.ros2.message_types import array_type, encode
from skinmap.io.ros2.messages import TouchMarker, text_message
from skinmap.io.ros2.robot_topics import TYPES, RobotTopics, RobotView
from skinmap.live.moment import Moment
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot

POINTS_HZ = 25.0  # clouds a second: as often as a screen needs
TEXT = "std_msgs/String"

# Takes topic, type, time [ns] and message.
Send = Callable[[str, str, int, bytes], None]


class Ros2Topics:
    """Turns what a publisher gets into messages of ROS 2.

    Parameters
    ----------
    info : StreamInfo
    robot : Robot or None
        What clouds, transforms and markers need.
    send : callable
    points_hz : float
        Clouds a second at most.
    """

    def __init__(
        self, info: StreamInfo, robot: Robot | None, send: Send, points_hz: float = POINTS_HZ
    ) -> None:
        self._info, self._robot, self._send = info, robot, send
        self._view: RobotView | None = None
        if robot is not None:
            topics = RobotTopics(robot, info.parts, info.widths, info.kind)
            self._view = RobotView(topics, self._shown, points_hz)

    def samples(self, topic: str, times: FloatArray, values: NDArray[Any]) -> None:
        """Samples (k, channels) at times (k,) [s]."""
        for stamp, row in zip(stamps(times), values, strict=True):
            self._send(f"/skin/{topic}", array_type("Float32"), stamp, encode(row, "Float32"))
            if self._view is not None and topic == self._info.kind:
                self._view.sample(stamp, row)

    def text(self, topic: str, time: float, text: str) -> None:
        """JSON as a text."""
        (stamp,) = stamps(np.array([time]))
        self._send(f"/skin/{topic}", TEXT, stamp, text_message(text))

    def moment(self, moment: Moment) -> None:
        """Joint angles and touches."""
        if self._view is None or self._robot is None:
            return
        (stamp,) = stamps(np.array([moment.time]))
        if moment.angles:
            self._view.angles(stamp, moment.angles)
        self._view.touches(stamp, touch_markers(self._robot, moment))

    def _shown(self, topic: str, stamp: int, message: bytes, _: int) -> None:
        self._send(topic, TYPES[topic], stamp, message)


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

"""A live stream as ROS 2's topics: samples, clouds, transforms, markers, and JSON as texts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.io.ros2.message_types import array_type, encode
from skinmap.io.ros2.messages import TouchMarker, text_message
from skinmap.io.ros2.robot_topics import TYPES, RobotTopics, RobotView
from skinmap.live.moment import Moment
from skinmap.live.publishing.publish import Publisher, Topic
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.robot import Robot

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

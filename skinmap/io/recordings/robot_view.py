"""When a recording shows its robot: transforms once or as it moves, clouds now and then."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from skinmap.io.ros2.messages import TouchMarker, markers_message, text_message
from skinmap.io.ros2.robot_topics import (
    DESCRIPTION,
    MARKERS,
    POINTS,
    TF,
    TF_STATIC,
    RobotTopics,
)

HAIR = 0.999  # of a period: times are multiples of a step only nearly


class RobotView:
    """Writes what ROS 2's tools draw, beside the samples of a recording.

    The joints of a source that tells no angles stand still: with the second sample their
    transforms become static ones, as no tool waits for what never comes.

    Parameters
    ----------
    topics : RobotTopics
    write : callable
        Takes topic, time [ns], message and number.
    points_hz : float
        Clouds a second at most.
    """

    def __init__(
        self, topics: RobotTopics, write: Callable[[str, int, bytes, int], None], points_hz: float
    ) -> None:
        self._topics, self._write = topics, write
        self._period = HAIR * 1e9 / points_hz if points_hz > 0 else float("inf")
        self._next = float("-inf") if points_hz > 0 else float("inf")
        self._first: int | None = None
        self._moves: bool | None = None  # not known before the second sample
        self._marked: set[int] = set()

    def sample(self, stamp: int, values: NDArray[Any]) -> None:
        """Show a sample (channels,)."""
        if not self._begin(stamp) and self._moves is None:
            self._decide(moves=False)
        if stamp >= self._next or stamp < self._next - 2 * self._period:  # or time fell back
            self._next = stamp + self._period
            if self._moves:
                self._write(TF, stamp, self._topics.moving(stamp), 0)
            self._write(POINTS, stamp, self._topics.cloud(stamp, values), 0)

    def angles(self, stamp: int, angles: Mapping[str, float]) -> None:
        """Show joint angles [rad] that have changed."""
        self._begin(stamp)
        if self._moves is None:
            self._decide(moves=True)
        self._moves = True
        self._topics.set_angles(angles)
        self._write(TF, stamp, self._topics.moving(stamp), 0)

    def touches(self, stamp: int, touches: Sequence[TouchMarker]) -> None:
        """Show touches with their names."""
        now = {one.identity for one in touches}
        gone = sorted(self._marked - now)
        if now or gone:
            self._write(MARKERS, stamp, markers_message(stamp, touches, gone), 0)
        self._marked = now

    def end(self) -> None:
        """Show what a single sample left open."""
        if self._first is not None and self._moves is None:
            self._decide(moves=False)

    def _begin(self, stamp: int) -> bool:
        """Describe the robot, once; whether that was now."""
        if self._first is not None:
            return False
        self._first = stamp
        self._write(DESCRIPTION, stamp, text_message(self._topics.description()), 0)
        return True

    def _decide(self, *, moves: bool) -> None:
        """Write the static transforms: one message, as who comes late is given the last alone."""
        self._moves, stamp = moves, self._first or 0
        self._write(TF_STATIC, stamp, self._topics.static(stamp, all_joints=not moves), 0)

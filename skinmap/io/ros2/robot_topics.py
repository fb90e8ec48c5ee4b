"""A robot and its skin as ROS 2 sees them: its description, transforms, and clouds of taxels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_points
from skinmap.io.recordings.recorded_stream import sample_columns
from skinmap.io.ros2.messages import (
    Cloud,
    TouchMarker,
    covariance_message,
    markers_message,
    text_message,
    transforms_message,
    wrench_message,
)
from skinmap.skin.robot import Robot, ancestors, joint_transform

DESCRIPTION, TF, TF_STATIC = "/robot_description", "/tf", "/tf_static"
POINTS, MARKERS, JOINT_STATES = "/skin/points", "/skin/markers", "/joint_states"
WRENCHES, COVARIANCES = "/skin/wrenches", "/skin/wrench_covariances"  # one each a touch, in pairs
TYPES = {
    DESCRIPTION: "std_msgs/String",
    TF: "tf2_msgs/TFMessage",
    TF_STATIC: "tf2_msgs/TFMessage",
    POINTS: "sensor_msgs/PointCloud2",
    MARKERS: "visualization_msgs/MarkerArray",
    JOINT_STATES: "sensor_msgs/JointState",
    WRENCHES: "geometry_msgs/WrenchStamped",
    COVARIANCES: "std_msgs/Float64MultiArray",
}
LATCHED = (DESCRIPTION, TF_STATIC)  # kept for who comes late (durability transient_local)


class RobotTopics:
    """What ROS 2's tools want to know beside the values of a skin.

    Joints that nobody tells the angle of stand in the robot's natural pose.

    Parameters
    ----------
    robot : Robot
    parts : sequence of str
        Whose values follow each other in a sample.
    widths : sequence of int
        Columns of each: its taxels, or its live vector.
    field : str
        What the values are called in the cloud.

    Attributes
    ----------
    root : str
        Link whose frame the cloud is in.
    """

    def __init__(
        self, robot: Robot, parts: Sequence[str], widths: Sequence[int], field: str
    ) -> None:
        self.robot, self._tree = robot, robot.body.tree
        self.root = next(link for link in robot.body.links if link not in self._tree)
        self._fixed = [link for link, joint in self._tree.items() if joint.kind == "fixed"]
        self._moving = [link for link, joint in self._tree.items() if joint.kind != "fixed"]
        self._skins = [robot.skin(part) for part in parts]
        self._columns = sample_columns(self._skins, widths)
        self._angles: dict[str, float] = dict(robot.pose)
        self._cloud = Cloud(self.root, self._positions(), field)

    def description(self) -> str:
        """URDF of the robot; of a single mesh, its one link."""
        path = getattr(self.robot.body, "path", None)
        if path is not None and path.suffix.lower() == ".urdf":
            return str(path.read_text(encoding="utf-8", errors="replace"))
        return f'<robot name="{self.robot.name}"><link name="{self.root}"/></robot>'

    def static(self, stamp: int, *, all_joints: bool) -> bytes:
        """Transforms of joints that do not move, or of all, as they stand."""
        return self._transforms(stamp, [*self._fixed, *(self._moving if all_joints else ())])

    def moving(self, stamp: int) -> bytes:
        """Transforms of joints that move, at the angles told last."""
        return self._transforms(stamp, self._moving)

    def set_angles(self, angles: Mapping[str, float]) -> None:
        """Take the angles [rad or m] of joints; those not named stay as they are."""
        known = {name: angle for name, angle in angles.items() if np.isfinite(angle)}
        if any(self._angles.get(name) != angle for name, angle in known.items()):
            self._angles |= known
            self._cloud.move(self._positions())

    def cloud(self, stamp: int, values: NDArray[Any]) -> bytes:
        """The taxels with the values (channels,) of one sample, in the frame of the root."""
        return self._cloud.message(stamp, values[self._columns])

    def _transforms(self, stamp: int, links: Sequence[str]) -> bytes:
        pairs = [(self._tree[link].parent, link) for link in links]
        T_parent_child = np.array([self._local(link) for link in links]).reshape(-1, 4, 4)
        return transforms_message(stamp, pairs, T_parent_child)

    def _positions(self) -> FloatArray:
        """(n, 3) taxels of all parts in the frame of the root [m]."""
        T_root_link: dict[str, FloatArray] = {}
        for skin in self._skins:
            if skin.link not in T_root_link:
                pose = np.eye(4)
                for link in reversed(ancestors(self._tree, skin.link)[:-1]):
                    pose = pose @ self._local(link)
                T_root_link[skin.link] = pose
        return np.concatenate(
            [transform_points(T_root_link[skin.link], skin.positions) for skin in self._skins]
        )

    def _local(self, link: str) -> FloatArray:
        joint = self._tree[link]
        angle = self._angles.get(joint.driver, 0.0)
        return joint_transform(joint, joint.factor * angle + joint.offset)


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
        """Show touches with their names, and their wrenches where these are known."""
        now = {one.identity for one in touches}
        gone = sorted(self._marked - now)
        if now or gone:
            self._write(MARKERS, stamp, markers_message(stamp, touches, gone), 0)
        self._marked = now
        for one in touches:
            if one.wrench is not None and one.covariance is not None:
                self._write(WRENCHES, stamp, wrench_message(stamp, one.link, one.wrench), 0)
                self._write(COVARIANCES, stamp, covariance_message(one.covariance), 0)

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

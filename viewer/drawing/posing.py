"""Joint angles that a body can take."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.skin.robot import Robot

SLACK = np.radians(1.0)  # encoders may read that far beyond a limit without being wrong


def posed(robot: Robot, angles: Mapping[str, float]) -> dict[str, FloatArray]:
    """T_root_link (4, 4) of every link; joints not named stand as in the robot's natural pose.

    Raises
    ------
    UnknownNameError
        A joint that the body lacks.
    InvalidArrayError
        An angle that is not finite or beyond the joint's limits (names joint and limits).
    """
    limits = robot.body.joints
    for joint, angle in angles.items():
        if joint not in limits:
            raise UnknownNameError("joint", joint, limits)
        low, high = limits[joint]
        if not low - SLACK <= angle <= high + SLACK:  # false for NaN
            raise InvalidArrayError(
                f"joint {joint!r} cannot be at {angle:.3f}: its limits are {low:.3f} to {high:.3f} "
                "(rad, or m where it slides)"
            )
    return robot.body.poses({**robot.pose, **angles})

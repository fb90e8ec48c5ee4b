"""Joint angles that a body can take."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.skin.robot import Robot

SLACK = np.radians(1.0)  # encoders may read that far beyond a limit without being wrong
SLIDING_SLACK = 1e-3  # the same where a joint slides [m]


def posed(robot: Robot, angles: Mapping[str, float]) -> dict[str, FloatArray]:
    """T_root_link (4, 4) of every link; joints not named stand as in the robot's natural pose.

    Raises
    ------
    UnknownNameError
        A joint that the body lacks.
    InvalidArrayError
        An angle that is not finite or beyond the joint's limits; names it, and both in degrees.
    """
    limits, slides = robot.body.joints, robot.body.sliding_joints
    for joint, angle in angles.items():
        if joint not in limits:
            raise UnknownNameError("joint", joint, limits)
        low, high = limits[joint]
        slack = SLIDING_SLACK if joint in slides else SLACK
        if not low - slack <= angle <= high + slack:  # false for NaN
            raise InvalidArrayError(
                f"joint {joint!r} cannot be at {readable(angle, sliding=joint in slides)}: its "
                f"limits are {readable(low, sliding=joint in slides)} to "
                f"{readable(high, sliding=joint in slides)}"
            )
    return robot.body.poses({**robot.pose, **angles})


def readable(angle: float, *, sliding: bool = False) -> str:
    """A joint's angle [rad] in degrees; where it slides its way [m] in millimetres."""
    return f"{1e3 * angle:.1f} mm" if sliding else f"{np.degrees(angle):.1f} degrees"

"""Kinematic chains from the URDF of a robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from calibration.mount.chains import Chain, joint_transform, known
from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.skin.joints import Joint, ancestors, check_link
from skinmap.skin.robot import Robot


def robot_chain(
    robot: Robot,
    link: str,
    joint_names: Sequence[str],
    *,
    base: str | None = None,
    held: Mapping[str, float] | None = None,
    name: str | None = None,
    mount: ArrayLike | None = None,
    taxels: ArrayLike | None = None,
    normals: ArrayLike | None = None,
) -> Chain:
    """The chain from one link of a robot to another.

    Parameters
    ----------
    robot : Robot
        As `skinmap.load_robot` returns it.
    link : str
        Where the chain ends.
    joint_names : sequence of str
        Joints of the robot in the order of a recording's columns; those that the chain does not
        pass may be among them.
    base : str, optional
        Where the chain begins, any link of the body; its root by default. The way leads up to the
        common ancestor and down from there.
    held : mapping of str to float, optional
        Angles [rad or m] of joints that no column tells, as they stood all the time.
    name : str, optional
        The link's by default.
    mount : (4, 4) array-like of float, optional
        T_link_patch.
    taxels, normals : (n, 3) array-like of float, optional
        Positions in the patch [m], and outward directions there; none for a probe.

    Returns
    -------
    Chain
        Of the joints that it passes.

    Raises
    ------
    UnknownNameError
        A link or joint that the body lacks (names those that exist).
    InvalidArrayError
        A joint that the chain passes and neither `joint_names` nor `held` names, or one that is
        named twice.

    Examples
    --------
    >>> import skinmap
    >>> from calibration import robot_chain
    >>> joints = ["right_shoulder_pitch", "right_shoulder_roll", "right_elbow", "right_wrist"]
    >>> chain = robot_chain(skinmap.load_robot("kaspar"), "right_hand", joints)
    >>> chain.name, len(chain.joints)
    ('right_hand', 4)
    """
    body, tree = robot.body, robot.body.tree
    links = body.links
    start = check_link(links, _root(robot) if base is None else base)
    columns, still = _columns(robot, joint_names), dict(held or {})
    for joint in still:
        _check_joint(robot, joint)
    walk = _Walk(columns, still)
    up, down = ancestors(tree, start), ancestors(tree, check_link(links, link))
    shared = next(one for one in up if one in down)
    for one in up[: up.index(shared)]:
        walk.climb(tree[one])
    for one in reversed(down[: down.index(shared)]):
        walk.descend(tree[one])
    if walk.unknown:
        raise InvalidArrayError(
            f"the chain from {start!r} to {link!r} passes joints whose angles are not given: "
            f"{', '.join(dict.fromkeys(walk.unknown))}; given are: {', '.join(columns) or 'none'}"
        )
    before, axes, sliding, numbers, factors, shifts = [*zip(*walk.passed, strict=True)] or [()] * 6
    j, given = len(numbers), known(mount=mount, taxels=taxels, normals=normals)
    return Chain(
        link if name is None else name,
        np.array(before).reshape(j, 4, 4),
        np.array(axes).reshape(j, 3),
        np.array(sliding, np.bool_),
        np.array(numbers, np.int64),
        np.array(factors, np.float64),
        np.array(shifts, np.float64),
        walk.T,
        **given,
    )


class _Walk:
    """Joints and the fixed transforms between them, gathered on the way from link to link."""

    def __init__(self, columns: Mapping[str, int], held: Mapping[str, float]) -> None:
        self._columns, self._held = columns, held
        # Of each joint: the transform before it, axis, sliding, column, factor and shift.
        self.passed = list[tuple[FloatArray, FloatArray, bool, int, float, float]]()
        self.unknown = list[str]()
        self.T: FloatArray = np.eye(4)  # since the last joint

    def descend(self, joint: Joint) -> None:
        """From the parent of a joint to its child."""
        self.T = self.T @ joint.T_parent_joint
        self._pass(joint, 1.0)

    def climb(self, joint: Joint) -> None:
        """From the child of a joint to its parent: its angle counts the other way round."""
        self._pass(joint, -1.0)
        self.T = self.T @ np.linalg.inv(joint.T_parent_joint)

    def _pass(self, joint: Joint, sign: float) -> None:
        if joint.kind == "fixed":
            return
        slides = joint.kind == "slides"
        if joint.driver in self._columns:
            column, shift = self._columns[joint.driver], sign * joint.offset
            self.passed.append((self.T, joint.axis, slides, column, sign * joint.factor, shift))
            self.T = np.eye(4)
        elif not joint.driver or joint.driver in self._held:
            angle = joint.factor * self._held.get(joint.driver, 0.0) + joint.offset
            axis = joint.axis if slides else joint.axis / np.linalg.norm(joint.axis)
            own = np.array([sign * angle])
            self.T = self.T @ joint_transform(axis, own, sliding=slides)[0]
        else:
            self.unknown.append(joint.driver)


def _root(robot: Robot) -> str:
    return ancestors(robot.body.tree, robot.body.links[0])[-1]


def _check_joint(robot: Robot, joint: str) -> None:
    if joint not in robot.body.joints:
        raise UnknownNameError("joint", joint, robot.body.joints)


def _columns(robot: Robot, joint_names: Sequence[str]) -> dict[str, int]:
    columns: dict[str, int] = {}
    for column, joint in enumerate(joint_names):
        _check_joint(robot, joint)
        if joint in columns:
            raise InvalidArrayError(f"joint {joint!r} is named twice, as column {columns[joint]}"
                                    f" and {column}")  # fmt: skip
        columns[joint] = column
    return columns

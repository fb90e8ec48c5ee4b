"""Arms and heads with skin on them: kinematic chains, and what touched what in which pose.

Kinematic chains from the URDF of a robot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_whole, freeze
from skinmap.errors import InvalidArrayError, check_known
from skinmap.geometry.rigid import check_transform, rigid_transform, rpy_matrix
from skinmap.skin.robot import Robot, ancestors, check_link


@dataclass(frozen=True, eq=False, slots=True)
class Chain:
    """A kinematic chain that ends in a link with a patch, or in a probe.

    From the base it takes, in turn, a fixed transform and a joint, and after the last joint one
    more fixed transform to the link. `Chain.from_dh` makes one from rows of Denavit and
    Hartenberg, `calibration.mount.chains.robot_chain` from a robot's URDF.

    Attributes
    ----------
    name : str
    before : (j, 4, 4) float
        Fixed transform that leads to each joint, from the joint before it or from the base [m].
    axes : (j, 3) float
        Axis of each joint in its own frame: turns are about it, slides go along it.
    sliding : (j,) bool
        Whether each joint slides instead of turning.
    joints : (j,) int
        Column of a recording's angles that moves each joint; one column may move several.
    factors, shifts : (j,) float
        A joint's own angle is factor * angle of its column + shift.
    after : (4, 4) float
        From the last joint to the link [m].
    mount : (4, 4) float
        T_link_patch.
    taxels : (n, 3) float
        Positions in the patch [m], NaN where an id has no taxel; none for a probe, whose tip
        is one unknown point of the link.
    normals : (n, 3) float
        Outward at each taxel, NaN where there is none; nothing where they are not known.
    radius : float
        Of a probe: how far from its tip it is felt [m], where that is known.
    """

    name: str
    before: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    axes: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    sliding: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    joints: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    factors: FloatArray = field(default_factory=lambda: np.zeros(0))
    shifts: FloatArray = field(default_factory=lambda: np.zeros(0))
    after: FloatArray = field(default_factory=lambda: np.eye(4))
    mount: FloatArray = field(default_factory=lambda: np.eye(4))
    taxels: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    normals: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    radius: float = 0.0

    def __post_init__(self) -> None:
        joints = check_whole(self.joints, "joints")
        if joints.min(initial=0) < 0:  # would count from the last angle
            raise InvalidArrayError(f"joints of {self.name!r} are columns from 0, got {joints}")
        j = len(joints)
        before = check_finite(self.before, f"before of {self.name!r}", (j, 4, 4))
        axes = check_finite(self.axes, f"axes of {self.name!r}", (j, 3))
        sliding = np.array(self.sliding, np.bool_)
        if sliding.shape != (j,):
            raise InvalidArrayError(f"{len(sliding)} of sliding for {j} joints of {self.name!r}")
        length = np.asarray(np.linalg.norm(axes, axis=1))
        if not length.all():
            raise InvalidArrayError(f"joint {int(np.argmin(length))} of {self.name!r} has no axis")
        freeze(
            self,
            before=np.array([check_transform(T, "before") for T in before]).reshape(j, 4, 4),
            # A turn is about the axis whatever its length; a slide goes its length a metre.
            axes=np.where(sliding[:, None], axes, axes / length[:, None]),
            sliding=sliding,
            joints=joints,
            factors=check_finite(self.factors, f"factors of {self.name!r}", (j,)),
            shifts=check_finite(self.shifts, f"shifts of {self.name!r}", (j,)),
            after=check_transform(self.after, "after"),
            mount=check_transform(self.mount, "mount"),
            taxels=_check_taxels(self.taxels, self.name, "taxels"),
            normals=_check_taxels(self.normals, self.name, "normals"),
        )
        if len(self.normals) not in (0, len(self.taxels)):
            raise InvalidArrayError(
                f"{len(self.normals)} normals for {len(self.taxels)} taxels of {self.name!r}"
            )

    @classmethod
    def from_dh(
        cls,
        name: str,
        dh: ArrayLike,
        joints: ArrayLike,
        mount: ArrayLike | None = None,
        taxels: ArrayLike | None = None,
    ) -> Chain:
        """A chain from rows of Denavit and Hartenberg, in the standard convention.

        Parameters
        ----------
        name : str
        dh : (k, 4) array-like of float
            a [m], d [m], alpha [rad] and offset [rad] of each row, from the base; rows before the
            joints' own are fixed.
        joints : (j,) array-like of int
            Column of a recording's angles of each of the last j rows.
        mount : (4, 4) array-like of float, optional
            T_link_patch.
        taxels : (n, 3) array-like of float, optional
            None for a probe.
        """
        rows = check_finite(np.reshape(np.asarray(dh, np.float64), (-1, 4)), "dh", (None, 4))
        columns = check_whole(joints, "joints")
        j, T = len(columns), np.eye(4)
        if j > len(rows):
            raise InvalidArrayError(f"{j} joints for {len(rows)} rows of {name!r}")
        before = []
        for row, (a, d, alpha, offset) in enumerate(rows):
            if row >= len(rows) - j:  # its joint turns about the z axis of the frame before it
                before.append(T)
                T = np.eye(4)
            T = T @ _dh_link(a, d, alpha, offset)
        return cls(
            name,
            np.array(before).reshape(j, 4, 4),
            np.tile([0.0, 0.0, 1.0], (j, 1)),
            np.zeros(j, np.bool_),
            columns,
            np.ones(j),
            np.zeros(j),
            T,
            **known(mount=mount, taxels=taxels),
        )

    @property
    def is_probe(self) -> bool:
        """Whether the chain ends in a tip instead of a patch."""
        return len(self.taxels) == 0

    def frames(self, angles: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
        """T_base_link (m, 4, 4) for joint angles (m, joints of the robot) [rad, m].

        `offsets` (joints of the robot,) are added to the angles.
        """
        return self.motion(angles, offsets)[0]

    def motion(
        self, angles: FloatArray, offsets: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """T_base_link (m, 4, 4) with the axes (j, m, 3) and the origins (j, m, 3) of its joints.

        Axes are in the frame of the base, as long as the joint goes for one unit of its column.
        """
        every = angles if offsets is None else angles + offsets
        m, j = len(angles), len(self.joints)
        axes, origins = np.empty((j, m, 3)), np.empty((j, m, 3))
        T = np.broadcast_to(np.eye(4), (m, 4, 4))
        for k, column in enumerate(self.joints.tolist()):
            T = T @ self.before[k]
            origins[k] = T[:, :3, 3]
            axes[k] = self.factors[k] * (T[:, :3, :3] @ self.axes[k])
            own = self.factors[k] * every[:, column] + self.shifts[k]
            T = T @ joint_transform(self.axes[k], own, sliding=bool(self.sliding[k]))
        return np.asarray(T @ self.after), axes, origins

    def slopes(self, axes: FloatArray, origins: FloatArray, points: FloatArray) -> FloatArray:
        """How points (m, 3) of the link, in the frame of the base, move with each joint's angle.

        `axes` and `origins` come from `motion`; (j, m, 3) [m a radian, or a metre].
        """
        turned = np.cross(axes, points - origins)
        return np.where(self.sliding[:, None, None], axes, turned)


def known(**given: ArrayLike | None) -> dict[str, Any]:
    """What was given of a chain, by the names of its fields; what was not has its default."""
    return {name: np.asarray(value) for name, value in given.items() if value is not None}


def _check_taxels(given: FloatArray, name: str, what: str) -> FloatArray:
    taxels = np.asarray(given)
    if taxels.shape[1:] != (3,) or taxels.dtype.kind not in "iuf":
        raise InvalidArrayError(
            f"{what} of {name!r} must be numbers of shape (n, 3), got {taxels.dtype} {taxels.shape}"
        )
    return taxels.astype(np.float64)


def joint_transform(axis: FloatArray, angle: FloatArray, *, sliding: bool) -> FloatArray:
    """(m, 4, 4) turns about a unit axis (3,) by angles (m,) [rad], or slides along it [lengths]."""
    T, move = np.tile(np.eye(4), (len(angle), 1, 1)), angle[:, None] * axis
    if sliding:
        T[:, :3, 3] = move
    else:
        T[:, :3, :3] = Rotation.from_rotvec(move).as_matrix()
    return T


def _dh_link(a: float, d: float, alpha: float, turn: float) -> FloatArray:
    """(4, 4) of one row: rotation about z by `turn`, along z by d, along x by a, about x."""
    shift = np.array([a * np.cos(turn), a * np.sin(turn), d])
    return rigid_transform(rpy_matrix((alpha, 0.0, turn)), shift)


@dataclass(frozen=True, eq=False, slots=True)
class TouchRecording:
    """One chain touching another in many poses.

    Attributes
    ----------
    name : str
    chains : tuple of str
        The two that touch.
    angles : (m, joints) float
        Joint angles of the robot at each event [rad].
    touched : tuple of two sequences of (k,) int
        Activated taxels of each chain at each event; None for a probe.
    """

    name: str
    chains: tuple[str, str]
    angles: FloatArray
    touched: tuple[Sequence[IntArray] | None, Sequence[IntArray] | None]

    def __post_init__(self) -> None:
        angles = check_finite(self.angles, f"angles of {self.name!r}", (None, None))
        for chain, ids in zip(self.chains, self.touched, strict=True):
            if ids is not None and len(ids) != len(angles):
                raise InvalidArrayError(
                    f"{self.name!r}: {len(ids)} events of {chain!r} for {len(angles)} poses"
                )
        freeze(self, angles=angles)

    def __len__(self) -> int:
        return len(self.angles)

    def subset(self, mask: BoolArray) -> TouchRecording:
        """Some of the events."""
        rows = np.flatnonzero(mask).tolist()
        first, second = (
            None if ids is None else [ids[row] for row in rows] for ids in self.touched
        )
        return TouchRecording(self.name, self.chains, self.angles[rows], (first, second))


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
    tree, links = robot.body.tree, robot.body.links
    start = check_link(links, ancestors(tree, links[0])[-1] if base is None else base)
    columns, still = joint_columns(robot, joint_names), dict(held or {})
    for own in still:
        _check_joint(robot, own)
    up, down = ancestors(tree, start), ancestors(tree, check_link(links, link))
    shared = next(one for one in up if one in down)
    # On the way up a joint's angle counts the other way round.
    way = [(tree[one], -1.0) for one in up[: up.index(shared)]]
    way += [(tree[one], 1.0) for one in reversed(down[: down.index(shared)])]
    T: FloatArray = np.eye(4)  # since the last joint
    # Of each joint: the transform before it, axis, sliding, column, factor and shift.
    passed = list[tuple[FloatArray, FloatArray, bool, int, float, float]]()
    unknown = list[str]()
    for joint, sign in way:
        T = T @ joint.T_parent_joint if sign > 0 else T
        slides, driver = joint.kind == "slides", joint.driver
        if joint.kind == "fixed":
            pass
        elif driver in columns:
            shift = sign * joint.offset
            passed.append((T, joint.axis, slides, columns[driver], sign * joint.factor, shift))
            T = np.eye(4)
        elif not driver or driver in still:
            angle = np.array([sign * (joint.factor * still.get(driver, 0.0) + joint.offset)])
            axis = joint.axis if slides else joint.axis / np.linalg.norm(joint.axis)
            T = T @ joint_transform(axis, angle, sliding=slides)[0]
        else:
            unknown.append(driver)
        T = T @ np.linalg.inv(joint.T_parent_joint) if sign < 0 else T
    if unknown:
        raise InvalidArrayError(
            f"the chain from {start!r} to {link!r} passes joints whose angles are not given: "
            f"{', '.join(dict.fromkeys(unknown))}; given are: {', '.join(columns) or 'none'}"
        )
    before, axes, sliding, numbers, factors, shifts = [*zip(*passed, strict=True)] or [()] * 6
    j, given = len(numbers), known(mount=mount, taxels=taxels, normals=normals)
    return Chain(
        link if name is None else name,
        np.array(before).reshape(j, 4, 4),
        np.array(axes).reshape(j, 3),
        np.array(sliding, np.bool_),
        np.array(numbers, np.int64),
        np.array(factors, np.float64),
        np.array(shifts, np.float64),
        T,
        **given,
    )


def _check_joint(robot: Robot, joint: str) -> None:
    check_known("joint", [joint], robot.body.joints)


def joint_columns(robot: Robot, joint_names: Sequence[str]) -> dict[str, int]:
    """Column of each joint of a robot, none of them unknown or named twice."""
    columns: dict[str, int] = {}
    for column, joint in enumerate(joint_names):
        _check_joint(robot, joint)
        if joint in columns:
            raise InvalidArrayError(f"joint {joint!r} is named twice, as column {columns[joint]}"
                                    f" and {column}")  # fmt: skip
        columns[joint] = column
    return columns

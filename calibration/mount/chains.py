"""Arms and heads with skin on them: kinematic chains, and what touched what in which pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_whole, freeze
from skinmap.errors import InvalidArrayError
from skinmap.geometry.rigid import check_transform


@dataclass(frozen=True, eq=False, slots=True)
class Chain:
    """A kinematic chain that ends in a link with a patch, or in a probe.

    Attributes
    ----------
    name : str
    dh : (k, 4) float
        Denavit and Hartenberg's a [m], d [m], alpha [rad] and offset [rad] (the standard
        convention), from the base; rows before the joints' own are fixed.
    joints : (j,) int
        Column of a recording's angles of each of the last j rows.
    mount : (4, 4) float
        T_link_patch.
    taxels : (n, 3) float
        Positions in the patch [m], NaN where an id has no taxel; none for a probe, whose tip
        is one unknown point of the link.
    """

    name: str
    dh: FloatArray
    joints: IntArray
    mount: FloatArray = field(default_factory=lambda: np.eye(4))
    taxels: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        dh = check_finite(np.reshape(self.dh, (-1, 4)), "dh", (None, 4))
        joints = check_whole(self.joints, "joints")
        if joints.min(initial=0) < 0:  # would count from the last angle
            raise InvalidArrayError(f"joints of {self.name!r} are columns from 0, got {joints}")
        taxels = np.asarray(self.taxels)
        if taxels.shape[1:] != (3,) or taxels.dtype.kind not in "iuf":
            raise InvalidArrayError(
                f"taxels of {self.name!r} must be numbers of shape (n, 3), "
                f"got {taxels.dtype} {taxels.shape}"
            )
        if len(joints) > len(dh):
            raise InvalidArrayError(f"{len(joints)} joints for {len(dh)} rows of {self.name!r}")
        freeze(
            self,
            dh=dh,
            joints=joints,
            mount=check_transform(self.mount, "mount"),
            taxels=taxels.astype(np.float64),
        )

    @property
    def is_probe(self) -> bool:
        """Whether the chain ends in a tip instead of a patch."""
        return len(self.taxels) == 0

    def frames(self, angles: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
        """T_base_link (m, 4, 4) for joint angles (m, joints of the robot) [rad].

        `offsets` (joints of the robot,) are added to the angles.
        """
        return self.motion(angles, offsets)[0]

    def motion(
        self, angles: FloatArray, offsets: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """T_base_link (m, 4, 4) with the axes (j, m, 3) and the origins (j, m, 3) of its joints."""
        every = angles if offsets is None else angles + offsets
        T = np.broadcast_to(np.eye(4), (len(angles), 4, 4))
        fixed = len(self.dh) - len(self.joints)
        poses = []
        for row, (a, d, alpha, offset) in enumerate(self.dh):
            turn = np.full(len(angles), offset)
            if row >= fixed:
                poses.append(T)
                turn = turn + every[:, self.joints[row - fixed]]
            T = T @ _link(a, d, alpha, turn)
        # A row of Denavit and Hartenberg's turns about the z axis of the frame before it.
        before = np.array(poses).reshape(len(self.joints), len(angles), 4, 4)
        return np.asarray(T), before[..., :3, 2], before[..., :3, 3]


def _link(a: float, d: float, alpha: float, turn: FloatArray) -> FloatArray:
    """(m, 4, 4) of one row: rotation about z by `turn`, along z by d, along x by a, about x."""
    c, s, ca, sa = np.cos(turn), np.sin(turn), np.cos(alpha), np.sin(alpha)
    zero, one = np.zeros_like(c), np.ones_like(c)
    rows = [
        [c, -s * ca, s * sa, a * c],
        [s, c * ca, -c * sa, a * s],
        [zero, sa * one, ca * one, d * one],
        [zero, zero, zero, one],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


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

"""What may move in a fit of self-touch: mounts, tips, joints' zeros, and how far skins stand apart.

Middles of two contact areas never coincide: soft skins sink into each other, a fingertip has a
radius, and the middle of taxels on a bent sheet lies below it. All of that is along the normals
and much the same throughout a recording, so each recording has one unknown length along them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from skinmap.arrays import FloatArray

JOINT_SIGMA = np.deg2rad(2.0)  # what zero positions of joints are off by
STANDOFF_SIGMA = 4e-3  # of that length: half a fingertip, twice a soft skin's give [m]


@dataclass(eq=False, slots=True)
class ChainState:
    """Unknowns: T_link_patch of each chain (of a probe: its tip), and lengths and angles.

    `offsets` are added to the joint angles [rad]; `standoffs` say how far the two sides of each
    recording stand apart along their normals [m], 0 where it is not named.
    """

    mounts: dict[str, FloatArray]
    offsets: FloatArray
    standoffs: dict[str, float] = field(default_factory=dict)

    def copy(self) -> ChainState:
        """Another state with the same values."""
        return ChainState(dict(self.mounts), self.offsets.copy(), dict(self.standoffs))


@dataclass(frozen=True, eq=False, slots=True)
class Unknowns:
    """What may move.

    Attributes
    ----------
    mounts, tips : tuple of str
        Chains whose patch moves with six freedoms, probes whose tip moves with three.
    joints : tuple of int
        Columns of the angles that get an offset.
    standoffs : mapping of str to float
        Recordings whose sides stand apart by an unknown length, and what is expected of it [m].
    considered : tuple of int
        Columns of the angles that have a column in the equations too, but are not solved for.
    """

    mounts: tuple[str, ...]
    tips: tuple[str, ...]
    joints: tuple[int, ...]
    standoffs: Mapping[str, float] = field(default_factory=dict)
    considered: tuple[int, ...] = ()

    def columns(self) -> Columns:
        """Where each unknown stands in the normal equations."""
        chains = {name: 6 * k for k, name in enumerate(self.mounts)}
        base = 6 * len(self.mounts)
        chains |= {name: base + 3 * k for k, name in enumerate(self.tips)}
        base += 3 * len(self.tips)
        joints = {joint: base + k for k, joint in enumerate(self.joints)}
        base += len(self.joints)
        standoffs = {name: base + k for k, name in enumerate(self.standoffs)}
        base += len(self.standoffs)
        joints |= {joint: base + k for k, joint in enumerate(self.considered)}
        return Columns(chains, joints, standoffs, base + len(self.considered))

    def prior(self, state: ChainState) -> tuple[FloatArray, FloatArray]:
        """Inverse variance of each column's prior, 0 for none, and how far the state is from it."""
        columns = self.columns()
        weight, off = np.zeros(columns.count), np.zeros(columns.count)
        for number, column in columns.joints.items():
            weight[column], off[column] = JOINT_SIGMA**-2, state.offsets[number]
        for name, column in columns.standoffs.items():
            weight[column] = STANDOFF_SIGMA**-2
            off[column] = state.standoffs.get(name, 0.0) - self.standoffs[name]
        return weight, off

    def apply(self, move: FloatArray, state: ChainState) -> None:
        """Move a state; mounts turn by a left-multiplied rotation vector about their origin."""
        columns = self.columns()
        for name, column in columns.chains.items():
            mount = state.mounts[name].copy()
            if name in self.mounts:
                turn = Rotation.from_rotvec(move[column : column + 3]).as_matrix()
                mount[:3, :3] = turn @ mount[:3, :3]
                column += 3
            mount[:3, 3] += move[column : column + 3]
            state.mounts[name] = mount
        for number, column in columns.joints.items():
            state.offsets[number] += move[column]
        for name, column in columns.standoffs.items():
            state.standoffs[name] = state.standoffs.get(name, 0.0) + float(move[column])


@dataclass(frozen=True, slots=True)
class Columns:
    """First column of each chain, column of each joint and recording, and their number."""

    chains: dict[str, int]
    joints: dict[int, int]
    standoffs: dict[str, int]
    count: int

"""Mounts, probe tips and joint offsets that bring the places of self-touch together.

Gauss-Newton steps with analytic Jacobians; places are paired again before each step. A mount
turns by a left-multiplied rotation vector about its own origin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.mount.chains import Chain
from calibration.mount.pairing import Contacts
from calibration.mount.rigid_mount import CAUCHY, LENGTH, Loss, fit_mount
from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError

CLOSED = 3  # rounds in closed form, which no start can miss, before the steps
STEPS = 40
SETTLED = 1e-6  # a step that moves nothing further is the last [m, rad]
RIDGE = 1e-6  # of the normal matrix's diagonal: holds what no touch can tell


@dataclass(eq=False, slots=True)
class ChainState:
    """Unknowns: T_link_patch of each chain (of a probe: its tip), and added joint angles [rad]."""

    mounts: dict[str, FloatArray]
    offsets: FloatArray

    def copy(self) -> ChainState:
        """Another state with the same values."""
        return ChainState(dict(self.mounts), self.offsets.copy())


@dataclass(frozen=True, eq=False, slots=True)
class Unknowns:
    """What may move.

    Attributes
    ----------
    mounts, tips : tuple of str
        Chains whose patch moves with six freedoms, probes whose tip moves with three.
    joints : tuple of int
        Columns of the angles that get an offset.
    joint_sigma : float
        Prior standard deviation of an offset [rad].
    """

    mounts: tuple[str, ...]
    tips: tuple[str, ...]
    joints: tuple[int, ...]
    joint_sigma: float

    def columns(self) -> tuple[dict[str, int], dict[int, int], int]:
        """First column of each chain, column of each joint, and their number."""
        first = {name: 6 * k for k, name in enumerate(self.mounts)}
        base = 6 * len(self.mounts)
        first |= {name: base + 3 * k for k, name in enumerate(self.tips)}
        base += 3 * len(self.tips)
        return (
            first,
            {joint: base + k for k, joint in enumerate(self.joints)},
            base + len(self.joints),
        )


def fit_chains(
    contacts: Sequence[Contacts],
    chains: Mapping[str, Chain],
    unknowns: Unknowns,
    start: ChainState,
    loss: Loss,
) -> ChainState:
    """The state of least squares, or of the robust loss from there."""
    state = start.copy()
    for _ in range(CLOSED):
        for name in (*unknowns.tips, *unknowns.mounts):
            _place(name, contacts, chains, unknowns, state)
    # Squares first: the robust loss alone loses its way from far starts.
    for stage in ("linear",) if loss == "linear" else ("linear", "cauchy"):
        for _ in range(STEPS):
            if _step(contacts, chains, unknowns, state, stage == "cauchy") < SETTLED:
                break
    return state


def misses(contact: Contacts, chains: Mapping[str, Chain], state: ChainState) -> FloatArray:
    """Vectors (m, 3) between the places that met [m]."""
    T = [_pose(chains[name], contact, state) for name in contact.recording.chains]
    first, second = contact.choose(T)
    return _carry(T[0], first) - _carry(T[1], second)


def _pose(chain: Chain, contact: Contacts, state: ChainState) -> FloatArray:
    return chain.frames(contact.recording.angles, state.offsets) @ state.mounts[chain.name]


def _carry(T: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("mij,mj->mi", T[:, :3, :3], points) + T[:, :3, 3])


def _place(
    name: str,
    contacts: Sequence[Contacts],
    chains: Mapping[str, Chain],
    unknowns: Unknowns,
    state: ChainState,
) -> None:
    """Mount or tip of one chain in closed form while the others hold still."""
    points, frames, targets = [], [], []
    for contact in contacts:
        if name not in contact.recording.chains:
            continue
        own = contact.recording.chains.index(name)
        T = [_pose(chains[other], contact, state) for other in contact.recording.chains]
        pair = contact.choose(T)
        points.append(pair[own])
        frames.append(chains[name].frames(contact.recording.angles, state.offsets))
        targets.append(_carry(T[1 - own], pair[1 - own]))
    if not points:
        raise InvalidArrayError(f"no recording touches {name!r}")
    p, T_link, q = (np.concatenate(part) for part in (points, frames, targets))
    if name in unknowns.mounts:
        state.mounts[name] = fit_mount(p, T_link, q).mount
        return
    back = np.einsum("mji,mj->mi", T_link[:, :3, :3], q - T_link[:, :3, 3])
    tip = np.eye(4)
    tip[:3, 3] = np.median(back, axis=0)
    state.mounts[name] = tip


@dataclass(frozen=True, eq=False, slots=True)
class _System:
    """Normal equations of one state."""

    normal: FloatArray  # (c, c), with the priors
    slope: FloatArray  # (c,)
    length: FloatArray  # (m,) of the misses [m]
    weight: FloatArray  # (m,)


def _system(
    contacts: Sequence[Contacts],
    chains: Mapping[str, Chain],
    unknowns: Unknowns,
    state: ChainState,
    robust: bool,
) -> _System:
    first, joint, count = unknowns.columns()
    parts = [_rows(contact, chains, state, first, joint, count) for contact in contacts]
    missed = np.concatenate([part[0] for part in parts])
    jacobian = np.concatenate([part[1] for part in parts])
    length = np.asarray(np.linalg.norm(missed, axis=1))
    scale = max(float(np.median(length)) / LENGTH, 1e-9)
    weight = 1.0 / (1.0 + (length / (CAUCHY * scale)) ** 2) if robust else np.ones(len(length))
    weighted = jacobian * weight[:, None, None]
    normal = np.tensordot(weighted, jacobian, axes=([0, 1], [0, 1]))
    slope = np.tensordot(weighted, missed, axes=([0, 1], [0, 1]))
    prior = (scale / unknowns.joint_sigma) ** 2
    for number, column in joint.items():
        normal[column, column] += prior
        slope[column] += prior * state.offsets[number]
    diagonal = np.arange(count)
    normal[diagonal, diagonal] *= 1.0 + RIDGE
    normal[diagonal, diagonal] += 1e-12  # a column that nothing touches stays where it is
    return _System(normal, slope, length, weight)


def _step(
    contacts: Sequence[Contacts],
    chains: Mapping[str, Chain],
    unknowns: Unknowns,
    state: ChainState,
    robust: bool,
) -> float:
    """One Gauss-Newton step; returns the largest move."""
    system = _system(contacts, chains, unknowns, state, robust)
    move: FloatArray = -np.asarray(np.linalg.solve(system.normal, system.slope), np.float64)
    _apply(move, unknowns, state)
    return float(np.abs(move).max(initial=0.0))


def mount_covariances(
    contacts: Sequence[Contacts],
    chains: Mapping[str, Chain],
    unknowns: Unknowns,
    state: ChainState,
    loss: Loss,
) -> dict[str, FloatArray]:
    """(6, 6) covariance of each mount from the misses' own spread, as in `rigid_mount`."""
    system = _system(contacts, chains, unknowns, state, loss == "cauchy")
    count, weight = len(system.slope), system.weight
    free = max(1.0, 3.0 * len(weight) - count) / len(weight)
    slope = float(np.mean(weight + 2.0 * weight**2)) / 3.0
    variance = float(np.mean((weight * system.length) ** 2)) / free / slope**2
    # The normal matrix is weighted: on average by the slope's share of it.
    inverse: FloatArray = np.asarray(np.linalg.inv(system.normal), np.float64)
    every = variance * float(np.mean(weight)) * inverse
    first, _, _ = unknowns.columns()
    return {
        name: every[column : column + 6, column : column + 6]
        for name, column in first.items()
        if name in unknowns.mounts
    }


def _apply(move: FloatArray, unknowns: Unknowns, state: ChainState) -> None:
    first, joint, _ = unknowns.columns()
    for name, column in first.items():
        mount = state.mounts[name].copy()
        if name in unknowns.mounts:
            turn = Rotation.from_rotvec(move[column : column + 3]).as_matrix()
            mount[:3, :3] = turn @ mount[:3, :3]
            column += 3
        mount[:3, 3] += move[column : column + 3]
        state.mounts[name] = mount
    for number, column in joint.items():
        state.offsets[number] += move[column]


def _rows(
    contact: Contacts,
    chains: Mapping[str, Chain],
    state: ChainState,
    first: Mapping[str, int],
    joint: Mapping[int, int],
    count: int,
) -> tuple[FloatArray, FloatArray]:
    """Misses (m, 3) of one recording and their Jacobian (m, 3, count)."""
    names = contact.recording.chains
    moved = [chains[name].motion(contact.recording.angles, state.offsets) for name in names]
    pair = contact.choose(
        [frames @ state.mounts[name] for (frames, _, _), name in zip(moved, names, strict=True)]
    )
    jacobian = np.zeros((len(contact), 3, count))
    world = []
    for sign, name, (frames, axes, origins), points in zip(
        (1.0, -1.0), names, moved, pair, strict=True
    ):
        turn = frames[:, :3, :3]
        arm = points @ state.mounts[name][:3, :3].T  # from the mount's origin, in the link
        x = _carry(frames, arm + state.mounts[name][:3, 3])
        world.append(x)
        if name in first:
            column = first[name]
            if not chains[name].is_probe:
                lever = np.einsum("mij,mj->mi", turn, arm)
                swept = np.cross(turn.transpose(0, 2, 1), lever[:, None])
                jacobian[:, :, column : column + 3] += sign * swept.transpose(0, 2, 1)
                column += 3
            jacobian[:, :, column : column + 3] += sign * turn
        slopes = chains[name].slopes(axes, origins, x)
        for number, slope in zip(chains[name].joints.tolist(), slopes, strict=True):
            if number in joint:
                jacobian[:, :, joint[number]] += sign * slope
    return world[0] - world[1], jacobian

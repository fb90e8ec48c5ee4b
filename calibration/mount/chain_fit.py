"""Mounts, probe tips and joint offsets that bring the places of self-touch together.

Gauss-Newton steps with analytic Jacobians; places are paired again before each step. A mount
turns by a left-multiplied rotation vector about its own origin.

What may move in a fit of self-touch: mounts, tips, joints' zeros, and how far skins stand apart.

Middles of two contact areas never coincide: soft skins sink into each other, a fingertip has a
radius, and the middle of taxels on a bent sheet lies below it. All of that is along the normals
and much the same throughout a recording, so each recording has one unknown length along them.

Which places of two skins met in an event of self-touch.

An event names the active taxels of both sides, a patch of them on each. Two bodies pressed
together share the middle of their contact far better than they share any single taxel: the closest
two of many lie close under almost any mount. So connected active taxels are joined to one
place, their middle, and the places of both sides that lie closest are the pair.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.rigid_mount import CAUCHY, LENGTH, fit_mount
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import rigid_transform

LINK = 2.2  # times the spacing of the taxels: reaches over one silent taxel, not to another contact


@dataclass(frozen=True, eq=False, slots=True)
class Side:
    """Places where one chain may have been touched.

    Attributes
    ----------
    places : (m, c, 3) float
        In the frame of the patch [m].
    filled : (m, c) bool
        False where an event has fewer places.
    outward : (m, c, 3) float
        Way that a place goes for each metre that two sides stand apart: half the mean normal of
        its taxels where both sides have normals, all of it where one has, else nothing.
    """

    places: FloatArray
    filled: BoolArray
    outward: FloatArray

    def at(self, standoff: float) -> FloatArray:
        """Places (m, c, 3) where the two sides stand apart by so much [m]."""
        return self.places + standoff * self.outward


def side_of(chain: Chain, touched: Sequence[IntArray] | None, m: int) -> Side:
    """Middles of the connected active taxels of m events; a probe has its origin alone."""
    if touched is None:
        return Side(np.zeros((m, 1, 3)), np.ones((m, 1), np.bool_), np.zeros((m, 1, 3)))
    event = np.repeat(np.arange(m), [len(ids) for ids in touched])
    ids = np.concatenate([np.asarray(ids, np.int64) for ids in touched])
    known = np.isfinite(chain.taxels[ids]).all(axis=1)
    event, ids = event[known], ids[known]
    group = _connected(event, ids, chain.taxels)
    _, first, group = np.unique(group, return_index=True, return_inverse=True)
    size = np.bincount(group)
    middle = _sums(chain.taxels[ids], group) / size[:, None]
    normal = np.zeros_like(middle)
    if len(chain.normals):
        normal = _sums(np.nan_to_num(chain.normals[ids]), group)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    owner = event[first]
    order = np.argsort(owner, kind="stable")
    owner, middle, normal = owner[order], middle[order], normal[order]
    rank = np.arange(len(owner)) - np.searchsorted(owner, owner)
    places, outward = np.zeros((2, m, int(rank.max(initial=0)) + 1, 3))
    filled = np.zeros(places.shape[:2], np.bool_)
    places[owner, rank], outward[owner, rank] = middle, normal
    filled[owner, rank] = True
    return Side(places, filled, outward)


def _sums(values: FloatArray, group: IntArray) -> FloatArray:
    """Sum of the rows (k, 3) of each group."""
    return np.stack([np.bincount(group, axis) for axis in values.T], axis=1)


def _connected(event: IntArray, ids: IntArray, taxels: FloatArray) -> IntArray:
    """Number of the connected patch of each active taxel, over all events at once."""
    used, local = np.unique(ids, return_inverse=True)
    spacing = median_spacing(taxels[np.isfinite(taxels).all(axis=1)])
    near = KDTree(taxels[used]).sparse_distance_matrix(
        KDTree(taxels[used]), LINK * spacing, output_type="coo_matrix"
    )
    width = len(used)
    touching = np.zeros((width, width), np.bool_)
    touching[near.row, near.col] = True
    rows, cols = [], []
    start = np.searchsorted(event, np.arange(event.max(initial=-1) + 2))
    for low, high in pairwise(start.tolist()):
        own = local[low:high]
        i, j = np.nonzero(touching[own[:, None], own])
        rows.append(i + low)
        cols.append(j + low)
    i, j = np.concatenate(rows), np.concatenate(cols)
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(len(ids), len(ids)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


@dataclass(frozen=True, eq=False, slots=True)
class Pairs:
    """Places (m, 3) of both sides that met, in their patches, and their ways `outward` (m, 3)."""

    places: tuple[FloatArray, FloatArray]
    outward: tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False, slots=True)
class Contacts:
    """A recording ready to be fitted to."""

    recording: TouchRecording
    sides: tuple[Side, Side]

    def __len__(self) -> int:
        return len(self.recording)

    @property
    def stands_apart(self) -> bool:
        """Whether it is known which way the two sides stand apart."""
        return any(side.outward.any() for side in self.sides)

    def choose(self, T: Sequence[FloatArray], standoff: float) -> Pairs:
        """The places of both sides that lie closest, moved apart by `standoff` [m].

        `T` holds T_base_patch (m, 4, 4) of both sides.
        """
        here, there = self.sides
        both = [side.at(standoff) for side in self.sides]
        first, second = (
            own @ pose[:, :3, :3].transpose(0, 2, 1) + pose[:, None, :3, 3]
            for pose, own in zip(T, both, strict=True)
        )
        apart = np.sum((first[:, :, None] - second[:, None]) ** 2, axis=3)
        apart[~(here.filled[:, :, None] & there.filled[:, None])] = np.inf
        one, other = np.divmod(apart.reshape(len(apart), -1).argmin(axis=1), apart.shape[2])
        row = np.arange(len(apart))
        return Pairs(
            (both[0][row, one], both[1][row, other]),
            (here.outward[row, one], there.outward[row, other]),
        )

    def reordered(self, order: IntArray) -> Contacts:
        """The same touches with the poses of others."""
        angles = self.recording.angles[order]
        return Contacts(replace(self.recording, angles=angles), self.sides)

    def subset(self, mask: BoolArray) -> Contacts:
        """Some of the events."""
        here, there = (
            Side(side.places[mask], side.filled[mask], side.outward[mask]) for side in self.sides
        )
        return Contacts(self.recording.subset(mask), (here, there))


def contacts_of(recording: TouchRecording, first: Chain, second: Chain) -> Contacts:
    """Join the active taxels of every event to places."""
    m = len(recording)
    one, other = recording.touched
    sides = side_of(first, one, m), side_of(second, other, m)
    # One metre apart is half a metre for each of two sides, all of it where only one has normals.
    share = 1.0 / max(sum(side.outward.any() for side in sides), 1)
    here, there = (replace(side, outward=share * side.outward) for side in sides)
    return Contacts(recording, (here, there))


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


CLOSED = 3  # rounds in closed form, which no start can miss, before the steps
STEPS = 40
SETTLED = 1e-6  # a step that moves nothing further is the last [m, rad]
JOINT_ERROR = np.deg2rad(0.5)  # of zeros that are not solved for: after a robot's own calibration
CELL = 20e-3  # two modules of a skin, about what one contact covers [m]
RIDGE = 1e-6  # of the normal matrix's diagonal: holds what no touch can tell


@dataclass(frozen=True, eq=False, slots=True)
class _System:
    """Normal equations of one state."""

    normal: FloatArray  # (c, c), with the priors
    by_touches: FloatArray  # (c, c), without
    slope: FloatArray  # (c,)
    length: FloatArray  # (m,) of the misses [m]
    weight: FloatArray  # (m,)
    missed: FloatArray  # (m, 3) [m]
    jacobian: FloatArray  # (m, 3, c)
    cells: tuple[IntArray, ...]  # (m,) of each side: events in the same place of a skin share one


@dataclass(frozen=True, eq=False, slots=True)
class Information:
    """What a fit knows of its unknowns, and of joints whose zeros it took as they are.

    Attributes
    ----------
    columns : Columns
        Of all unknowns, and after them of the joints that were only considered.
    noise : (c, c) float
        Covariance of the unknowns by the misses' own spread, as in `rigid_mount`, with what
        events in the same place share.
    considered : (c, c) float
        Covariance that zeros of the other joints, off by `JOINT_ERROR`, bring (the consider
        covariance of Schmidt, 1966).
    evidence : (d, d) float
        Inverse covariance of everything by the touches alone, without priors.
    """

    columns: Columns
    noise: FloatArray
    considered: FloatArray
    evidence: FloatArray

    def mount(self, name: str) -> tuple[FloatArray, FloatArray]:
        """(6, 6) of one mount, from noise and from joints."""
        own = slice(self.columns.chains[name], self.columns.chains[name] + 6)
        return self.noise[own, own], self.considered[own, own]


@dataclass(frozen=True, eq=False, slots=True)
class ChainFit:
    """A fit of unknowns to contacts."""

    contacts: Sequence[Contacts]
    chains: Mapping[str, Chain]
    unknowns: Unknowns

    def from_start(self, start: ChainState) -> ChainState:
        """The state of the robust loss, from that of least squares."""
        state = start.copy()
        for _ in range(CLOSED):
            for name in (*self.unknowns.tips, *self.unknowns.mounts):
                self._place(name, state)
        # Squares first: the robust loss alone loses its way from far starts.
        for robust in (False, True):
            for _ in range(STEPS):
                system = self._system(state, robust=robust)
                move = -np.asarray(np.linalg.solve(system.normal, system.slope), np.float64)
                self.unknowns.apply(move, state)
                if np.abs(move).max(initial=0.0) < SETTLED:
                    break
        return state

    def _place(self, name: str, state: ChainState) -> None:
        """Mount or tip of one chain in closed form while the others hold still."""
        points, frames, targets = [], [], []
        for contact in self.contacts:
            names = contact.recording.chains
            if name not in names:
                continue
            own = names.index(name)
            T = [_pose(self.chains[other], contact, state) for other in names]
            pair = contact.choose(T, _standoff(contact, state)).places
            points.append(pair[own])
            frames.append(self.chains[name].frames(contact.recording.angles, state.offsets))
            targets.append(_carry(T[1 - own], pair[1 - own]))
        if not points:
            raise InvalidArrayError(f"no recording touches {name!r}")
        p, T_link, q = (np.concatenate(part) for part in (points, frames, targets))
        if name in self.unknowns.mounts:
            state.mounts[name] = fit_mount(p, T_link, q).mount
        else:
            back = np.einsum("mji,mj->mi", T_link[:, :3, :3], q - T_link[:, :3, 3])
            state.mounts[name] = rigid_transform(np.eye(3), np.median(back, axis=0))

    def _system(self, state: ChainState, *, robust: bool) -> _System:
        columns = self.unknowns.columns()
        parts = [_rows(contact, self.chains, state, columns) for contact in self.contacts]
        missed = np.concatenate([part[0] for part in parts])
        jacobian = np.concatenate([part[1] for part in parts])
        length = np.asarray(np.linalg.norm(missed, axis=1))
        scale = max(float(np.median(length)) / LENGTH, 1e-9)
        weight = 1.0 / (1.0 + (length / (CAUCHY * scale)) ** 2) if robust else np.ones(len(length))
        weighted = jacobian * weight[:, None, None]
        normal = np.tensordot(weighted, jacobian, axes=([0, 1], [0, 1]))
        slope = np.tensordot(weighted, missed, axes=([0, 1], [0, 1]))
        by_touches = normal.copy()
        prior, off = self.unknowns.prior(state)
        diagonal = np.arange(columns.count)
        normal[diagonal, diagonal] += scale**2 * prior
        slope += scale**2 * prior * off
        normal[diagonal, diagonal] *= 1.0 + RIDGE
        normal[diagonal, diagonal] += 1e-12  # a column that nothing touches stays where it is
        cells = _cells([part[2] for part in parts], [one.recording.chains for one in self.contacts])
        return _System(normal, by_touches, slope, length, weight, missed, jacobian, cells)

    def information(self, state: ChainState) -> Information:
        """What the touches tell in a state that was fitted to them."""
        present = {name for one in self.contacts for name in one.recording.chains}
        moving = {int(joint) for name in present for joint in self.chains[name].joints}
        considered = tuple(sorted(moving - set(self.unknowns.joints)))
        every = replace(self.unknowns, considered=considered)
        system = replace(self, unknowns=every)._system(state, robust=True)
        columns, count = every.columns(), self.unknowns.columns().count
        weight = system.weight
        free = max(1.0, 3.0 * len(weight) - count) / len(weight)
        slope = float(np.mean(weight + 2.0 * weight**2)) / 3.0
        variance = float(np.mean((weight * system.length) ** 2)) / free / slope**2
        # The normal matrix is weighted: on average by the slope's share of it.
        variance *= float(np.mean(weight))
        inverse: FloatArray = np.asarray(np.linalg.inv(system.normal[:count, :count]))
        noise = variance * inverse
        for cell in system.cells:
            noise += inverse @ _shared(system, cell)[:count, :count] @ inverse
        dragged = JOINT_ERROR * inverse @ system.normal[:count, count:]
        evidence = system.by_touches / variance
        return Information(columns, noise, dragged @ dragged.T, evidence)


def _cells(
    places: Sequence[tuple[FloatArray, FloatArray]], names: Sequence[tuple[str, str]]
) -> tuple[IntArray, ...]:
    """For each side, the number of the cube of `CELL` on its patch that every event lies in."""
    found = []
    for side in (0, 1):
        which = np.unique([own[side] for own in names], return_inverse=True)[1]
        keys = [
            np.column_stack([np.full(len(own[side]), chain), np.floor(own[side] / CELL)])
            for own, chain in zip(places, which, strict=True)
        ]
        found.append(np.unique(np.concatenate(keys), axis=0, return_inverse=True)[1].ravel())
    return tuple(found)


def _shared(system: _System, cell: IntArray) -> FloatArray:
    """What events in the same place of a skin share, (c, c): dead taxels miss there every time.

    Their misses go together by as much as the products of different events in a cell say, in the
    mean over all cells.
    """
    weighted = system.missed * system.weight[:, None]
    sums, count = np.zeros((cell.max() + 1, 3)), np.bincount(cell)
    np.add.at(sums, cell, weighted)
    pairs = float((count * (count - 1)).sum())
    together = float((sums**2).sum() - (weighted**2).sum()) / max(3.0 * pairs, 1.0)
    pull = np.zeros((len(count), 3, system.jacobian.shape[2]))
    np.add.at(pull, cell, system.jacobian)
    own = np.tensordot(pull, pull, axes=([0, 1], [0, 1]))
    alone = np.tensordot(system.jacobian, system.jacobian, axes=([0, 1], [0, 1]))
    return np.asarray(max(together, 0.0) * (own - alone))


def _rows(
    contact: Contacts, chains: Mapping[str, Chain], state: ChainState, columns: Columns
) -> tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray]]:
    """Misses (m, 3) of one recording, their Jacobian (m, 3, columns), and the places that met."""
    names = contact.recording.chains
    moved = [chains[name].motion(contact.recording.angles, state.offsets) for name in names]
    pairs = contact.choose(
        [frames @ state.mounts[name] for (frames, _, _), name in zip(moved, names, strict=True)],
        _standoff(contact, state),
    )
    jacobian = np.zeros((len(contact), 3, columns.count))
    world = []
    for sign, name, (frames, axes, origins), points, outward in zip(
        (1.0, -1.0), names, moved, pairs.places, pairs.outward, strict=True
    ):
        turn = frames[:, :3, :3]
        own = state.mounts[name][:3, :3].T
        arm = points @ own  # from the mount's origin, in the link
        x = _carry(frames, arm + state.mounts[name][:3, 3])
        world.append(x)
        if name in columns.chains:
            column = columns.chains[name]
            if not chains[name].is_probe:
                lever = np.einsum("mij,mj->mi", turn, arm)
                swept = np.cross(turn.transpose(0, 2, 1), lever[:, None])
                jacobian[:, :, column : column + 3] += sign * swept.transpose(0, 2, 1)
                column += 3
            jacobian[:, :, column : column + 3] += sign * turn
        slopes = chains[name].slopes(axes, origins, x)
        for number, slope in zip(chains[name].joints.tolist(), slopes, strict=True):
            if number in columns.joints:
                jacobian[:, :, columns.joints[number]] += sign * slope
        if contact.recording.name in columns.standoffs:
            away = np.einsum("mij,mj->mi", turn, outward @ own)
            jacobian[:, :, columns.standoffs[contact.recording.name]] += sign * away
    return world[0] - world[1], jacobian, pairs.places


def misses(contact: Contacts, chains: Mapping[str, Chain], state: ChainState) -> FloatArray:
    """Vectors (m, 3) between the places that met [m]."""
    T = [_pose(chains[name], contact, state) for name in contact.recording.chains]
    first, second = contact.choose(T, _standoff(contact, state)).places
    return _carry(T[0], first) - _carry(T[1], second)


def _standoff(contact: Contacts, state: ChainState) -> float:
    return state.standoffs.get(contact.recording.name, 0.0)


def _pose(chain: Chain, contact: Contacts, state: ChainState) -> FloatArray:
    return chain.frames(contact.recording.angles, state.offsets) @ state.mounts[chain.name]


def _carry(T: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("mij,mj->mi", T[:, :3, :3], points) + T[:, :3, 3])

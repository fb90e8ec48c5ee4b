"""Simulated self-touch of the iCub: two soft skins, or a fingertip, pressed together.

What a taxel feels is how deep it lies below the other surface, as the taxels of that side and
their normals shape it, times a gain of its own: contacts have the shape of both bodies, and
neither their middles nor any taxels coincide. The joints' zeros are off, and some taxels are dead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.robot_chains import robot_chain
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.skin.joints import common_ancestor
from skinmap.skin.robot import Robot

GAIN = 0.25  # spread of the taxels' gains
DEAD = 0.1  # share of taxels that feel nothing
COUNTS = 40e3  # of a taxel a metre below the other surface: 4 mm are 160
FELT = 12  # counts above which a taxel counts as touched
DEPTH = (1.5e-3, 5e-3)  # how far two soft skins are pressed into each other [m]
BALL = 7e-3  # radius of a fingertip [m]
FOAM = 4e-3  # how far round a fingertip the skin gives way with it [m]
NEAR, REACH = 8, 12e-3  # taxels that shape a surface, and how far beside them it ends [m]
FACING = -0.8  # cosine between the normals of two skins that touch
STEPS, DAMPING = 60, 1e-4


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """One side of a touch: its chain with the true mount, and the gains (n,) of its taxels.

    A fingertip has one place, the middle of its ball, and no normals.
    """

    chain: Chain
    gains: FloatArray

    @property
    def normals(self) -> FloatArray:
        """In the link."""
        return transform_directions(self.chain.mount, self.chain.normals)

    @property
    def places(self) -> FloatArray:
        """In the link [m]."""
        own = self.chain.taxels if len(self.chain.taxels) else np.zeros((1, 3))
        return transform_points(self.chain.mount, own)


def patch_body(
    robot: Robot, part: str, joints: Sequence[str], base: str, rng: np.random.Generator,
    *, mount: FloatArray | None = None,
) -> Body:  # fmt: skip
    """A part of a robot, ids by channel; gains spread, some dead.

    It is where the manifest says, or moved from there by `mount` (4, 4) in its link.
    """
    skin = robot.skin(part)
    size = int(skin.channels.max()) + 1
    taxels, normals = np.full((2, size, 3), np.nan)
    taxels[skin.channels], normals[skin.channels] = skin.positions, skin.normals
    chain = robot_chain(
        robot,
        skin.link,
        joints,
        base=base,
        name=part,
        mount=mount,
        taxels=taxels,
        normals=normals,
    )
    gains = np.exp(rng.normal(0.0, GAIN, size)) * (rng.random(size) > DEAD)
    return Body(chain, gains)


def fingertip(
    robot: Robot, name: str, link: str, tip: FloatArray, joints: Sequence[str], base: str
) -> Body:
    """A fingertip without taxels, its middle at `tip` (3,) of the link [m]."""
    mount = np.eye(4)
    mount[:3, 3] = tip
    chain = robot_chain(robot, link, joints, base=base, name=name, mount=mount)
    return Body(chain, np.zeros(0))


def poses(
    robot: Robot, joints: Sequence[str], one: Body, other: Body, m: int, rng: np.random.Generator
) -> FloatArray:
    """Angles (m, joints) in which some taxel of one side is pressed into one of the other."""
    limits = np.array([robot.body.joints[name] for name in joints]).clip(-3.0, 3.0)
    found = np.zeros((0, len(joints)))
    for _ in range(60):
        angles = _search(limits, one, other, 4 * m, rng)
        found = np.concatenate([found, angles[_fits(one, other, angles)]])
        if len(found) >= m:
            return found[:m]
    raise RuntimeError(f"{one.chain.name} hardly reaches {other.chain.name}")


def _inner(body: Body, m: int, rng: np.random.Generator) -> IntArray:
    """Taxels with others all round them."""
    known = np.flatnonzero(np.isfinite(body.chain.taxels).all(axis=1))
    around = KDTree(body.chain.taxels[known])
    count = np.array([len(near) for near in around.query_ball_point(around.data, REACH)])
    return np.asarray(rng.choice(known[count >= np.percentile(count, 30)], m))


def _search(
    limits: FloatArray, one: Body, other: Body, m: int, rng: np.random.Generator
) -> FloatArray:
    """Damped steps from random angles to one point and opposed normals."""
    ball = one.chain.is_probe
    q = _inner(other, m, rng)
    depth = rng.uniform(*DEPTH, m)[:, None] - (BALL if ball else 0.0)
    p = np.zeros(m, np.int64) if ball else _inner(one, m, rng)
    angles = rng.uniform(*limits.T, (m, len(limits)))
    for _ in range(STEPS):
        (x, nx, slope_x, turned_x), (y, ny, slope_y, turned_y) = (
            _state(body, angles, rows) for body, rows in ((one, p), (other, q))
        )
        miss = x - (y - depth * ny)
        J = slope_x - slope_y
        if not ball:
            miss = np.concatenate([miss, 0.03 * (nx + ny)], axis=1)
            J = np.concatenate([J, 0.03 * (turned_x + turned_y)], axis=1)
        square = J @ J.transpose(0, 2, 1) + DAMPING * np.eye(J.shape[1])
        step = J.transpose(0, 2, 1) @ np.linalg.solve(square, miss[..., None])
        angles = np.clip(angles - np.clip(step[..., 0], -0.3, 0.3), *limits.T)
    good = np.linalg.norm(miss[:, :3], axis=1) < 1.5e-3
    if not ball:
        good &= (nx * ny).sum(axis=1) < FACING
    return angles[good]


def _state(
    body: Body, angles: FloatArray, rows: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Place and normal (m, 3) of a taxel in each pose, and how the angles move them."""
    T, axes, origins = body.chain.motion(angles)
    x = np.einsum("mij,mj->mi", T[:, :3, :3], body.places[rows]) + T[:, :3, 3]
    slope, turned = np.zeros((2, len(angles), 3, angles.shape[1]))
    normal = np.zeros_like(x)
    if len(body.normals):
        normal = np.einsum("mij,mj->mi", T[:, :3, :3], body.normals[rows])
    for column, axis, own in zip(
        body.chain.joints.tolist(), axes, body.chain.slopes(axes, origins, x), strict=True
    ):
        slope[:, :, column] += own
        turned[:, :, column] += np.cross(axis, normal)
    return x, normal, slope, turned


def _fits(one: Body, other: Body, angles: FloatArray) -> FloatArray:
    """Poses in which nothing of the two skins lies deeper than a soft skin gives way."""
    deepest = [
        max(float(own.max(initial=0.0)) for own in _depths(one, other, A, B))
        for A, B in zip(one.chain.frames(angles), other.chain.frames(angles), strict=True)
    ]
    most = DEPTH[1] + (FOAM if one.chain.is_probe else 2e-3)
    return np.asarray((np.array(deepest) > 1e-3) & (np.array(deepest) < most))


def _depths(one: Body, other: Body, A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How deep (n,) the taxels of each side lie below the other's surface [m]."""
    there = np.linalg.inv(B) @ A
    if one.chain.is_probe:
        middle = transform_points(there, one.places)[0]
        gap = np.linalg.norm(other.places - middle, axis=1)
        return np.zeros(0), np.nan_to_num(np.maximum(BALL + FOAM - gap, 0.0))
    first = _below(transform_points(there, one.places), other)
    return first, _below(transform_points(np.linalg.inv(there), other.places), one)


def _below(points: FloatArray, body: Body) -> FloatArray:
    """Depth (n,) of points below the surface that the nearest taxels and normals make."""
    places = body.places
    known = np.flatnonzero(np.isfinite(places).all(axis=1))
    fine = np.isfinite(points).all(axis=1)
    gap, near = KDTree(places[known]).query(points[fine], k=NEAR)
    rows = known[near]
    heights = ((points[fine][:, None] - places[rows]) * body.normals[rows]).sum(axis=2)
    weight = np.exp(-((gap / (0.5 * REACH)) ** 2)) + 1e-300
    height = (weight * heights).sum(axis=1) / weight.sum(axis=1)
    beside = np.sqrt(np.maximum(gap[:, 0] ** 2 - height**2, 0.0))
    depth = np.zeros(len(points))
    depth[fine] = np.where((beside < 0.6 * REACH) & (height > -0.03), -height, 0.0)
    return np.maximum(depth, 0.0)


def record(
    one: Body, other: Body, angles: FloatArray, offsets: FloatArray, rng: np.random.Generator,
    *, name: str = "",
) -> TouchRecording:  # fmt: skip
    """What both sides feel in poses, and the angles as read by encoders that `offsets` are off."""
    felt: list[list[IntArray]] = [[], []]
    for A, B in zip(one.chain.frames(angles), other.chain.frames(angles), strict=True):
        for side, body, depth in zip(felt, (one, other), _depths(one, other, A, B), strict=True):
            counts = body.gains * COUNTS * depth + rng.normal(0.0, 1.5, len(depth))
            side.append(np.flatnonzero(counts > FELT))
    read = angles - offsets + rng.normal(0.0, np.deg2rad(0.02), angles.shape)
    return TouchRecording(
        name or f"{one.chain.name}-{other.chain.name}",
        (one.chain.name, other.chain.name),
        read,
        (None if one.chain.is_probe else felt[0], felt[1]),
    )


def planted(
    robot: Robot, part: str, rng: np.random.Generator, distance: float, angle: float
) -> FloatArray:
    """(4, 4) that moves a part by a distance [m] in its link and turns it about its middle."""
    turn, move = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    middle = robot.skin(part).positions.mean(axis=0)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(angle * turn).as_matrix()
    T[:3, 3] = middle - T[:3, :3] @ middle + distance * move
    return T


def assumed(chain: Chain) -> Chain:
    """The chain as the manifest has it; of a probe nobody knows the tip."""
    return replace(chain, mount=np.eye(4))


def base_of(robot: Robot, links: Sequence[str]) -> str:
    """The deepest link that all hang on."""
    return common_ancestor(robot.body.tree, links)

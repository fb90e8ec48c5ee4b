"""Rows of self-touch: a simulated iCub whose patches and joints are off, and a control.

Stated errors are held against true ones: the normalised error squared is 1 where they agree. The
control gives each touch the pose of another: it must not come out `ok`.

What a taxel feels is how deep it lies below the other surface, as the taxels of that side and
their normals shape it, times a gain of its own: contacts have the shape of both bodies, and
neither their middles nor any taxels coincide. The joints' zeros are off, and some taxels are dead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import KDTree

import skinmap
from benchmarks.calibration.links import counted, displaced, normalised
from calibration.commands.self_touch_words import judge
from calibration.files.self_touch_files import SelfTouchData
from calibration.mount.chains import Chain, TouchRecording, robot_chain
from calibration.mount.skin_contacts import SelfTouchFit, known_taxels, self_touch, taxel_covariance
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import rigid_transform, transform_directions, transform_points
from skinmap.skin.robot import Robot, common_ancestor

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
        robot, skin.link, joints, base=base, name=part, mount=mount, taxels=taxels, normals=normals
    )
    gains = np.exp(rng.normal(0.0, GAIN, size)) * (rng.random(size) > DEAD)
    return Body(chain, gains)


def fingertip(
    robot: Robot, name: str, link: str, tip: FloatArray, joints: Sequence[str], base: str
) -> Body:
    """A fingertip without taxels, its middle at `tip` (3,) of the link [m]."""
    mount = rigid_transform(np.eye(3), tip)
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
    one: Body, other: Body, angles: FloatArray, offsets: FloatArray, rng: np.random.Generator
) -> TouchRecording:
    """What both sides feel in poses, and the angles as read by encoders that `offsets` are off."""
    felt: list[list[IntArray]] = [[], []]
    for A, B in zip(one.chain.frames(angles), other.chain.frames(angles), strict=True):
        for side, body, depth in zip(felt, (one, other), _depths(one, other, A, B), strict=True):
            counts = body.gains * COUNTS * depth + rng.normal(0.0, 1.5, len(depth))
            side.append(np.flatnonzero(counts > FELT))
    read = angles - offsets + rng.normal(0.0, np.deg2rad(0.02), angles.shape)
    return TouchRecording(
        f"{one.chain.name}-{other.chain.name}",
        (one.chain.name, other.chain.name),
        read,
        (None if one.chain.is_probe else felt[0], felt[1]),
    )


def assumed(chain: Chain) -> Chain:
    """The chain as the manifest has it; of a probe nobody knows the tip."""
    return replace(chain, mount=np.eye(4))


SHOULDER = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_prosup")
JOINTS = tuple(
    f"{side}_{joint}" for side in "lr" for joint in (*SHOULDER, "wrist_pitch", "wrist_yaw")
)
FINGER, HAND, TIP = "right_finger", "r_hand", np.array([-0.12, -0.015, 0.01])
LEFT, RIGHT = "left_forearm", "right_forearm"
CORNER = "fingertip on a corner of a forearm"  # what must not come out `ok`
MOVED, TURNED, ZEROS = 20e-3, np.deg2rad(10.0), np.deg2rad(0.5)  # what is planted
TOUCHES, TRIALS = 150, 20
Pair = tuple[str, str]
CASES: tuple[tuple[str, tuple[Pair, ...], tuple[str, ...], bool], ...] = (
    ("forearms, one unknown", ((RIGHT, LEFT),), (LEFT,), True),
    ("forearms, both unknown", ((RIGHT, LEFT),), (LEFT, RIGHT), True),
    ("fingertip on a forearm", ((FINGER, LEFT),), (LEFT,), True),
    ("fingertip and forearms, both unknown", ((RIGHT, LEFT), (FINGER, LEFT)), (LEFT, RIGHT), True),
    ("the same, joints taken as they are", ((RIGHT, LEFT), (FINGER, LEFT)), (LEFT, RIGHT), False),
    (CORNER, ((FINGER, LEFT),), (LEFT,), True),
)  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class World:
    """A robot as it is: bodies where they truly are, and what was recorded on it."""

    robot: Robot
    bodies: dict[str, Body]
    recordings: list[TouchRecording]

    def data(self) -> SelfTouchData:
        """What a command would be given."""
        names = {name for one in self.recordings for name in one.chains}
        chains = {name: assumed(self.bodies[name].chain) for name in sorted(names)}
        return SelfTouchData(self.recordings, chains, JOINTS, self.robot.name)


def world(
    robot: Robot,
    pairs: Sequence[Pair],
    moved: Sequence[str],
    rng: np.random.Generator,
    *,
    touches: int = TOUCHES,
) -> World:
    """Patches off by 20 mm and 10 degrees, zeros of joints by half a degree, touched in poses."""
    names = sorted({name for pair in pairs for name in pair})
    links = [HAND if name == FINGER else robot.part(name).link for name in names]
    base = common_ancestor(robot.body.tree, links)
    bodies = {}
    for name in names:
        if name == FINGER:
            bodies[name] = fingertip(robot, name, HAND, TIP, JOINTS, base)
        else:
            middle = robot.skin(name).positions.mean(axis=0)
            T = displaced(middle, rng, TURNED, MOVED) if name in moved else None
            bodies[name] = patch_body(robot, name, JOINTS, base, rng, mount=T)
    offsets = rng.normal(0.0, ZEROS, len(JOINTS))
    recordings = [
        record(bodies[a], bodies[b], poses(robot, JOINTS, bodies[a], bodies[b], touches, rng),
               offsets, rng)
        for a, b in pairs
    ]  # fmt: skip
    return World(robot, bodies, recordings)


def simulated_rows(trials: int = TRIALS) -> list[dict[str, Any]]:
    """Error against truth beside stated error, and the control, for each case."""
    robot = skinmap.load_robot("icub")
    rows = []
    for case, pairs, unknown, joints in CASES:
        runs = []
        for trial in range(trials):
            rng = np.random.default_rng([trial, 7])
            made = world(robot, pairs, unknown, rng)
            if case == CORNER:
                made = replace(made, recordings=[cornered(made, one) for one in made.recordings])
            runs.append(_run(made, unknown, joints, rng))
        rows.append(_row(case, runs))
    return rows


def cornered(made: World, touches: TouchRecording) -> TouchRecording:
    """The fifth of the touches that lie nearest to one corner of the patch."""
    taxels = made.bodies[touches.chains[1]].chain.taxels
    felt = touches.touched[1] or ()
    middles = np.array([taxels[ids].mean(axis=0) for ids in felt if len(ids)])
    known = np.array([len(ids) > 0 for ids in felt])
    gap = np.full(len(touches), np.inf)
    gap[known] = np.linalg.norm(middles - np.nanmin(taxels, axis=0), axis=1)
    return touches.subset(gap <= np.quantile(gap, 0.2))


def _run(
    made: World, unknown: Sequence[str], joints: bool, rng: np.random.Generator
) -> dict[str, Any]:
    data = made.data()
    fit = _fit(data, unknown, joints, rng)
    # The control: each touch has the pose of another.
    mixed = [replace(one, angles=one.angles[rng.permutation(len(one))]) for one in data.recordings]
    wrong = replace(data, recordings=mixed)
    return {
        "status": _status(data, fit),
        "control": _status(wrong, _fit(wrong, unknown, joints, rng)),
        "taxels": [_errors(made.bodies[name].chain, fit) for name in unknown],
    }


def _status(data: SelfTouchData, fit: SelfTouchFit) -> str:
    judged = judge(data, fit, ())
    return str(judged[0][0]) if judged else "ok"


def _fit(
    data: SelfTouchData, unknown: Sequence[str], joints: bool, rng: np.random.Generator
) -> SelfTouchFit:
    return self_touch(
        data.recordings, data.chains, calibrate=unknown, joint_offsets=joints, rng=rng
    )


def _errors(truth: Chain, fit: SelfTouchFit) -> tuple[FloatArray, FloatArray, float]:
    """Errors (n,) and stated errors (n,) of a patch's taxels [m], and the normalised one."""
    mount, taxels = fit.mounts[truth.name], known_taxels(truth)
    missed = transform_points(mount, taxels) - transform_points(truth.mount, taxels)
    covariance = taxel_covariance(truth, mount, fit.covariances[truth.name])
    stated = np.sqrt(np.einsum("nii->n", covariance))
    return np.linalg.norm(missed, axis=1), stated, normalised(missed, covariance)


def _row(case: str, runs: list[dict[str, Any]]) -> dict[str, Any]:
    every = [own for run in runs for own in run["taxels"]]
    return {
        "evidence": "simulated self-touch",
        "case": case,
        "truth": f"patches of the iCub off by {1e3 * MOVED:.0f} mm and "
        f"{np.rad2deg(TURNED):.0f} deg, joints by {np.rad2deg(ZEROS):.1f} deg (simulated)",
        "runs": len(runs),
        "touches": TOUCHES,
        "error_mm": {
            "median": float(np.median([1e3 * np.median(one[0]) for one in every])),
            "p95": float(np.median([1e3 * np.percentile(one[0], 95) for one in every])),
        },
        "stated_mm": float(np.median([1e3 * np.median(one[1]) for one in every])),
        "normalised_error_squared": float(np.mean([one[2] for one in every])),
        "statuses": counted(run["status"] for run in runs),
        "control_ok": sum(run["control"] == "ok" for run in runs),
    }

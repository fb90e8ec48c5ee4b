"""Laws of patches that are mounted by pairs of points, by wrenches and by self-touch."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.rigid_mount import fit_mount, fit_wrench
from calibration.mount.skin_contacts import SelfTouchFit, self_touch
from skinmap.errors import InvalidArrayError
from skinmap.geometry.rigid import transform_points

from .law import Law, Outside
from .shapes import PITCH

Arrays = tuple[np.ndarray, ...]
ARM = np.array(
    [[0, 0.1, -np.pi / 2, 0], [0, 0, np.pi / 2, 0], [0.02, 0.12, -np.pi / 2, 0],
     [0, 0, np.pi / 2, 0], [0, 0.1, -np.pi / 2, 0], [0.03, 0, 0.3, 0]]
)  # fmt: skip
REACH = 12e-3  # of a contact [m]


def pose(turn: list[float], place: list[float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), place
    return T


MOUNT = pose([0.4, -0.8, 1.1], [0.05, 0.1, -0.02])


@cache
def presses(count: int = 40) -> Arrays:
    """Points of a bent patch (m, 3), frames (m, 4, 4), and the points where they are (m, 3)."""
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(-0.8, 0.8, count), rng.uniform(-0.06, 0.06, count)
    points = np.column_stack([0.05 * np.sin(angle), height, 0.05 * (np.cos(angle) - 1)])
    frames = np.tile(np.eye(4), (count, 1, 1))
    frames[:, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
    frames[:, :3, 3] = rng.normal(0, 0.1, (count, 3))
    there = transform_points(MOUNT, points)
    return points, frames, np.einsum("mij,mj->mi", frames[:, :3, :3], there) + frames[:, :3, 3]


def mount_off(scale: float = 1.0, sigma: float = 0.0, count: int = 40) -> float:
    """How far the patch lies from where it is, in its own width of 0.1 m."""
    points, frames, targets = presses(count)
    frames = frames.copy()
    frames[:, :3, 3] *= scale
    spoilt = targets + sigma * np.random.default_rng(1).normal(size=targets.shape)
    found = fit_mount(scale * points, frames, scale * spoilt)
    apart = transform_points(found.mount, scale * points) / scale - transform_points(MOUNT, points)
    return float(np.abs(apart).max() / 0.1)


def wrench(newtons: float = 5.0, wrong: float = 0.0, count: int = 40) -> Arrays:
    """Points, frames, forces and moments of presses with so much force."""
    points, frames, targets = presses(count)
    rng = np.random.default_rng(2)
    forces = rng.normal(size=(count, 3))
    forces *= newtons / np.linalg.norm(forces, axis=1, keepdims=True)
    moments = np.cross(targets, forces)
    moments[rng.random(count) < wrong] += 0.5
    return points, frames, forces, moments


def wrench_off(data: Arrays) -> float:
    """Largest error of a point of the patch [mm]."""
    apart = transform_points(fit_wrench(*data).mount, data[0]) - transform_points(MOUNT, data[0])
    return float(1e3 * np.linalg.norm(apart, axis=1).max())


def parallel() -> object:
    points, frames, forces, _ = wrench()
    forces = np.einsum("mij,j->mi", frames[:, :3, :3], [0.0, 0.0, 5.0])
    return fit_wrench(points, frames, forces, np.cross(presses()[2], forces))


def sheet(radius: float) -> np.ndarray:
    """14 x 14 taxels on a piece of a cylinder."""
    u, v = (PITCH * (k - 7.0) for k in np.meshgrid(*[np.arange(14)] * 2))
    places = [radius * np.sin(u / radius), v, radius * (np.cos(u / radius) - 1)]
    return np.stack(places, axis=-1).reshape(-1, 3)


@cache
def body() -> dict[str, Chain]:
    """An arm and a chest, each with a patch where it truly is."""
    still, none = np.zeros((0, 4)), np.zeros(0, int)
    return {
        "arm": Chain.from_dh(
            "arm", ARM, np.arange(6), pose([0.2, 1.4, 0.3], [0.02, 0.01, 0.05]), sheet(0.05)
        ),
        "chest": Chain.from_dh("chest", still, none, pose([0, 0, 0.1], [0.2, 0, 0.1]), sheet(0.1)),
    }


@cache
def met(count: int = 120) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles in which a taxel of the arm lies on one of the chest, by Newton's steps; and both."""
    rng, arm, chest = np.random.default_rng(1), body()["arm"], body()["chest"]
    inner = np.arange(196).reshape(14, 14)[2:-2, 2:-2].ravel()
    own, other = np.tile(inner[rng.integers(len(inner), size=(2, count))], (1, 4))
    wanted = transform_points(chest.mount, chest.taxels[other])
    angles = rng.uniform(-1.0, 1.0, (4 * count, 6))
    for _ in range(40):
        T, axes, origins = arm.motion(angles)
        T = T @ arm.mount
        x = np.einsum("mij,mj->mi", T[:, :3, :3], arm.taxels[own]) + T[:, :3, 3]
        slope = np.stack([np.cross(a, x - o) for a, o in zip(axes, origins, strict=True)], 2)
        square = slope @ slope.transpose(0, 2, 1) + 1e-6 * np.eye(3)
        step = slope.transpose(0, 2, 1) @ np.linalg.solve(square, (wanted - x)[..., None])
        angles = angles + np.clip(step, -0.3, 0.3)[..., 0]
    there = (np.linalg.norm(wanted - x, axis=1) < 1e-6) & (np.abs(angles).max(axis=1) < 3)
    rows = np.flatnonzero(there)[:count]
    return angles[rows], own[rows], other[rows]


def fitted(
    angle: float = 0.3, distance: float = 0.02, dead: float = 0.0, noise: float = 0.0,
    count: int = 120,
) -> SelfTouchFit:  # fmt: skip
    """The arm's mount from a start so far off, some taxels silent, angles with noise [rad]."""
    chains, (angles, own, other) = body(), met()
    rng = np.random.default_rng(3)
    angles = (angles + noise * rng.normal(size=angles.shape))[:count]
    felt = []
    for chain, middle in ((chains["arm"], own), (chains["chest"], other)):
        gap = np.linalg.norm(chain.taxels[middle[:count], None] - chain.taxels[None], axis=2)
        silent = rng.random(len(chain.taxels)) < dead
        silent[middle] = False  # each touch is felt by one at least
        felt.append([np.flatnonzero(row) for row in (gap < REACH) & ~silent])
    arm = chains["arm"]
    T = arm.mount @ pose([0.0, 0.0, 0.0], [0.6 * distance, 0.8 * distance, 0.0])
    T[:3, :3] = Rotation.from_rotvec([0, 0.6 * angle, 0.8 * angle]).as_matrix() @ T[:3, :3]
    given = chains | {"arm": replace(arm, mount=T)}
    one = TouchRecording("r", ("arm", "chest"), angles, (felt[0], felt[1]))
    return self_touch([one], given, calibrate=["arm"], rng=np.random.default_rng(0))


def self_touch_off(found: SelfTouchFit) -> float:
    """Root mean square error of the arm's taxels [mm]."""
    arm = body()["arm"]
    apart = transform_points(found.mounts["arm"], arm.taxels)
    apart -= transform_points(arm.mount, arm.taxels)
    return float(1e3 * np.sqrt(np.mean(np.sum(apart**2, axis=1))))


DEPTH = "the middle of a bent contact lies 0.7 mm below the skin"
LAWS = [
    Law("fit_mount", "scale", "a planted mount comes back, in widths", mount_off, 1e-9, "rounding",
        (1e-6, 1e-3, 1.0, 1e3, 1e6)),
    Law("fit_mount", "noise", "error in widths", lambda s: mount_off(sigma=1e-3 * s), 0.1,
        "5 mm, by 40 pairs, at a corner: 5 sqrt(6 / 40 * 3) = 3.4 mm and half as much again",
        (0.0, 1.0, 5.0), unit="mm"),
    Law("fit_mount", "size", "a planted mount comes back, in widths",
        lambda n: mount_off(count=n), 1e-9, "rounding", (3, 10, 1000),
        (Outside("2 pairs", InvalidArrayError, lambda: mount_off(count=2), "at least 3"),),
        "pairs"),
    Law("fit_wrench", "scale", "a planted mount comes back, in mm",
        lambda f: wrench_off(wrench(f)), 1e-3, "steps end at a micrometre",
        (0.06, 1.0, 5.0, 100.0),
        (Outside("0.01 N", InvalidArrayError, lambda: fit_wrench(*wrench(0.01)), "below 0.05 N"),
         Outside("parallel", InvalidArrayError, parallel, "slide along")), "N"),
    Law("fit_wrench", "outliers", "a planted mount comes back, in mm",
        lambda s: wrench_off(wrench(wrong=s)), 1.0,
        "a robust loss weighs far ones little, not nothing", (0.0, 0.1, 0.3),
        unit="of the touches"),
    Law("fit_wrench", "size", "a planted mount comes back, in mm",
        lambda n: wrench_off(wrench(count=n)), 1e-3, "steps end at a micrometre", (6, 40, 400),
        (Outside("5 lines", InvalidArrayError, lambda: fit_wrench(*wrench(count=5)), "least 6"),),
        "touches"),
    Law("self_touch", "start", "error of the taxels in mm",
        lambda s: self_touch_off(fitted(np.radians(s), s * 1e-3)), 1.2, DEPTH,
        (0.0, 30.0, 100.0), unit="mm and degrees away"),
    Law("self_touch", "dead taxels", "error of the taxels in mm",
        lambda s: self_touch_off(fitted(dead=s)), 2.0, DEPTH + ", and less evenly",
        (0.0, 0.1, 0.3), unit="of the taxels"),
    Law("self_touch", "noise", "error of the taxels in mm",
        lambda s: self_touch_off(fitted(noise=np.radians(s))), 3.0,
        "half a degree at 0.4 m is 3.5 mm a touch", (0.0, 0.2, 0.5), unit="degrees of each joint"),
    Law("self_touch", "size", "error of the taxels in mm",
        lambda n: self_touch_off(fitted(count=n)), 2.0, DEPTH + ", and less evenly", (24, 120),
        (Outside("11 touches", InvalidArrayError, lambda: fitted(count=11), "at least 12"),),
        "touches"),
]  # fmt: skip

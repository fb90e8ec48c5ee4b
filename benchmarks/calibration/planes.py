"""Simulated presses of a robot's skin on a table, not made by what the calibration assumes.

The skin is soft: what one taxel is pressed in is felt by those around it, too. Each taxel has a
gain (spread 25 %), a threshold of its own and noise, some are dead, readings are whole counts. The
robot moves until it is stopped at a depth that differs from press to press; table and arm give way
by 1 mm. The calibration knows of a logistic curve only.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from benchmarks.calibration.links import counted, displaced, normalised
from benchmarks.harness.timing import timed
from calibration.mount.chains import Chain, robot_chain
from calibration.plane.fit import PlaneFit, fit_plane
from calibration.plane.model import Plane, PlaneContacts
from calibration.plane.poses import Obstacle, Pressing, candidates, pressing_poses
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_points
from skinmap.io.robots.manifest import load_robot
from skinmap.skin.robot import Robot

TORSO = ("torso_pitch", "torso_roll", "torso_yaw")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_prosup")
HAND = ("wrist_pitch", "wrist_yaw")
LINKS = ("shoulder_3", "upper_arm", "elbow_1", "forearm", "wrist_1", "hand")
SPREAD = 3e-3  # how far a press is felt to its sides [m]
COUNTS = 20.0  # a millimetre
NOISE = 1.5  # counts
GAINS = 0.25
THRESHOLDS = (4.0, 12.0)  # counts
DEPTHS = (1.5e-3, 4e-3)
# A point, the normal, how far the height varies [m] and the tilt: where the part reaches the table
# with most of its skin while hand and arm stay off it (of 60 and 80 planes tried at random).
TABLES = {
    "right_forearm": ((-0.2, 0.2, -0.07), (0.0, 0.0, 1.0), 0.05, np.deg2rad(15.0)),
    "right_arm": ((0.06, 0.2, 0.18), (-0.42, -0.21, 0.89), 0.002, np.deg2rad(0.5)),
}
FLEX = np.deg2rad(0.01)  # of a joint's reading, from press to press


@dataclass(frozen=True, eq=False, slots=True)
class Setting:
    """What is off, and by how much: standard deviations, if nothing else is said."""

    mount_shift: float = 20e-3  # exactly [m]
    mount_turn: float = np.deg2rad(10.0)  # exactly
    joints: float = np.deg2rad(0.5)
    contact: float = 1e-3  # of the table's height from press to press [m]
    taxel: float = 0.5e-3  # of the depth at which a taxel is pressed, from press to press [m]
    modules: float = 0.0  # of a module along each axis [m]
    shape: float = 0.0  # of a taxel along each axis [m]
    dead: float = 0.03  # share of taxels
    torso: bool = True  # whether it moves


FOREARM = "forearm"
CASES: tuple[tuple[str, str, int, Setting, dict[str, bool]], ...] = (
    *((FOREARM, "right_forearm", count, Setting(), {}) for count in (5, 10, 20, 40)),
    ("forearm, plane known", "right_forearm", 40, Setting(), {"known": True}),
    ("forearm, modules off by 0.6 mm", "right_forearm", 40, Setting(modules=0.6e-3), {}),
    ("forearm, modules off by 1 mm", "right_forearm", 40, Setting(modules=1e-3), {}),
    ("forearm, taxels off by 0.5 mm", "right_forearm", 40, Setting(shape=0.5e-3), {}),
    ("upper arm, torso still", "right_arm", 40, Setting(torso=False), {}),
    ("forearm, poses shuffled", "right_forearm", 40, Setting(), {"shuffled": True}),
)
FIRST, BATCH = 8, 4  # presses at random, and proposed at once
MM = 1e3


@dataclass(eq=False)
class Bench:
    """One robot's part with its true places, a table, and what the robot believes."""

    robot: Robot
    part: str
    setting: Setting
    rng: np.random.Generator
    plane: Plane = field(default_factory=lambda: Plane(np.array([-0.25, 0.1, 0.0]), np.eye(3)[2]))

    def __post_init__(self) -> None:
        skin, rng, off = self.robot.skin(self.part), self.rng, self.setting
        side = skin.link[:1]
        own = (*TORSO, *(f"{side}_{joint}" for joint in (*ARM, *HAND)))
        self.joints = own
        self.limits = np.array([self.robot.body.joints[joint] for joint in own])
        if not off.torso:
            self.limits[: len(TORSO)] = 0.0
        self.chain = robot_chain(self.robot, skin.link, own, name=self.part, taxels=skin.positions)
        self.normals, self.modules = skin.normals, skin.modules
        middle = skin.positions.mean(axis=0)
        self.mount = displaced(middle, rng, off.mount_turn, off.mount_shift)
        _, group = np.unique(skin.modules, return_inverse=True)
        shape = skin.positions + rng.normal(0, off.modules, (group.max() + 1, 3))[group]
        shape = shape + rng.normal(0, off.shape, shape.shape)
        self.places = transform_points(self.mount, shape)  # in the link
        self.offsets = rng.normal(0, off.joints, len(own))
        n = len(self.places)
        self.gains = np.exp(rng.normal(0, GAINS, n))
        self.thresholds = rng.uniform(*THRESHOLDS, n)
        self.thresholds[rng.random(n) < off.dead] = np.inf
        apart = np.linalg.norm(self.places[:, None] - self.places[None], axis=2)
        self.spreading = np.exp(-((apart / SPREAD) ** 2))
        self.obstacles = obstacles(self.robot, self.part, own, side)

    def drawn(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Poses at random of a person who sees the table, as the robot reads them."""
        found: list[FloatArray] = []
        while sum(map(len, found)) < count:
            found.append(
                pressing_poses(
                    self.chain, self.normals, self.plane, self.limits, depth=2e-3,
                    count=600, obstacles=self.obstacles, rng=rng,
                )
            )  # fmt: skip
            if len(found) > 200:
                raise ValueError(f"{self.part} cannot be pressed on this table")
        return np.concatenate(found)[:count]

    def press(self, angles: FloatArray) -> PlaneContacts:
        """What is read when the robot presses in some poses (m, joints)."""
        rng, off = self.rng, self.setting
        m = len(angles)
        depth = rng.uniform(*DEPTHS, m)
        flex = rng.normal(0, FLEX, angles.shape)
        true = replace(self.chain, mount=np.eye(4), taxels=self.places)
        read = angles.copy()
        give = rng.normal(0, off.contact, m)
        for _ in range(30):  # until the robot is stopped by the table
            s, lowest, slopes = _lowest(true, self.plane, read + self.offsets + flex)
            missed = -depth - (s[np.arange(m), lowest] + give)
            step = np.zeros_like(read)
            step[:, self.chain.joints] = slopes * (missed / np.sum(slopes**2, axis=1))[:, None]
            read = read + np.clip(step, -0.1, 0.1)
        s = _lowest(true, self.plane, read + self.offsets + flex)[0] + give[:, None]
        pressed = np.maximum(0.0, -s + rng.normal(0, off.taxel, s.shape))
        felt = 1e3 * COUNTS * (pressed @ self.spreading) / 2.0
        counts = np.rint(np.clip(self.gains * felt + rng.normal(0, NOISE, s.shape), 0, 255))
        felt_it = (counts > self.thresholds).any(axis=1)
        read, counts = read[felt_it], counts[felt_it]
        return PlaneContacts(read, {self.part: counts > self.thresholds})


def _lowest(
    chain: Chain, plane: Plane, angles: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Heights (m, n) above the plane, the lowest taxel (m,), its slopes (m, j) to the joints."""
    T, axes, origins = chain.motion(angles)
    x = np.einsum("mij,nj->mni", T[:, :3, :3], chain.taxels) + T[:, None, :3, 3]
    s = plane.height(x)
    lowest = s.argmin(axis=1)
    point = x[np.arange(len(x)), lowest]
    return s, lowest, (chain.slopes(axes, origins, point) @ plane.normal).T


def obstacles(robot: Robot, part: str, joints: Sequence[str], side: str) -> list[Obstacle]:
    """The arm, its hand, and what of the patch's own link is not skin."""
    skin, found = robot.skin(part), []
    for name in LINKS:
        link = f"{side}_{name}"
        points = robot.mesh(link).vertices
        if link == skin.link:
            points = points[cKDTree(skin.positions).query(points)[0] > 25e-3]
        if len(points) > 3:
            corners = points[ConvexHull(points).vertices]
            found.append(Obstacle(robot_chain(robot, link, joints), corners))
    return found


def bench(part: str, seed: int, setting: Setting | None = None) -> Bench:
    """The iCub beside a table at a random height, tilted at random."""
    rng = np.random.default_rng(seed)
    point, normal, rise, tilt = TABLES[part]
    turned = np.array(normal)
    turned[:2] += rng.uniform(-1, 1, 2) * np.tan(tilt)
    raised = np.array(point)
    raised[2] += rng.uniform(-rise, rise)
    plane = Plane(raised, turned)
    return Bench(load_robot("icub"), part, setting or Setting(), rng, plane)


def pressed(one: Bench, count: int) -> PlaneContacts:
    """Presses at random, as many as asked for; those that nobody felt are done again."""
    found = one.press(one.drawn(count, one.rng))
    while len(found) < count:
        found = found.joined(one.press(one.drawn(count - len(found), one.rng)))
    return found


def fitted(one: Bench, contacts: PlaneContacts, **how: Any) -> PlaneFit:
    """The calibration of a bench's part."""
    modules = {one.part: one.modules}
    return fit_plane(contacts, [one.chain], modules=modules, joint_names=one.joints, **how)


def chosen(one: Bench, stops: Sequence[int]) -> dict[int, tuple[PlaneContacts, PlaneFit]]:
    """So many presses, after the first eight as the calibration proposes them, and the fits."""
    contacts, found = pressed(one, FIRST), dict[int, tuple[PlaneContacts, PlaneFit]]()
    fit = fitted(one, contacts)
    setup = Pressing({one.part: one.chain}, {one.part: one.normals}, one.limits,
                     tuple(one.obstacles))  # fmt: skip
    pool, drawn_at = PlaneContacts(np.zeros((0, one.limits.shape[0])), {}), 0
    while len(contacts) < max(stops):
        if len(contacts) >= 1.5 * drawn_at:  # the plane is better known by now
            pool = candidates(setup, contacts, fit.mounts, fit.planes, one.rng)
            drawn_at = len(contacts)
        batch = min(BATCH if len(contacts) < 40 else 2 * BATCH, max(stops) - len(contacts))
        best = fit.next_contacts(pool, batch)
        contacts = contacts.joined(one.press(pool.angles[best.rows]))
        due = [stop for stop in stops if len(contacts) >= stop and stop not in found]
        fit = fitted(one, contacts, previous=None if due or len(contacts) <= 16 else fit)
        found |= dict.fromkeys(due, (contacts, fit))
    return found


def plane_rows(trials: int = 30) -> list[dict[str, Any]]:
    """Error, honesty, status and time for random and for chosen presses, and for what is wrong."""
    rows = []
    for name, part, count, setting, how in CASES:
        runs = []
        for trial in range(trials):
            one = bench(part, 1000 + trial, setting)
            contacts = pressed(one, count)
            if how.get("shuffled"):
                contacts = replace(contacts, angles=one.rng.permutation(contacts.angles))
            planes = [one.plane] if how.get("known") else None
            fit, seconds, _ = timed(partial(fitted, one, contacts, planes=planes))
            runs.append(_measured(one, fit, seconds))
        rows.append({"poses": "random", "contacts": count, "case": name} | _row(runs))
        print(rows[-1], file=sys.stderr, flush=True)
    stops: dict[int, list[dict[str, Any]]] = {40: [], 80: []}
    for trial in range(trials):
        one = bench("right_forearm", 1000 + trial, Setting())
        for stop, (_, fit) in chosen(one, list(stops)).items():
            stops[stop].append(_measured(one, fit, 0.0))
    for stop, runs in stops.items():
        row = _row(runs)
        del row["cpu_s"]
        rows.append({"poses": "chosen", "contacts": stop, "case": FOREARM} | row)
        print(rows[-1], file=sys.stderr, flush=True)
    return rows


def _measured(one: Bench, fit: PlaneFit, seconds: float) -> dict[str, Any]:
    """Taxels against where they are in the link, none of the nulls taken out."""
    error = fit.places[one.part] - one.places
    return {
        "p95": MM * float(np.percentile(np.linalg.norm(error, axis=1), 95)),
        "square": normalised(error, fit.place_covariances[one.part]),
        "status": str(fit.status),
        "seconds": seconds,
    }


def _row(runs: list[dict[str, Any]]) -> dict[str, Any]:
    statuses = counted(run["status"] for run in runs)
    p95, ok = [run["p95"] for run in runs], statuses.get("ok", 0)
    return {
        "trials": len(runs),
        "taxels_p95_mm": {"median": float(np.median(p95)), "p95": float(np.percentile(p95, 95))},
        "normalised_error_squared": float(np.mean([run["square"] for run in runs])),
        "observable": 2 * ok > len(runs),
        "ok": ok,
        "statuses": statuses,
        "cpu_s": float(np.median([run["seconds"] for run in runs])),
    }

"""Rows of self-touch: a simulated iCub whose patches and joints are off, and a control.

Stated errors are held against true ones: the normalised error squared is 1 where they agree. The
control gives each touch the pose of another: it must not come out `ok`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import skinmap
from benchmarks.calibration.self_touches import (
    Body,
    assumed,
    base_of,
    fingertip,
    patch_body,
    planted,
    poses,
    record,
)
from calibration.commands.self_touch_words import judge
from calibration.files.self_touch_files import SelfTouchData
from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.skin_contacts import SelfTouchFit, known_taxels, self_touch, taxel_covariance
from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_points
from skinmap.skin.robot import Robot

SHOULDER = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_prosup")
JOINTS = tuple(
    f"{side}_{joint}" for side in "lr" for joint in (*SHOULDER, "wrist_pitch", "wrist_yaw")
)
FINGER, HAND, TIP = "right_finger", "r_hand", np.array([-0.12, -0.015, 0.01])
LEFT, RIGHT = "left_forearm", "right_forearm"
CORNER = "fingertip on a corner of a forearm"  # what must not come out `ok`
MOVED, TURNED, ZEROS = 20e-3, np.deg2rad(10.0), np.deg2rad(0.5)  # what is planted
TOUCHES, POOL, TRIALS = 150, 600, 20
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
    base = base_of(robot, links)
    bodies = {}
    for name in names:
        if name == FINGER:
            bodies[name] = fingertip(robot, name, HAND, TIP, JOINTS, base)
        else:
            T = planted(robot, name, rng, MOVED, TURNED) if name in moved else None
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
    start = time.process_time()
    fit = self_touch(data.recordings, data.chains, calibrate=unknown, joint_offsets=joints, rng=rng)
    seconds = time.process_time() - start
    return {
        "seconds": seconds,
        "status": _status(data, fit),
        "control": _control(data, unknown, joints, rng),
        "held_out": 1e3 * fit.held_out,
        "taxels": [_errors(made.bodies[name].chain, fit) for name in unknown],
    }


def _status(data: SelfTouchData, fit: SelfTouchFit) -> str:
    judged = judge(data, fit, ())
    return str(judged[0][0]) if judged else "ok"


def _control(
    data: SelfTouchData, unknown: Sequence[str], joints: bool, rng: np.random.Generator
) -> str:
    """Status where each touch has the pose of another."""
    mixed = [replace(one, angles=one.angles[rng.permutation(len(one))]) for one in data.recordings]
    wrong = replace(data, recordings=mixed)
    fit = self_touch(mixed, data.chains, calibrate=unknown, joint_offsets=joints, rng=rng)
    return _status(wrong, fit)


def _errors(truth: Chain, fit: SelfTouchFit) -> tuple[FloatArray, FloatArray, float]:
    """Errors (n,) and stated errors (n,) of a patch's taxels [m], and the normalised one."""
    mount, taxels = fit.mounts[truth.name], known_taxels(truth)
    missed = transform_points(mount, taxels) - transform_points(truth.mount, taxels)
    covariance = taxel_covariance(truth, mount, fit.covariances[truth.name])
    square = np.einsum("ni,nij,nj->n", missed, np.linalg.inv(covariance), missed)
    stated = np.sqrt(np.einsum("nii->n", covariance))
    return np.linalg.norm(missed, axis=1), stated, float(square.mean() / 3)


def _row(case: str, runs: list[dict[str, Any]]) -> dict[str, Any]:
    every = [own for run in runs for own in run["taxels"]]
    statuses, controls = ([run[key] for run in runs] for key in ("status", "control"))
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
            "max": max(1e3 * float(np.median(one[0])) for one in every),
        },
        "stated_mm": float(np.median([1e3 * np.median(one[1]) for one in every])),
        "normalised_error_squared": float(np.mean([one[2] for one in every])),
        "held_out_mm": float(np.median([run["held_out"] for run in runs])),
        "statuses": {name: statuses.count(name) for name in sorted(set(statuses))},
        "control_ok": controls.count("ok"),
        "cpu_s": float(np.median([run["seconds"] for run in runs])),
    }

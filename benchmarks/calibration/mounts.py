"""Mounts from pairs, self-touch and wrenches; drift under a held press.

Rows say what they were measured against: a planted mount (simulated), or touches that a fit never
saw (recordings of a real robot, where they are at hand beside the checkout).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from benchmarks import ROOT
from benchmarks.calibration.self_touch_rows import simulated_rows
from calibration.files.part_files import load_part_touches
from calibration.files.self_touch_files import SelfTouchData
from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.rigid_mount import MountFit, fit_mount
from calibration.mount.robot_chains import robot_chain
from calibration.mount.skin_contacts import SelfTouchFit, self_touch
from calibration.mount.wrench import fit_wrench
from calibration.response.response import ResponseCalibration
from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_points
from skinmap.io.robots.urdf import UrdfBody
from skinmap.skin.robot import Robot

PAIRS, RUNS, MODULE = 700, 30, 25
RATE, MINUTES, TAXELS, HELD, PRESS = 50.0, 10.0, 60, 6, 80.0
NAO = Path(os.environ.get("SKINMAP_NAO", ROOT.parent / "shared" / "data" / "nao"))
PROBES = ROOT / "benchmarks" / "calibration" / "nao_probes.toml"
BASE, TURNS = "base", "continuous"


def mount_rows(nao: Path | None = None, *, trials: int = 20) -> list[dict[str, Any]]:
    """Error, honesty and time of every kind of mount."""
    return [
        *pair_rows(), *wrench_rows(), *self_touch_rows(nao or NAO), *simulated_rows(trials)
    ]  # fmt: skip


def pair_rows() -> list[dict[str, Any]]:
    """Planted mounts from 700 pairs at 1 mm, with outliers and shifted modules."""
    modules = np.arange(PAIRS) // MODULE
    cases: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
        ("linear", {}, {}),
        ("cauchy", {"loss": "cauchy"}, {}),
        ("cauchy, 30 % outliers", {"loss": "cauchy"}, {"outliers": 0.3}),
        ("modules", {"modules": modules}, {"shifted": True}),
        ("modules, cauchy, 20 % outliers", {"modules": modules, "loss": "cauchy"},
         {"shifted": True, "outliers": 0.2}),
    ]  # fmt: skip
    rows = []
    for name, how, what in cases:
        rng = np.random.default_rng(0)
        runs = [_pair_run(rng, how, **what) for _ in range(RUNS)]
        rows.append(_row("pairs", f"{PAIRS} pairs, {name}", runs))
    rows.append(_starts_row())
    return rows


def wrench_rows() -> list[dict[str, Any]]:
    """Planted mounts from lines of force: 2 mm, 5 mN m, 2 to 10 N."""
    rows = []
    for touches, outliers in ((20, 0.0), (60, 0.0), (60, 0.2)):
        rng = np.random.default_rng(0)
        runs = [_wrench_run(rng, touches, outliers) for _ in range(RUNS)]
        rows.append(_row("wrenches", f"{touches} touches, {100 * outliers:.0f} % outliers", runs))
    return rows


def self_touch_rows(folder: Path) -> list[dict[str, Any]]:
    """Recordings of a real robot; none where they are not at hand."""
    if not folder.is_dir():
        return []
    rows = []
    files = [file for file in sorted(folder.glob("*.npz")) if not file.name.startswith("part_")]
    for file in files:
        data = real_data([file])
        patches = [name for name, chain in data.chains.items() if not chain.is_probe]
        for calibrate in dict.fromkeys([*((name,) for name in patches), tuple(patches)]):
            for joints in (False, True):
                rows.append(_self_touch_row(file.stem, data, calibrate, joints))
    if len(files) > 1:
        data = real_data([folder])
        patches = [name for name, chain in data.chains.items() if not chain.is_probe]
        for joints in (False, True):
            rows.append(_self_touch_row("all recordings", data, tuple(patches), joints))
        with TemporaryDirectory() as spare:
            other = as_urdf(data, folder, Path(spare) / "rows.urdf")
            rows.append(_self_touch_row("all recordings, URDF", other, tuple(patches), False))
    return rows


def _self_touch_row(
    name: str, data: SelfTouchData, calibrate: tuple[str, ...], joints: bool
) -> dict[str, Any]:
    start = time.process_time()
    fit = self_touch(
        data.recordings,
        data.chains,
        calibrate=calibrate,
        joint_offsets=joints,
        rng=np.random.default_rng(0),
    )
    seconds = time.process_time() - start
    return {
        "evidence": "self-touch",
        "case": f"{name}: {', '.join(fit.mounts)}{' and joints' if joints else ''}",
        "truth": "touches held out in five folds (real recording)",
        "rms_mm": {
            "before": 1e3 * fit.rms_before,
            "after": 1e3 * fit.rms_after,
            "held_out": 1e3 * fit.held_out,
        },
        "closest_taxels_rms_mm": 1e3 * _closest(data.recordings[0], data.chains, fit),
        "split_shift_mm": 1e3 * fit.split_shift,
        "inconsistent": list(fit.inconsistent),
        "cpu_s": seconds,
    }


def _closest(recording: TouchRecording, chains: dict[str, Chain], fit: SelfTouchFit) -> float:
    """What others report: distance of the two closest active taxels, root mean square [m]."""
    offsets = np.zeros(recording.angles.shape[1])
    for joint, value in fit.joint_offsets.items():
        offsets[joint] = value
    sides = []
    for name, touched in zip(recording.chains, recording.touched, strict=True):
        chain = chains[name]
        mount = fit.mounts.get(name, chain.mount).copy()
        mount[:3, 3] = fit.tips.get(name, mount[:3, 3])
        sides.append((chain.frames(recording.angles, offsets) @ mount, chain.taxels, touched))
    found = []
    for event in range(len(recording)):
        places = []
        for T, taxels, touched in sides:
            local = np.zeros((1, 3)) if touched is None else taxels[touched[event]]
            places.append(transform_points(T[event], local[np.isfinite(local).all(axis=1)]))
        if all(map(len, places)):
            found.append(float(cdist(*places).min()))
    return float(np.sqrt(np.mean(np.square(found))))


Run = tuple[MountFit, FloatArray, FloatArray, float]


def _row(evidence: str, case: str, runs: list[Run]) -> dict[str, Any]:
    missed, squares = [], []
    for fit, mount, points, _ in runs:
        apart = transform_points(fit.mount, points) - transform_points(mount, points)
        missed.append(1e3 * float(np.sqrt(np.mean(np.sum(apart**2, axis=1)))))
        turn = Rotation.from_matrix(fit.mount[:3, :3] @ mount[:3, :3].T).as_rotvec()
        error = np.concatenate([turn, fit.mount[:3, 3] - mount[:3, 3]])
        squares.append(float(error @ np.linalg.solve(fit.covariance, error)) / 6)
    return {
        "evidence": evidence,
        "case": case,
        "truth": "planted mount (simulated)",
        "runs": len(runs),
        "error_mm": {"median": median(missed), "max": max(missed)},
        "normalised_error_squared": float(np.mean(squares)),
        "cpu_s": median(run[3] for run in runs),
    }


def _timed(run: Callable[[], MountFit]) -> tuple[MountFit, float]:
    start = time.process_time()
    fit = run()
    return fit, time.process_time() - start


def _pairs(
    rng: np.random.Generator, outliers: float = 0.0, shifted: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    mount, frames = _frames(rng, PAIRS)
    points = rng.normal(0, 0.05, (PAIRS, 3))
    shifts = rng.normal(0, 3e-3, (PAIRS // MODULE, 3)) if shifted else np.zeros((PAIRS, 3))
    placed = points + shifts[np.arange(PAIRS) // MODULE]
    T = frames @ mount
    targets = np.einsum("mij,mj->mi", T[:, :3, :3], placed) + T[:, :3, 3]
    targets += rng.normal(0, 1e-3, targets.shape)
    targets[rng.random(PAIRS) < outliers] += rng.normal(0, 0.05, 3)
    return mount, points, frames, targets


def _pair_run(rng: np.random.Generator, how: dict[str, Any], **what: Any) -> Run:
    mount, points, frames, targets = _pairs(rng, **what)
    fit, seconds = _timed(lambda: fit_mount(points, frames, targets, **how))
    return fit, mount, points, seconds


def _starts_row() -> dict[str, Any]:
    """Share of starts within 120 degrees and 100 mm that end in the same minimum."""
    rng = np.random.default_rng(1)
    mount, points, frames, targets = _pairs(rng, 0.2)
    wanted = fit_mount(points, frames, targets, loss="cauchy").mount
    same = 0
    for _ in range(RUNS):
        start = mount.copy()
        axis, move = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        turn = Rotation.from_rotvec(np.deg2rad(rng.uniform(0, 120)) * axis).as_matrix()
        start[:3, :3], start[:3, 3] = (
            turn @ mount[:3, :3],
            mount[:3, 3] + rng.uniform(0, 0.1) * move,
        )
        found = fit_mount(points, frames, targets, initial=start, loss="cauchy").mount
        same += bool(np.abs(found - wanted).max() < 1e-9)
    return {
        "evidence": "pairs",
        "case": "starts within 120 degrees and 100 mm, 20 % outliers",
        "truth": "the minimum without a start (simulated)",
        "runs": RUNS,
        "same_minimum_percent": 100.0 * same / RUNS,
    }


def _frames(rng: np.random.Generator, m: int) -> tuple[FloatArray, FloatArray]:
    mount = np.eye(4)
    mount[:3, :3] = Rotation.random(rng=rng).as_matrix()
    mount[:3, 3] = rng.normal(0, 0.15, 3)
    frames = np.tile(np.eye(4), (m, 1, 1))
    frames[:, :3, :3] = Rotation.random(m, rng=rng).as_matrix()
    frames[:, :3, 3] = rng.normal(0, 0.1, (m, 3))
    return mount, frames


def _wrench_run(rng: np.random.Generator, m: int, outliers: float) -> Run:
    mount, frames = _frames(rng, m)
    angle, height, radius = rng.uniform(-0.8, 0.8, m), rng.uniform(-0.06, 0.06, m), 0.05
    points = np.stack([radius * np.sin(angle), height, radius * (np.cos(angle) - 1)], axis=1)
    push = -np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    push += rng.normal(0, 0.3, (m, 3))
    push *= (rng.uniform(2, 10, m) / np.linalg.norm(push, axis=1))[:, None]
    T = frames @ mount
    forces = np.einsum("mij,mj->mi", T[:, :3, :3], push)
    pressed = points + rng.normal(0, 2e-3, (m, 3))
    moments = np.cross(np.einsum("mij,mj->mi", T[:, :3, :3], pressed) + T[:, :3, 3], forces)
    moments += rng.normal(0, 5e-3, (m, 3))
    moments[rng.random(m) < outliers] += 0.5
    fit, seconds = _timed(lambda: fit_wrench(points, frames, forces, moments, point_sigma=2e-3))
    return fit, mount, points, seconds


def drift_rows(seed: int = 0, *, most: int | None = None) -> list[dict[str, Any]]:
    """A press held for ten minutes while baselines walk 20 counts; simulated at 50 Hz, 8 bits."""
    rows = []
    trackers: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
        "skinmap": lambda rest, samples: ResponseCalibration.fit(rest, rate=RATE).apply(samples),
        "incumbent, as coded (margin 2, still under contact)": lambda rest, samples: _incumbent(
            rest, samples, margin=2.0, contact=0.0
        ),
        "incumbent, as shipped (margin 7, adapts under contact)": lambda rest, samples: _incumbent(
            rest, samples, margin=7.0, contact=0.05
        ),
    }
    for case, walk in list(_walks(np.random.default_rng(seed)).items())[:most]:
        rng = np.random.default_rng(seed + 1)
        rest = np.rint(100 + rng.normal(0, 1.2, (int(5 * RATE), TAXELS)))
        press = np.zeros_like(walk)
        begin, end = int(10 * RATE), len(walk) - int(10 * RATE)
        press[begin:end, :HELD] = PRESS
        noise = rng.normal(0, 1.2, walk.shape)
        samples = np.clip(np.rint(100 + walk + press + noise), 0, 255)
        for name, track in trackers.items():
            start = time.process_time()
            pressure = track(rest, samples)
            seconds = time.process_time() - start
            held = pressure[begin + 50 : end - 50, :HELD]

            kept = 100.0 * held[-int(10 * RATE) :].mean() / PRESS
            rows.append(
                {
                    "case": case,
                    "tracker": name,
                    "truth": f"press of {PRESS:.0f} counts (simulated)",
                    "kept_after_10_min_percent": float(kept),
                    "lost_after_s": _lost_after(held.mean(axis=1)),
                    "false_touch_percent": 100.0 * float((pressure[:, HELD:] > 0).mean()),
                    "touch_after_release_percent": 100.0
                    * float((pressure[end + 100 :, :HELD] > 0).mean()),
                    "cpu_s": seconds,
                }
            )
    return rows


def _lost_after(held: FloatArray) -> float | None:
    """Seconds until a press has lost half its value for good; None where it never does."""
    below = held < 0.5 * PRESS
    return float((len(held) - np.argmin(below[::-1])) / RATE) if below[-1] else None


def _walks(rng: np.random.Generator) -> dict[str, FloatArray]:
    t = int(RATE * 60 * MINUTES)
    ramp = np.linspace(0.0, 20.0, t)[:, None]
    free = (np.arange(TAXELS) >= HELD).astype(float)
    steps = np.cumsum(rng.normal(0, 20 / np.sqrt(t), (t, TAXELS)), axis=0)
    return {
        "free baselines rise": ramp * free,
        "free baselines fall": -ramp * free,
        "all baselines rise": ramp * np.ones(TAXELS),
        "all baselines fall": -ramp * np.ones(TAXELS),
        "each its own way": ramp * free * rng.choice([-1.0, 1.0], TAXELS),
        "random walks": steps * free,
    }


def _incumbent(
    rest: FloatArray, samples: FloatArray, *, margin: float, contact: float
) -> FloatArray:
    """The iCub's skinManager as published: its baseline moves in every sample, also in contact."""
    baseline = rest.mean(axis=0)
    theta = np.maximum(1.0, np.percentile(rest, 95, axis=0) - baseline)
    out = np.empty(samples.shape)
    for row, sample in enumerate(samples):
        deviation = sample - baseline
        touched = deviation > theta + margin
        gain = np.where(touched, contact, 0.2)
        baseline = baseline + 0.02 * gain * deviation / theta
        out[row] = np.where(touched, deviation, 0.0)
    return out


def real_data(paths: list[Path]) -> SelfTouchData:
    """Recordings with the chains of their parts' rows."""
    return load_part_touches(paths, PROBES)


def as_urdf(data: SelfTouchData, folder: Path, urdf: Path) -> SelfTouchData:
    """The same, with chains from a URDF that is written from the rows in `folder`."""
    text, moving = ['<robot name="rows">', f'<link name="{BASE}"/>'], set[str]()
    for part in dict.fromkeys(data.links.values()):
        with np.load(folder / f"part_{part}.npz") as arrays:
            names = [data.joints[column] for column in arrays["joint_cols"].tolist()]
            text += _branch(part, arrays["dh"], names)
            moving |= set(names)
    for joint in sorted(set(data.joints) - moving):  # of arms that touch nothing
        text += [f'<link name="{joint}_end"/>', _joint(joint, TURNS, BASE, f"{joint}_end", "", "")]
    urdf.write_text("\n".join([*text, "</robot>"]))
    robot = Robot("rows", UrdfBody(urdf), {})
    chains = {}
    for name, chain in data.chains.items():
        own = robot_chain(robot, f"{data.links[name]}_end", data.joints, base=BASE, name=name)
        chains[name] = replace(
            own, mount=chain.mount, taxels=chain.taxels, normals=chain.normals, radius=chain.radius
        )
    return replace(data, chains=chains)


def _branch(part: str, dh: FloatArray, joints: list[str]) -> Iterator[str]:
    """Links and joints of one part: a turn about z for each row that moves, then what is fixed."""
    parent, fixed = BASE, len(dh) - len(joints)
    for row, (a, d, alpha, offset) in enumerate(dh):
        if row >= fixed:
            turned = f"{part}_{row}_turned"
            yield f'<link name="{turned}"/>'
            yield _joint(joints[row - fixed], TURNS, parent, turned, "", "")
            parent = turned
        child = f"{part}_{row}"
        turn = Rotation.from_euler("z", offset) * Rotation.from_euler("x", alpha)
        place = np.array([a * np.cos(offset), a * np.sin(offset), d])
        yield f'<link name="{child}"/>'
        xyz, rpy = (" ".join(map(repr, v.tolist())) for v in (place, turn.as_euler("xyz")))
        yield _joint(f"{child}_fixed", "fixed", parent, child, xyz, rpy)
        parent = child
    yield f'<link name="{part}_end"/>'
    yield _joint(f"{part}_end_fixed", "fixed", parent, f"{part}_end", "", "")


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, rpy: str) -> str:
    origin = f'<origin xyz="{xyz or "0 0 0"}" rpy="{rpy or "0 0 0"}"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{origin}<axis xyz="0 0 1"/></joint>'

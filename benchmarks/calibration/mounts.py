"""Mounts from pairs and self-touch; drift under a held press.

What rows were measured against is planted, and the evidence simulated.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.calibration.self_touch_rows import simulated_rows
from benchmarks.harness.timing import timed
from calibration.mount.rigid_mount import Loss, fit_mount
from calibration.response.response import ResponseCalibration
from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_points

PAIRS, RUNS = 700, 30
RATE, MINUTES, TAXELS, HELD, PRESS = 50.0, 10.0, 60, 6, 80.0


def mount_rows(trials: int) -> list[dict[str, Any]]:
    """Error, honesty and time of every kind of mount."""
    return [*pair_rows(), *simulated_rows(trials)]


def pair_rows() -> list[dict[str, Any]]:
    """Planted mounts from 700 pairs at 1 mm, with outliers."""
    cases: list[tuple[str, Loss, float]] = [
        ("linear", "linear", 0.0),
        ("cauchy", "cauchy", 0.0),
        ("cauchy, 30 % outliers", "cauchy", 0.3),
    ]
    rows = []
    for name, loss, outliers in cases:
        rng = np.random.default_rng(0)
        missed, squares, times = [], [], []
        for _ in range(RUNS):
            mount, points, frames, targets = _pairs(rng, outliers)
            fit, seconds, _ = timed(partial(fit_mount, points, frames, targets, loss=loss))
            times.append(seconds)
            apart = transform_points(fit.mount, points) - transform_points(mount, points)
            missed.append(1e3 * float(np.sqrt(np.mean(np.sum(apart**2, axis=1)))))
            turn = Rotation.from_matrix(fit.mount[:3, :3] @ mount[:3, :3].T).as_rotvec()
            error = np.concatenate([turn, fit.mount[:3, 3] - mount[:3, 3]])
            squares.append(float(error @ np.linalg.solve(fit.covariance, error)) / 6)
        rows.append({
            "evidence": "pairs", "case": f"{PAIRS} pairs, {name}",
            "truth": "planted mount (simulated)", "runs": RUNS,
            "error_mm": {"median": median(missed), "max": max(missed)},
            "normalised_error_squared": float(np.mean(squares)), "cpu_s": median(times),
        })  # fmt: skip
    return rows


def _pairs(rng: np.random.Generator, outliers: float) -> tuple[FloatArray, ...]:
    """A mount (4, 4), points (m, 3) in it, frames (m, 4, 4) of its link, and where they are."""
    mount = np.eye(4)
    mount[:3, :3] = Rotation.random(rng=rng).as_matrix()
    mount[:3, 3] = rng.normal(0, 0.15, 3)
    frames = np.tile(np.eye(4), (PAIRS, 1, 1))
    frames[:, :3, :3] = Rotation.random(PAIRS, rng=rng).as_matrix()
    frames[:, :3, 3] = rng.normal(0, 0.1, (PAIRS, 3))
    points = rng.normal(0, 0.05, (PAIRS, 3))
    T = frames @ mount
    targets = np.einsum("mij,mj->mi", T[:, :3, :3], points) + T[:, :3, 3]
    targets += rng.normal(0, 1e-3, targets.shape)
    targets[rng.random(PAIRS) < outliers] += rng.normal(0, 0.05, 3)
    return mount, points, frames, targets


def drift_rows(seed: int = 0, *, most: int | None = None) -> list[dict[str, Any]]:
    """A press held for ten minutes while baselines walk 20 counts; simulated at 50 Hz, 8 bits."""
    rows = []
    for case, walk in list(_walks(np.random.default_rng(seed)).items())[:most]:
        rng = np.random.default_rng(seed + 1)
        rest = np.rint(100 + rng.normal(0, 1.2, (int(5 * RATE), TAXELS)))
        press = np.zeros_like(walk)
        begin, end = int(10 * RATE), len(walk) - int(10 * RATE)
        press[begin:end, :HELD] = PRESS
        noise = rng.normal(0, 1.2, walk.shape)
        samples = np.clip(np.rint(100 + walk + press + noise), 0, 255)
        for name, track in TRACKERS.items():
            pressure, seconds, _ = timed(partial(track, rest, samples))
            last = pressure[end - 50 - int(10 * RATE) : end - 50, :HELD]
            rows.append({
                "case": case, "tracker": name,
                "truth": f"press of {PRESS:.0f} counts (simulated)",
                "kept_after_10_min_percent": float(100.0 * last.mean() / PRESS),
                "false_touch_percent": 100.0 * float((pressure[:, HELD:] > 0).mean()),
                "cpu_s": seconds,
            })  # fmt: skip
    return rows


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


def _incumbent(rest: FloatArray, samples: FloatArray) -> FloatArray:
    """The iCub's skinManager as shipped: its baseline moves in every sample, also in contact."""
    baseline = rest.mean(axis=0)
    theta = np.maximum(1.0, np.percentile(rest, 95, axis=0) - baseline)
    out = np.empty(samples.shape)
    for row, sample in enumerate(samples):
        deviation = sample - baseline
        touched = deviation > theta + 7.0
        baseline = baseline + 0.02 * np.where(touched, 0.05, 0.2) * deviation / theta
        out[row] = np.where(touched, deviation, 0.0)
    return out


TRACKERS: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "skinmap": lambda rest, samples: ResponseCalibration.fit(rest, rate=RATE).apply(samples),
    "incumbent, as shipped (margin 7, adapts under contact)": _incumbent,
}

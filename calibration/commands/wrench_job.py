"""`skinmap calibrate wrench`: what it finds, judges, prints and writes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibration.commands.mount_jobs import Job, pitch_of, spread, verdict
from calibration.commands.mount_report import PLACED, distance_picture, taxel_picture, write_report
from calibration.files.mount_files import (
    WrenchTouches,
    read_wrenches,
    write_mounts,
    write_tables,
)
from calibration.mount.rigid_mount import point_covariance
from calibration.mount.wrench import fit_wrench
from calibration.patch.patch_calibration import Status
from calibration.patch.status import weak_direction
from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_points
from skinmap.io.units import UNITS

MM = 1e3
FOLDS = 5


def wrench_job(
    file: Path,
    *,
    units: str,
    point_sigma: float,
    moment_sigma: float,
    loss: str,
    seed: int,
    taxels: Path | None = None,
    formats: Sequence[str] = (),
) -> Job:
    """Fit a mount to lines of force."""
    touches = read_wrenches(file, UNITS[units], taxels)
    how: dict[str, Any] = {
        "loss": loss, "point_sigma": point_sigma, "moment_sigma": moment_sigma,
    }  # fmt: skip
    start = time.process_time()
    fit = fit_wrench(touches.points, touches.frames, touches.forces, touches.moments, **how)
    held_out = _wrench_held_out(touches, how, np.random.default_rng(seed))
    seconds = time.process_time() - start
    skin = touches.points if touches.taxels is None else touches.taxels
    covariance = point_covariance(fit.mount, skin, fit.covariance)
    sd = np.sqrt(np.einsum("nii->n", covariance))
    judged: list[tuple[str, str]] = []
    pitch = pitch_of(skin) if touches.taxels is not None else 2 * point_sigma
    if np.median(sd) > pitch / 2:
        _, vectors = np.linalg.eigh(covariance.mean(axis=0))
        along = ", ".join(f"{value:.2f}" for value in vectors[:, -1])
        judged.append(
            (
                Status.UNOBSERVABLE,
                f"taxels are known to {MM * np.median(sd):.1f} mm only, half a pitch is "
                f"{MM * pitch / 2:.1f} mm; least along ({along}) of the link: press from other "
                "sides",
            )
        )
    result = {
        **verdict(judged),
        "touches": len(touches.points),
        "rms_mm": MM * fit.rms,
        "cross_validation_mm": None if held_out is None else MM * held_out,
        "predicted_sd_mm": spread(MM * sd),
        "weakest": weak_direction(transform_points(fit.mount, skin), covariance),
        "mount": fit.mount,
        "seed": seed,
        "seconds": seconds,
    }

    def write(stage: Path) -> None:
        write_mounts({"mounts": {file.stem: fit.mount}}, stage / "mounts.json")
        if touches.taxels is not None:
            placed = transform_points(fit.mount, touches.taxels)
            table = stage / "taxels.csv"
            write_tables(touches.channels, placed, covariance, table, formats=formats)

    def report(path: Path) -> None:
        rows = [
            ("touches", str(len(touches.points))),
            ("points miss their lines by (rms)", f"{MM * fit.rms:.2f} mm"),
            ("held-out error: touches that the fit never saw",
             "too few touches" if held_out is None else f"{MM * held_out:.2f} mm"),
            ("predicted error, median", f"{MM * float(np.median(sd)):.2f} mm"),
            ("predicted error, worst", f"{MM * float(sd.max()):.2f} mm"),
            ("weakest direction", f"the patch {result['weakest']}"),
            ("touch next", "from another side, best where the error below is largest"),
        ]  # fmt: skip
        placed = transform_points(fit.mount, skin)
        words = "Distance of each pressed point from the line of its force."
        pictures = [
            ("On the link", taxel_picture(placed, sd), PLACED),
            ("Touches", distance_picture(None, fit.residuals), words),
        ]
        write_report(f"Wrenches: {file.stem}", result, rows, pictures, path)

    return Job(result, write, report)


def _wrench_held_out(
    touches: WrenchTouches, how: dict[str, Any], rng: np.random.Generator
) -> float | None:
    """Root mean square distance [m] of touches from their lines under fits that never saw them."""
    fold = rng.permutation(len(touches.points)) % FOLDS
    if len(fold) < 2 * FOLDS:
        return None
    squares = []
    for k in range(FOLDS):
        seen, unseen = (
            (touches.points[m], touches.frames[m], touches.forces[m], touches.moments[m])
            for m in (fold != k, fold == k)
        )
        mount = fit_wrench(*seen, **how).mount
        squares.append(_line_distances(mount, *unseen) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _line_distances(
    mount: FloatArray,
    points: FloatArray,
    frames: FloatArray,
    forces: FloatArray,
    moments: FloatArray,
) -> FloatArray:
    """(m,) distances [m]: a point r misses the line of a wrench by |r x f - m| across f, over f."""
    T = frames @ mount
    r = np.einsum("mij,mj->mi", T[:, :3, :3], points) + T[:, :3, 3]
    along = forces / np.linalg.norm(forces, axis=1)[:, None]
    missed = np.cross(r, forces) - moments
    missed -= along * np.einsum("mi,mi->m", along, missed)[:, None]
    return np.asarray(np.linalg.norm(missed, axis=1) / np.linalg.norm(forces, axis=1))


def wrench_lines(result: dict[str, Any]) -> list[str]:
    """A few lines for people."""
    sd = result["predicted_sd_mm"]
    return [
        f"{result['touches']} touches, {result['rms_mm']:.2f} mm rms from their lines",
        f"predicted error: median {sd['median']:.2f} mm, worst {sd['max']:.2f} mm",
    ]

"""`skinmap calibrate selftouch`: what it finds, judges, prints and writes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from calibration.commands.mount_jobs import Job, pitch_of, verdict
from calibration.commands.mount_report import PLACED, distance_picture, taxel_picture, write_report
from calibration.files.mount_files import (
    write_mounts,
    write_tables,
)
from calibration.files.self_touch_files import load_self_touch
from calibration.mount.chains import Chain, TouchRecording
from calibration.mount.rigid_mount import Loss
from calibration.mount.self_touch import SelfTouchFit, self_touch, taxel_covariance
from calibration.patch.patch_calibration import Status
from calibration.patch.status import NEXT, weak_direction
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_points

MM = 1e3
OVERFIT = 1.5  # times the misses of the fit that unseen touches may miss by


def selftouch_job(
    files: Sequence[Path],
    names: Sequence[str],
    *,
    joint_offsets: bool,
    drop_inconsistent: bool,
    loss: str,
    seed: int,
    formats: Sequence[str] = (),
) -> Job:
    """Fit mounts to recordings of self-touch."""
    recordings, chains = load_self_touch(files)
    calibrate = tuple(names) or tuple(name for name, one in chains.items() if not one.is_probe)
    start = time.process_time()
    fit = self_touch(
        recordings,
        chains,
        calibrate=calibrate,
        joint_offsets=joint_offsets,
        loss=cast("Loss", loss),
        drop_inconsistent=drop_inconsistent,
        rng=np.random.default_rng(seed),
    )
    seconds = time.process_time() - start
    judged = _judge_self_touch(fit, chains, calibrate)
    result = {
        **verdict(judged),
        "calibrated": list(calibrate),
        "events": sum(map(len, recordings)),
        "rms_mm": {
            "before": MM * fit.rms_before,
            "after": MM * fit.rms_after,
            "held_out": MM * fit.held_out,
        },
        "split_shift_mm": MM * fit.split_shift,
        "dropped": list(fit.dropped),
        "inconsistent": list(fit.inconsistent),
        "medians_mm": {name: MM * value for name, value in fit.medians.items()},
        "mounts": dict(fit.mounts),
        "tips_mm": {name: MM * tip for name, tip in fit.tips.items()},
        "joint_offsets_deg": {
            joint: float(np.rad2deg(value)) for joint, value in fit.joint_offsets.items()
        },
        "seed": seed,
        "seconds": seconds,
    }

    def write(stage: Path) -> None:
        write_mounts(
            {"mounts": fit.mounts, "tips": fit.tips, "joint_offsets": fit.joint_offsets},
            stage / "mounts.json",
        )
        for name in calibrate:
            rows, placed, own = _placed(chains[name], fit)
            write_tables(rows, placed, own, stage / f"taxels_{name}.csv", formats=formats)

    def report(path: Path) -> None:
        rows = [
            ("distance of what touched, as it came (rms)", f"{MM * fit.rms_before:.2f} mm"),
            ("calibrated", f"{MM * fit.rms_after:.2f} mm"),
            ("held-out error: touches that the fit never saw", f"{MM * fit.held_out:.2f} mm"),
            ("taxels move between fits to two halves by", f"{MM * fit.split_shift:.2f} mm"),
            *((f"median of {name}", f"{MM * value:.2f} mm") for name, value in fit.medians.items()),
            ("left out", ", ".join(fit.dropped) or "nothing"),
        ]
        pictures = []
        for name in calibrate:
            rows += _chain_rows(chains[name], fit, recordings)
            _, placed, own = _placed(chains[name], fit)
            sd = np.sqrt(np.einsum("nii->n", own))
            pictures.append((f"{name} on its link", taxel_picture(placed, sd), PLACED))
        words = "Distance between the middles of the active taxels of both sides."
        pictures.append(("Touches", distance_picture(fit.distances_before, fit.distances), words))
        write_report(f"Self-touch: {', '.join(calibrate)}", result, rows, pictures, path)

    return Job(result, write, report)


def _judge_self_touch(
    fit: SelfTouchFit, chains: dict[str, Chain], calibrate: Sequence[str]
) -> list[tuple[str, str]]:
    judged: list[tuple[str, str]] = []
    left = [name for name in fit.inconsistent if name not in fit.dropped]
    if left:
        judged.append(
            (
                Status.AMBIGUOUS,
                f"{', '.join(left)}: median {MM * fit.medians[left[0]]:.1f} mm, contradicts the "
                "other recordings; --drop-inconsistent leaves it out",
            )
        )
    pitch = min(pitch_of(chains[name].taxels) for name in calibrate)
    if fit.split_shift > pitch / 2:
        judged.append(
            (
                Status.UNOBSERVABLE,
                f"taxels move by {MM * fit.split_shift:.1f} mm between fits to two halves, half "
                f"a pitch is {MM * pitch / 2:.1f} mm: more touches, in other poses",
            )
        )
    if fit.held_out > OVERFIT * fit.rms_after:
        judged.append(
            (
                Status.AMBIGUOUS,
                f"touches that the fit never saw are missed by {MM * fit.held_out:.1f} mm, those "
                f"it saw by {MM * fit.rms_after:.1f} mm: too few touches",
            )
        )
    return judged


def _placed(chain: Chain, fit: SelfTouchFit) -> tuple[IntArray, FloatArray, FloatArray]:
    """Channels (n,), positions (n, 3) [m] and covariances (n, 3, 3) of a chain's taxels."""
    rows = np.flatnonzero(np.isfinite(chain.taxels).all(axis=1))
    mount = fit.mounts[chain.name]
    covariance = taxel_covariance(chain, mount, fit.covariances[chain.name])
    return rows, transform_points(mount, chain.taxels[rows]), covariance


def _coverage(recordings: Sequence[TouchRecording], chain: Chain) -> FloatArray:
    """(n,) how often each taxel of a chain was touched."""
    count = np.zeros(len(chain.taxels))
    for recording in recordings:
        for name, touched in zip(recording.chains, recording.touched, strict=True):
            for ids in touched if name == chain.name and touched is not None else ():
                count[ids] += 1
    return count


def _chain_rows(
    chain: Chain, fit: SelfTouchFit, recordings: Sequence[TouchRecording]
) -> list[tuple[str, str]]:
    """Coverage, weakest direction and what to touch next of one chain, in words."""
    rows, placed, covariance = _placed(chain, fit)
    touched = _coverage(recordings, chain)[rows] > 0
    sd = np.sqrt(np.einsum("nii->n", covariance))
    # The least known of those never touched, or of all: touching it tells most.
    order = np.lexsort((-sd, touched))[:NEXT]
    return [
        (f"{chain.name}: taxels that were touched", f"{100 * touched.mean():.0f} %"),
        (f"{chain.name}: predicted error, median", f"{MM * float(np.median(sd)):.2f} mm"),
        (f"{chain.name}: weakest direction", f"the patch {weak_direction(placed, covariance)}"),
        (f"{chain.name}: touch next", f"taxels {', '.join(map(str, rows[order]))}"),
    ]


def selftouch_lines(result: dict[str, Any]) -> list[str]:
    """A few lines for people."""
    rms = result["rms_mm"]
    return [
        f"{', '.join(result['calibrated'])}: {rms['before']:.2f} -> {rms['after']:.2f} mm rms, "
        f"held out {rms['held_out']:.2f} mm",
        f"taxels move by {result['split_shift_mm']:.2f} mm between fits to two halves",
        f"left out: {', '.join(result['dropped']) or 'nothing'}",
    ]

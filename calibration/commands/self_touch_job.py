"""`skinmap calibrate selftouch`: what it finds, prints and writes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.commands.mount_jobs import Job, verdict
from calibration.commands.mount_report import PLACED, distance_picture, taxel_picture, write_report
from calibration.commands.self_touch_words import (
    judge,
    next_taxels,
    notes_of,
    placed,
    predicted,
    probe_words,
    touched,
)
from calibration.files.mount_files import write_mounts, write_tables
from calibration.files.self_touch_files import SelfTouchData
from calibration.mount.rigid_mount import Loss
from calibration.mount.self_touch import SelfTouchFit, self_touch
from calibration.patch.status import weak_direction

MM = 1e3


@dataclass(frozen=True, slots=True)
class SelfTouchOptions:
    """What the command was asked for.

    Attributes
    ----------
    names : tuple of str
        Chains whose mount is unknown; all with taxels where none is named.
    joint_offsets : bool or None
        Whether zeros of joints are unknown; with a robot they are where nobody says.
    keep_all : bool
    loss : {"linear", "cauchy"}
    seed : int
    formats : tuple of str
    """

    names: tuple[str, ...] = ()
    joint_offsets: bool | None = None
    keep_all: bool = False
    loss: Loss = "cauchy"
    seed: int = 0
    formats: tuple[str, ...] = ()


def selftouch_job(data: SelfTouchData, options: SelfTouchOptions) -> Job:
    """Fit mounts to recordings of self-touch."""
    skins = tuple(name for name, one in data.chains.items() if not one.is_probe)
    asked = tuple(_chain(data, name) for name in options.names)
    joints = options.joint_offsets
    start = time.process_time()
    fit = self_touch(
        data.recordings,
        data.chains,
        calibrate=asked or skins,
        joint_offsets=bool(data.robot) if joints is None else joints,
        loss=options.loss,
        keep_all=options.keep_all,
        rng=np.random.default_rng(options.seed),
    )
    seconds = time.process_time() - start
    result = {
        **verdict(judge(data, fit, asked)),
        **_result(data, fit),
        "notes": notes_of(data, fit, asked),
        "next": next_taxels(data, fit),
        "seed": options.seed,
        "seconds": seconds,
    }
    return Job(
        result,
        lambda stage: _write(data, fit, options.formats, stage),
        lambda path: _report(data, fit, result, path),
    )


def _chain(data: SelfTouchData, name: str) -> str:
    """A chain by its name, or by that of the link that only it is on."""
    on_link = [chain for chain, link in data.links.items() if link == name]
    return on_link[0] if name not in data.chains and len(on_link) == 1 else name


def _result(data: SelfTouchData, fit: SelfTouchFit) -> dict[str, Any]:
    return {
        "robot": data.robot or None,
        "base": data.base or None,
        "calibrated": list(fit.mounts),
        "events": sum(map(len, data.recordings)),
        "rms_mm": {
            "before": MM * fit.rms_before,
            "after": MM * fit.rms_after,
            "held_out": MM * fit.held_out,
        },
        "split_shift_mm": MM * fit.split_shift,
        "predicted_sd_mm": {
            name: MM * float(np.median(predicted(data.chains[name], fit))) for name in fit.mounts
        },
        "dropped": list(fit.dropped),
        "inconsistent": list(fit.inconsistent),
        "medians_mm": {name: MM * value for name, value in fit.medians.items()},
        "standoffs_mm": {name: MM * value for name, value in fit.standoffs.items()},
        "mounts": dict(fit.mounts),
        "probes": probe_words(data, fit),
        "tips_mm": {name: MM * tip for name, tip in fit.tips.items()},
        "joint_offsets_deg": {
            data.joints[joint] if data.robot else joint: float(np.rad2deg(value))
            for joint, value in fit.joint_offsets.items()
        },
    }


def _write(data: SelfTouchData, fit: SelfTouchFit, formats: Sequence[str], stage: Path) -> None:
    offsets = {
        data.joints[joint] if data.robot else joint: value
        for joint, value in fit.joint_offsets.items()
    }
    found = {"mounts": fit.mounts, "tips": fit.tips, "joint_offsets": offsets}
    write_mounts(found, stage / "mounts.json")
    for name in fit.mounts:
        rows, places, own = placed(data.chains[name], fit)
        write_tables(rows, places, own, stage / f"taxels_{name}.csv", formats=formats)


def _report(data: SelfTouchData, fit: SelfTouchFit, result: dict[str, Any], path: Path) -> None:
    rows = [
        ("distance of what touched, as it came (rms)", f"{MM * fit.rms_before:.2f} mm"),
        ("calibrated", f"{MM * fit.rms_after:.2f} mm"),
        ("held-out error: touches that the fit never saw", f"{MM * fit.held_out:.2f} mm"),
        ("taxels move between fits to two halves by", f"{MM * fit.split_shift:.2f} mm"),
        *((f"median of {name}", f"{MM * value:.2f} mm") for name, value in fit.medians.items()),
        ("left out", ", ".join(fit.dropped) or "nothing"),
        *(("note", note) for note in result["notes"]),
    ]
    pictures = []
    for name in fit.mounts:
        rows += _chain_rows(data, fit, name, result["next"][name])
        _, places, _ = placed(data.chains[name], fit)
        sd = predicted(data.chains[name], fit)
        pictures.append((f"{name} on its link", taxel_picture(places, sd), PLACED))
    words = "Distance between the middles of the active taxels of both sides."
    pictures.append(("Touches", distance_picture(fit.distances_before, fit.distances), words))
    write_report(f"Self-touch: {', '.join(fit.mounts)}", result, rows, pictures, path)


def _chain_rows(
    data: SelfTouchData, fit: SelfTouchFit, name: str, channels: Sequence[int]
) -> list[tuple[str, str]]:
    """Coverage, weakest direction and what to touch next of one chain, in words."""
    _, places, covariance = placed(data.chains[name], fit)
    share = 100 * touched(data, fit, name).mean()
    sd = MM * float(np.median(predicted(data.chains[name], fit)))
    return [
        (f"{name}: taxels that were touched", f"{share:.0f} %"),
        (f"{name}: predicted error, median", f"{sd:.2f} mm"),
        (f"{name}: weakest direction", f"the patch {weak_direction(places, covariance)}"),
        (f"{name}: touch next", f"taxels {', '.join(map(str, channels))}"),
    ]


def selftouch_lines(result: dict[str, Any]) -> list[str]:
    """A few lines for people."""
    rms = result["rms_mm"]
    return [
        f"{', '.join(result['calibrated'])}: {rms['before']:.2f} -> {rms['after']:.2f} mm rms, "
        f"held out {rms['held_out']:.2f} mm",
        f"taxels move by {result['split_shift_mm']:.2f} mm between fits to two halves",
        *(f"{name}: predicted error {sd:.2f} mm" for name, sd in result["predicted_sd_mm"].items()),
        f"left out: {', '.join(result['dropped']) or 'nothing'}",
        *(f"note: {note}" for note in result["notes"]),
    ]

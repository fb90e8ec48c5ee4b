"""`skinmap calibrate plane`: what it finds, judges, prints and writes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.commands.mount_jobs import Job, spread
from calibration.commands.plane_report import plane_pictures, plane_rows
from calibration.files.mount_files import write_mounts, write_tables
from calibration.files.plane_files import PlaneEvidence, read_plane_evidence
from calibration.plane.contacts import Plane
from calibration.plane.fit import PlaneFit, fit_plane
from calibration.plane.robot import Pressing, candidates, part_chains, pressing, stood_still
from skinmap.errors import InvalidArrayError
from skinmap.skin.robot import Robot

MM = 1e3


@dataclass(frozen=True, eq=False, slots=True)
class PlaneOptions:
    """What was asked for."""

    evidence: Sequence[Path]
    robot: Robot
    parts: Sequence[str]
    planes: Sequence[Plane] | None
    joint_sigma_deg: float
    threshold: float
    drop_inconsistent: bool
    proposed: int
    seed: int
    formats: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class NextPress:
    """A pose to press in."""

    surface: int
    joints_deg: dict[str, float]
    slides_mm: dict[str, float]
    expected_sd_mm: float  # of the taxels, root mean square, once it and those before it are done


def read_planes(words: Sequence[str]) -> list[Plane] | None:
    """Planes from `x,y,z,nx,ny,nz`; None where there are no words.

    Raises
    ------
    InvalidArrayError
        Not six finite numbers, or a normal without length.
    """
    planes = []
    for text in words:
        try:
            numbers = np.array([float(word) for word in text.split(",")])
        except ValueError:
            numbers = np.zeros(0)
        if len(numbers) != 6 or not np.isfinite(numbers).all():
            raise InvalidArrayError(
                f"--plane {text!r} must be six numbers x,y,z,nx,ny,nz: a point [m] and the normal"
            )
        planes.append(Plane(numbers[:3], numbers[3:]))
    return planes or None


def plane_job(options: PlaneOptions) -> Job:
    """Fit mounts to presses, and propose the next ones."""
    evidence = read_plane_evidence(
        options.evidence, options.robot, options.parts, threshold=options.threshold
    )
    parts = tuple(evidence.contacts.active)
    start = time.process_time()
    fit = fit_plane(
        evidence.contacts,
        list(part_chains(options.robot, parts, evidence.joints).values()),
        modules={part: options.robot.skin(part).modules for part in parts},
        planes=options.planes,
        joint_sigma=float(np.deg2rad(options.joint_sigma_deg)),
        joint_names=evidence.joints,
        drop_inconsistent=options.drop_inconsistent,
    )
    seconds = time.process_time() - start
    following = _proposed(options, evidence, fit)
    result = _printed(options, evidence, fit, following, seconds)

    def write(stage: Path) -> None:
        write_mounts(
            {
                "mounts": fit.mounts,
                "covariances": fit.covariances,
                "joint_offsets": {
                    evidence.joints[k]: value for k, value in fit.joint_offsets.items()
                },
                "planes": [
                    {"point": one.point.tolist(), "normal": one.normal.tolist()}
                    for one in fit.planes
                ],
            },
            stage / "mounts.json",
        )
        for part in parts:
            skin = options.robot.skin(part)
            table = stage / f"taxels_{part}.csv"
            write_tables(
                skin.channels, fit.places[part], fit.place_covariances[part], table,
                formats=options.formats,
            )  # fmt: skip

    def report(path: Path) -> None:
        from calibration.commands.mount_report import write_report

        rows = plane_rows(evidence, fit, result)
        title = f"Presses on a flat surface: {', '.join(parts)}"
        write_report(title, result, rows, plane_pictures(evidence, fit), path)

    return Job(result, write, report)


def _proposed(options: PlaneOptions, evidence: PlaneEvidence, fit: PlaneFit) -> list[NextPress]:
    if options.proposed == 0:
        return []
    parts = tuple(evidence.contacts.active)
    setup: Pressing = pressing(options.robot, parts, evidence.joints, evidence.contacts)
    rng = np.random.default_rng(options.seed)
    some = candidates(setup, evidence.contacts, fit.mounts, fit.planes, rng)
    if len(some) == 0:
        return []
    chosen = fit.next_contacts(some, options.proposed)
    sliding = options.robot.body.sliding_joints
    found = []
    for row, sd in zip(chosen.rows.tolist(), chosen.sd.tolist(), strict=True):
        pose = dict(zip(evidence.joints, some.angles[row].tolist(), strict=True))
        turns = {joint: float(np.rad2deg(v)) for joint, v in pose.items() if joint not in sliding}
        slides = {joint: MM * v for joint, v in pose.items() if joint in sliding}
        found.append(NextPress(int(some.surface[row]), turns, slides, MM * sd))
    return found


def _still(options: PlaneOptions, evidence: PlaneEvidence) -> list[str]:
    """Words on joints without angles."""
    still = {
        joint: None
        for part in evidence.contacts.active
        for joint in stood_still(options.robot, part, evidence.joints)
    }
    if not still:
        return []
    return [
        f"{', '.join(still)} have no angles: they are taken to have stood still, and planes are "
        "given as if at zero"
    ]


def _printed(
    options: PlaneOptions,
    evidence: PlaneEvidence,
    fit: PlaneFit,
    following: Sequence[NextPress],
    seconds: float,
) -> dict[str, Any]:
    parts = tuple(evidence.contacts.active)
    joints, robot, sliding = evidence.joints, options.robot, options.robot.body.sliding_joints
    angles = [k for k in fit.joint_offsets if joints[k] not in sliding]
    every = np.concatenate([fit.predicted_sd(part) for part in parts])
    return {
        "status": str(fit.status),
        "reasons": list(fit.reasons),
        "robot": robot.name,
        "calibrated": list(parts),
        "contacts": len(evidence.contacts),
        "predicted_sd_mm": spread(MM * every),
        "touched": {part: float((fit.touched[part] > 0).mean()) for part in parts},
        "mounts": fit.mounts,
        "planes": [{"point_mm": MM * one.point, "normal": one.normal} for one in fit.planes],
        "plane_given": options.planes is not None,
        "joint_offsets_deg": {joints[k]: float(np.rad2deg(fit.joint_offsets[k])) for k in angles},
        "joint_sd_deg": {joints[k]: float(np.rad2deg(fit.joint_sds[k])) for k in angles},
        "depth_spread_mm": MM * fit.depth_spread,
        "module_spread_mm": MM * fit.shift_spread,
        "widening": fit.widening,
        "inconsistent": list(fit.inconsistent),
        "dropped": list(fit.dropped),
        "dead": {part: robot.skin(part).channels[list(fit.dead[part])] for part in parts},
        "stuck": {part: robot.skin(part).channels[list(fit.stuck[part])] for part in parts},
        "assumed": [*fit.assumed, *_still(options, evidence)],
        "weakest": fit.weakest,
        "next": [
            {
                "surface": one.surface,
                "joints_deg": one.joints_deg,
                "slides_mm": one.slides_mm,
                "expected_sd_mm": one.expected_sd_mm,
            }
            for one in following
        ],
        "seed": options.seed,
        "seconds": seconds,
    }


def plane_lines(result: dict[str, Any]) -> list[str]:
    """A few lines for people."""
    sd = result["predicted_sd_mm"]
    lines = [
        f"{', '.join(result['calibrated'])}: {result['contacts']} contacts",
        f"predicted error: median {sd['median']:.2f} mm, 95 % below {sd['p95']:.2f} mm, "
        f"worst {sd['max']:.2f} mm",
        *(f"{part}: {words}" for part, words in result["weakest"].items()),
        f"contacts left out: {', '.join(map(str, result['dropped'])) or 'none'}",
        *(f"assumed: {words}" for words in result["assumed"]),
    ]
    for number, one in enumerate(result["next"], start=1):
        pose = [f"{joint} {value:.1f} deg" for joint, value in one["joints_deg"].items()]
        pose += [f"{joint} {value:.1f} mm" for joint, value in one["slides_mm"].items()]
        lines.append(
            f"next {number}: {', '.join(pose)} -> {one['expected_sd_mm']:.2f} mm expected (rms)"
        )
    return lines

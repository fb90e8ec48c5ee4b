"""The report of presses on a flat surface: its table and its pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibration.commands.mount_report import PLACED, taxel_picture
from calibration.files.plane_files import PlaneEvidence
from calibration.plane.fit import PlaneFit
from skinmap.arrays import FloatArray, IntArray
from skinmap.report.figure import picture_bytes, plain_figure

MM = 1e3
COVERED = "How often each taxel felt a press, from two sides; grey: never."
MISSED = (
    "How much deeper or shallower each contact was pressed than all, and how well its readings fit "
    "(lower is better). Contacts in orange contradict the others."
)


def plane_rows(
    evidence: PlaneEvidence, fit: PlaneFit, result: Mapping[str, Any]
) -> list[tuple[str, str]]:
    """Numbers in words."""
    sd, joints = result["predicted_sd_mm"], evidence.joints
    rows = [
        ("contacts", str(result["contacts"])),
        ("predicted error of a taxel, median", f"{sd['median']:.2f} mm"),
        ("95 % of the taxels below", f"{sd['p95']:.2f} mm"),
        ("press depth from contact to contact (sd)", f"{result['depth_spread_mm']:.2f} mm"),
        ("shift of a module along each axis (sd)", f"{result['module_spread_mm']:.2f} mm"),
        ("covariances were widened by", f"{fit.widening:.2f}"),
        ("contradicting contacts", ", ".join(map(str, fit.inconsistent)) or "none"),
        ("left out", ", ".join(map(str, fit.dropped)) or "none"),
    ]
    for part, share in result["touched"].items():
        rows.append((f"{part}: taxels that felt a press", f"{100 * share:.0f} %"))
        rows.append((f"{part}: weakest direction", fit.weakest[part]))
        for kind in ("dead", "stuck"):
            channels = ", ".join(map(str, result[kind][part]))
            if channels:
                rows.append((f"{part}: {kind} channels, left out", channels))
    for k, value in fit.joint_offsets.items():
        if joints[k] in result["joint_offsets_deg"]:
            rows.append(
                (
                    f"zero of {joints[k]}",
                    f"{np.rad2deg(value):+.2f} +- {np.rad2deg(fit.joint_sds[k]):.2f} degrees",
                )
            )
    rows += [("assumed", words) for words in result["assumed"]]
    for number, one in enumerate(result["next"], start=1):
        pose = ", ".join(f"{joint} {value:.1f}" for joint, value in one["joints_deg"].items())
        words = f"{pose} [deg], expected error then {one['expected_sd_mm']:.2f} mm (rms)"
        rows.append((f"press next, {number}", words))
    return rows


def plane_pictures(evidence: PlaneEvidence, fit: PlaneFit) -> list[tuple[str, bytes, str]]:
    """Headings, PNGs and what one sees on them."""
    pictures = []
    for part in evidence.contacts.active:
        places = fit.places[part]
        pictures.append(
            (f"{part} on its link", taxel_picture(places, fit.predicted_sd(part)), PLACED)
        )
        pictures.append((f"{part}: coverage", coverage_picture(places, fit.touched[part]), COVERED))
    pictures.append(("Contacts", contact_picture(fit, len(evidence.contacts)), MISSED))
    return pictures


def coverage_picture(positions: FloatArray, touched: IntArray) -> bytes:
    """PNG: taxels (n, 3) [m] from two sides, coloured by how often they felt a press."""
    middle = positions.mean(axis=0)
    _, _, axes = np.linalg.svd(positions - middle, full_matrices=False)
    across = MM * (positions - middle) @ axes.T
    figure = plain_figure((9.4, 3.8))
    both = figure.subplots(1, 2)
    felt = touched > 0
    for axis, up in zip(both, (1, 2), strict=True):
        axis.scatter(*across[~felt][:, (0, up)].T, c="#c9cfd6", s=12)
        shown = axis.scatter(
            *across[felt][:, (0, up)].T, c=touched[felt], s=16, cmap="viridis", vmin=0
        )
        axis.set_aspect("equal")
        axis.set_xlabel("along the patch [mm]")
        axis.set_ylabel(("across the patch [mm]", "out of the patch [mm]")[up - 1])
    figure.colorbar(shown, ax=list(both), shrink=0.8).set_label("presses that it felt")
    return picture_bytes(figure)


def contact_picture(fit: PlaneFit, contacts: int) -> bytes:
    """PNG: press depth of each contact against the common one, and the loss of its readings."""
    kept = np.setdiff1d(np.arange(contacts), fit.dropped)
    odd = np.isin(kept, fit.inconsistent)
    figure = plain_figure((9.4, 4.2))
    above, below = figure.subplots(2, 1, sharex=True)
    for rows, colour in ((~odd, "#00795c"), (odd, "#d4700a")):
        above.bar(kept[rows], MM * fit.depths[rows], color=colour)
        below.bar(kept[rows], fit.losses[rows], color=colour)
    above.axhline(0.0, color="#6b7580", linewidth=0.8)
    above.set_ylabel("extra depth [mm]")
    below.set_ylabel("misfit of its readings")
    below.set_xlabel("contact")
    return picture_bytes(figure)

"""The report of a registered scan: the scan on the mesh, its distances, and the other pose."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from calibration.commands.patch_report import page, picture, rows_table
from calibration.scan.registration import ScanRegistration
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.geometry.rigid import transform_points
from skinmap.geometry.triangles import face_normals
from skinmap.report.figure import picture_bytes, plain_figure
from skinmap.report.projection import View, draw_surface

MM = 1e3
FAR_MM = 3.0  # end of the colour scale
MAX_FACES, MAX_DRAWN = 30_000, 4_000


def write_scan_report(
    title: str,
    result: Mapping[str, Any],
    found: ScanRegistration,
    points: FloatArray,
    link: tuple[FloatArray, IntArray],
    path: Path,
) -> None:
    """Write one self-contained page from what the command prints as JSON."""
    mood = "ok" if result["status"] == "ok" else "look"
    other = found.runner_up_cost
    rows = [
        ("distance from the mesh (rms of what lies on it)", f"{result['rms_mm']:.2f} mm"),
        ("share of the scan on the mesh", f"{100 * result['share_on_mesh']:.0f} %"),
        ("the best other pose costs", f"{other:.2f} times as much" if other < np.inf else "none"),
        ("free motions", ", ".join(found.free_directions) or "none"),
    ]
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in result["reasons"])
    sections = [
        f"<h1>{escape(title)}</h1>",
        f"<p class={mood}><b>{escape(result['status'])}</b></p><ul>{reasons}</ul>",
        rows_table(("", ""), rows),
        picture(scan_picture(found, points, link), "scan on the mesh, coloured by distance"),
    ]
    path.write_text(page(title, sections), encoding="utf-8")


def scan_picture(
    found: ScanRegistration, points: FloatArray, link: tuple[FloatArray, IntArray]
) -> bytes:
    """PNG of the scan on the mesh from two sides, and how far it lies off."""
    vertices, faces = link
    here = transform_points(found.T_mesh_scan, points)[:: max(1, len(points) // MAX_DRAWN)]
    distance, _, _ = closest_on_mesh(here, vertices, faces)
    off = MM * distance
    figure = plain_figure((11.0, 4.2))
    axes = figure.subplots(1, 3)
    drawn = faces[:: max(1, len(faces) // MAX_FACES)]
    grey = np.tile([0.80, 0.82, 0.85, 1.0], (len(drawn), 1))
    for axis, view in zip(axes[:2], _views(vertices), strict=True):
        normals = face_normals(vertices, drawn)
        draw_surface(axis, view, MM * vertices[drawn], normals, grey, both_sides=True)
        places = view.project(MM * here)
        order = np.argsort(places[:, 2])
        shown = axis.scatter(
            *places[order, :2].T, c=off[order], s=3, cmap="viridis", vmin=0, vmax=FAR_MM, zorder=3
        )
        axis.set_aspect("equal")
        axis.margins(0.05)
        axis.set_title(view.name, fontsize=9)
        axis.set_xlabel("mm", fontsize=8)
        axis.tick_params(labelsize=7)
    figure.colorbar(shown, ax=axes[1], extend="max").set_label("distance from the mesh [mm]")
    axes[2].hist(np.clip(off, 0, 2 * FAR_MM), bins=50, color="#3b6ea8")
    axes[2].set_xlabel(f"distance [mm], all above {2 * FAR_MM:g} in the last bar")
    axes[2].set_ylabel("points")
    axes[2].spines[["top", "right"]].set_visible(False)
    return picture_bytes(figure)


def _views(vertices: FloatArray) -> list[View]:
    _, axes = np.linalg.eigh(np.cov(vertices.T))
    thin, middle, long = axes.T
    return [View("across its short axis", thin, long), View("across its middle axis", middle, long)]

"""The HTML report of `skinmap inspect`: a picture, the numbers and a verdict for each part."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from skinmap.cli.inspect.result import InspectResult, PartRow
from skinmap.geometry.triangles import face_normals, unit
from skinmap.report.figure import picture_bytes, plain_figure
from skinmap.report.image import image
from skinmap.report.page import facts, heading, page, verdict_lines
from skinmap.report.projection import View, draw_surface
from skinmap.report.result import plain
from skinmap.report.table import cell_text
from skinmap.report.verdict import Verdict
from skinmap.skin.fit import measure_fit
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin

MM = 1e3
TURN = np.radians(55.0)  # of each of the two views from where the skin looks
LEVEL = 0.5  # sine: skin that looks further up or down than 60 degrees has no front
MARGIN_MM = 10.0  # round the taxels: what of the link lies further is cut off
TIP_MM = 6.0  # length of the normals drawn
MAX_FACES = 12_000  # of the link: more cannot be seen at this size
FAR_MM = 3.0  # end of the colour scale


def write_inspection(result: InspectResult, robot: Robot | None, path: Path) -> None:
    """Write the page; pictures need the robot's body."""
    sections = []
    for row in result.parts:
        sections += [heading(row.name), verdict_lines(Verdict(row.verdict, row.warnings))]
        if robot is not None:
            sections.append(image(part_picture(robot, row.name), row.name))
        sections.append(facts(_numbers(row)))
    path.write_text(page(f"{result.robot}: skin", sections), encoding="utf-8")


def part_picture(robot: Robot, name: str) -> bytes:
    """PNG of a part from two sides: link in grey, taxels coloured by their distance to it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize, to_rgba

    skin, mesh = robot.skin(name), robot.mesh_under(name)
    found, cover = measure_fit(skin, mesh), robot.part(name).cover
    figure = plain_figure((10.0, 4.9))
    axes = figure.subplots(1, 2)
    scale = Normalize(0.0, FAR_MM)
    faces = mesh.faces[:: max(1, len(mesh.faces) // MAX_FACES)]
    normals = face_normals(mesh.vertices, faces)
    grey = np.tile(to_rgba("#c9ced4"), (len(faces), 1))
    for axis, view in zip(axes, _views(skin), strict=True):
        # Open and double shells have faces of both turns: none is left out.
        draw_surface(axis, view, mesh.vertices[faces] * MM, normals, grey, both_sides=True)
        seen = skin.normals @ view.out > 0.0
        points = view.project(skin.positions * MM)
        tips = view.project(skin.positions * MM + TIP_MM * skin.normals)
        for start, end in zip(points[seen][::5], tips[seen][::5], strict=True):
            axis.plot(*np.stack([start, end])[:, :2].T, color="#303030", linewidth=0.6)
        distance = np.abs(found.distance[seen] - cover) * MM
        axis.scatter(*points[seen][:, :2].T, c=distance, s=9, cmap="viridis", norm=scale, zorder=3)
        axis.set_xlim(points[:, 0].min() - MARGIN_MM, points[:, 0].max() + MARGIN_MM)
        axis.set_ylim(points[:, 1].min() - MARGIN_MM, points[:, 1].max() + MARGIN_MM)
        axis.set_aspect("equal")
        axis.set_title(view.name, fontsize=9)
        axis.set_xlabel("mm", fontsize=8)
        axis.tick_params(labelsize=7)
    bar = figure.colorbar(ScalarMappable(scale, "viridis"), ax=axes, shrink=0.7, extend="max")
    off = f"the cover of {cover * MM:g} mm" if cover else "the link"
    bar.set_label(f"distance to {off} [mm]")
    return picture_bytes(figure)


def _views(skin: Skin) -> list[View]:
    """From the left and the right of where the skin looks, the robot's upward direction up."""
    looks = skin.normals.mean(axis=0)
    up = np.array([0.0, 0.0, 1.0]) if skin.up is None else skin.up
    if np.linalg.norm(np.cross(up, looks)) < LEVEL * np.linalg.norm(looks):
        # A sole looks down: its length is up in the picture.
        up = np.linalg.svd(skin.positions - skin.positions.mean(axis=0), full_matrices=False)[2][0]
    front = unit(looks - (looks @ up) * up)
    side = np.cross(up, front)
    views = []
    for name, turn in zip(("from the left", "from the right"), (-TURN, TURN), strict=True):
        views.append(View(name, np.cos(turn) * front + np.sin(turn) * side, up))
    return views


def _numbers(row: PartRow) -> list[tuple[str, str]]:
    """Every figure of a part in words."""
    rows = []
    for key, value in plain(row).items():
        if key in ("name", "verdict", "warnings"):
            continue
        if isinstance(value, Mapping):
            text = ", ".join(f"{name} {cell_text(one)}" for name, one in value.items())
        else:
            text = cell_text(value, 4)
        rows.append((key, text or "-"))
    return rows

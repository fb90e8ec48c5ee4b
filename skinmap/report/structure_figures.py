"""Plots of periodic structures: each of them once, and where on the flat maps and the body."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.raster import locate_all
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.geometry.triangles import face_normals
from skinmap.neighbours.structures import Structures
from skinmap.report.figure import MM, plain_figure, save_figure
from skinmap.report.projection import View, draw_surface, shaded, visible
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin

GREY = "#b4bac1"
SKIN = (0.93, 0.93, 0.91, 1.0)
BODY = (0.80, 0.82, 0.85, 1.0)
MARGIN = 12.0  # mm round the body
PIXELS = 420  # along the longer side of the picture of the links
COLUMNS = 12
CELL = np.array([2.1, 2.5])  # of a structure, in its reaches: wide, high with its words
UP = np.array([0.0, 0.0, 1.0])
SIDES = {
    "from +x": np.array([1.0, 0.0, 0.0]),
    "from +y": np.array([0.0, 1.0, 0.0]),
    "from \N{MINUS SIGN}x": np.array([-1.0, 0.0, 0.0]),
    "from \N{MINUS SIGN}y": np.array([0.0, -1.0, 0.0]),
}


def structures_figure(skins: Mapping[str, PreparedSkin], found: Structures, path: Path) -> None:
    """Each structure once, and the flat maps of all parts coloured by structure."""
    palette = structure_colours(len(found.prototypes))
    known = colour_count()
    rows = max(-(-len(found.prototypes) // COLUMNS), 1)
    width = len(skins) if len(skins) < 4 else -(-len(skins) // 3)
    maps = 7.5 if len(skins) >= 4 else 4.5
    figure = plain_figure((13.0, 1.25 * rows + 0.4 + maps))
    top, bottom = figure.subfigures(2, 1, height_ratios=[1.25 * rows + 0.4, maps])
    _draw_prototypes(top.subplots(), found, palette)
    more = f" ({known} colours, rarer ones black)" if known < len(found.prototypes) else ""
    turned = "with" if found.prototypes.rotations > 1 else "without"
    top.suptitle(
        f"{len(found.prototypes)} structures {turned} rotation{more}; number: taxels that have "
        "it; hollow: optional",
        fontsize=11,
    )
    for place, (name, skin, labels) in enumerate(_by_part(skins, found)):
        axis = bottom.add_subplot(-(-len(skins) // width), width, place + 1)
        _draw_members(axis, skin.flat.uv * MM, labels, palette)
        axis.set_title(name, fontsize=9, pad=2, y=1.0)
    save_figure(figure, path)


def body_figure(
    robot: Robot, skins: Mapping[str, PreparedSkin], found: Structures, path: Path
) -> None:
    """The skin on the posed body from four sides, its taxels coloured by structure."""
    palette = structure_colours(len(found.prototypes))
    poses = robot.body.poses(robot.pose)
    points, normals, faces, start = [], [], [], 0
    for skin in skins.values():
        T_root_link = poses[skin.skin.link]
        points.append(transform_points(T_root_link, skin.skin.positions) * MM)
        normals.append(transform_directions(T_root_link, skin.skin.normals))
        faces.append(skin.mesh.faces + start)
        start += len(skin)
    vertices, triangles = np.concatenate(points), np.concatenate(faces)
    shapes = [_posed(robot, link, poses) for link in _links(robot, skins)]
    everything = np.concatenate([vertices, *(corners.reshape(-1, 3) for corners in shapes)])
    low, high = everything.min(axis=0) - MARGIN, everything.max(axis=0) + MARGIN
    widths = (high - low)[[1, 0, 1, 0]]
    height = 7.0
    size = float(widths.sum()) * (height - 0.6) / max(float(high[2] - low[2]), 1.0) + 1.5
    if size > 16.0:  # a part that lies is wider than high
        height, size = max(0.6 + (height - 0.6) * 16.0 / size, 3.0), 16.0
    figure = plain_figure((max(size, 6.0), height))
    axes = figure.subplots(1, 4, width_ratios=np.maximum(widths, 0.1 * widths.max()))
    for axis, (name, out) in zip(axes, SIDES.items(), strict=True):
        view = View(name, out, UP)
        ends = view.project(np.stack([low, high]))[:, 0]
        box = (float(ends.min()), float(ends.max()), float(low[2]), float(high[2]))
        if shapes:
            _draw_shapes(axis, view, np.concatenate(shapes), box)
        colours = np.tile(SKIN, (len(triangles), 1))
        draw_surface(axis, view, vertices[triangles], face_normals(vertices, triangles), colours)
        seen = visible(view, vertices, triangles, len(vertices))
        _draw_members(axis, view.project(vertices)[seen, :2], found.labels[seen], palette)
        axis.set_xlim(*box[:2])
        axis.set_ylim(*box[2:])  # one scale for all four
        axis.set_title(name, fontsize=9, y=1.0)
    _draw_scale(axes[0], float(high[2] - low[2]))
    figure.suptitle(f"{robot.name}: {len(found.prototypes)} structures on the skin", fontsize=11)
    save_figure(figure, path)


def _posed(robot: Robot, link: str, poses: Mapping[str, FloatArray]) -> FloatArray:
    """(m, 3, 3) corners of a link's triangles in the root frame [mm]."""
    mesh = robot.mesh(link)
    return np.asarray(transform_points(poses[link], mesh.vertices)[mesh.faces] * MM)


def _draw_shapes(
    axis: Any, view: View, corners: FloatArray, box: tuple[float, float, float, float]
) -> None:
    """Draw what is nearest of triangles (m, 3, 3) [mm], shaded, pixel by pixel."""
    pixel = max(box[1] - box[0], box[3] - box[2]) / PIXELS
    rows, columns = (int(np.ceil((box[k + 1] - box[k]) / pixel)) for k in (2, 0))
    seen = view.project(corners)
    flat = (seen[..., :2] - [box[0], box[2]]) / pixel
    count = np.arange(3 * len(flat)).reshape(-1, 3)
    pixels, triangle, weights = locate_all(flat.reshape(-1, 2), count, (rows, columns))
    depth = (weights * seen[triangle, :, 2]).sum(axis=1)
    order = np.argsort(depth, kind="stable")  # the nearest is painted last
    normals = face_normals(corners.reshape(-1, 3), count)
    paint = shaded(np.tile(BODY, (len(corners), 1)), view.project(normals))
    painted = np.zeros((rows * columns, 4))
    painted[pixels[order]] = paint[triangle[order]]
    image = painted.reshape(rows, columns, 4)
    extent = (box[0], box[0] + columns * pixel, box[2], box[2] + rows * pixel)
    axis.imshow(image, origin="lower", extent=extent, interpolation="antialiased", zorder=0)


def _draw_scale(axis: Any, height: float) -> None:
    """A bar of a round length, at the lower left."""
    length = 10.0 ** np.floor(np.log10(max(height, 1e-6) / 3.0))
    (left, _), (low, _) = axis.get_xlim(), axis.get_ylim()
    at = (left + 0.6 * MARGIN, low + 0.6 * MARGIN)
    axis.plot([at[0], at[0] + length], [at[1]] * 2, color="black", linewidth=1.5, clip_on=False)
    axis.text(at[0], at[1] + 0.01 * height, f"{length:g} mm", fontsize=8, va="bottom")


def _links(robot: Robot, skins: Mapping[str, PreparedSkin]) -> tuple[str, ...]:
    """Links to draw: those of the parts shown, or all where all parts are."""
    if set(skins) == set(robot.parts):
        return tuple(k for k in robot.body.visible_links if len(robot.mesh(k).vertices) > 2)
    return tuple(dict.fromkeys(skin.skin.link for skin in skins.values()))


def structure_colours(n: int) -> FloatArray:
    """(n, 4) colours, one each for the most common structures, black for all others."""
    from matplotlib import colormaps

    # tab20 pairs strong with pale: strong ones first.
    order = [*range(0, 20, 2), *range(1, 20, 2)]
    known = np.concatenate(
        [colormaps["tab20"](np.array(order)), colormaps["tab20b"](np.array(order))]
    )
    colours = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    colours[: len(known)] = known[:n]
    return colours


def colour_count() -> int:
    """How many structures have a colour of their own; more cannot be told apart."""
    return 40


def _by_part(
    skins: Mapping[str, PreparedSkin], found: Structures
) -> list[tuple[str, PreparedSkin, IntArray]]:
    parts, start = [], 0
    for name, skin in skins.items():
        parts.append((name, skin, found.labels[start : start + len(skin)]))
        start += len(skin)
    return parts


def _draw_prototypes(axis: Any, found: Structures, palette: FloatArray) -> None:
    """Draw each structure in a cell of its own, its number and count of taxels above it."""
    shapes, order = found.prototypes, np.arange(len(found.prototypes))
    reach = 1.15 * float(np.linalg.norm(shapes.offsets, axis=2).max(initial=1e-3)) * MM
    centres = np.column_stack([order % COLUMNS, -(order // COLUMNS)]) * CELL * reach
    points = centres[:, None] + shapes.offsets * MM
    maybe = shapes.filled & ~shapes.required
    axis.plot(*points[maybe].T, "o", color="white", markeredgecolor=GREY, markersize=4.5)
    axis.plot(*points[shapes.required].T, "o", color=GREY, markersize=4.5)
    axis.scatter(*centres.T, s=42, c=palette, edgecolors="black", zorder=3)
    for s, (x, y) in enumerate(centres.tolist()):
        axis.text(x, y + reach, f"{s}: {found.counts[s]}", fontsize=8, ha="center")
    rows = -(-len(order) // COLUMNS)
    axis.set_xlim(-reach, (CELL[0] * (COLUMNS - 1) + 1.0) * reach)
    axis.set_ylim(-(CELL[1] * max(rows - 1, 0) + 1.0) * reach, 1.4 * reach)
    axis.set_aspect("equal")
    axis.set_axis_off()


def _draw_members(axis: Any, places: FloatArray, labels: IntArray, palette: FloatArray) -> None:
    known = labels >= 0
    axis.scatter(*places[known].T, s=7, linewidths=0, color=palette[labels[known]], zorder=3)
    axis.scatter(*places[~known].T, s=7, color=GREY, marker="x", zorder=3)
    axis.set_aspect("equal")
    axis.autoscale_view()
    axis.set_axis_off()

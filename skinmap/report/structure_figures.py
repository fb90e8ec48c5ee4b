"""Plots of periodic structures: each of them once, and where on the flat maps."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.neighbours.structures import Structures
from skinmap.report.image import MM, plain_figure, save_figure
from skinmap.touch.prepared_skin import PreparedSkin

GREY = "#b4bac1"
COLUMNS = 12
CELL = np.array([2.1, 2.5])  # of a structure, in its reaches: wide, high with its words


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
    """Number of structures with their own colour; more could not be distinguished."""
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

"""Plots of flat maps and structures; matplotlib is imported inside, as only pictures need it."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.flat_map import FlatMap
from skinmap.neighbours.structures import Prototypes, Structures
from skinmap.touch.prepared import PreparedSkin

DPI = 110
MM = 1e3
STRAIN_LIMIT = 4.0  # per cent; one scale for all parts, so that pictures can be compared
AREA_LIMIT = 6.0  # per cent
GREY = "#b4bac1"
COLOURS = 20  # more cannot be told apart


def flat_map_figure(flat: FlatMap, path: Path) -> None:
    """Flat map of a part: edge strain and area distortion per triangle, histograms below."""
    strain = [100.0 * chart.distortion.face_edge_strain(chart.faces) for chart in flat.charts]
    area = [100.0 * (chart.distortion.area - 1.0) for chart in flat.charts]
    figure, axes = _new_figure((11.0, 7.4), 2, 2, height_ratios=[3.2, 1.0])
    _draw_triangles(
        axes[0, 0], flat, np.concatenate(strain), "viridis", (0.0, STRAIN_LIMIT), "edge strain [%]"
    )
    _draw_triangles(
        axes[0, 1],
        flat,
        np.concatenate(area),
        "PuOr",
        (-AREA_LIMIT, AREA_LIMIT),
        "area change [%]",
    )
    edges = np.concatenate([100.0 * chart.distortion.edge_strain for chart in flat.charts])
    _histogram(axes[1, 0], edges, STRAIN_LIMIT, "change of edge length [%]", "edges")
    _histogram(axes[1, 1], np.concatenate(area), AREA_LIMIT, "change of area [%]", "triangles")
    rms = ", ".join(f"{100.0 * chart.distortion.edge_rms:.2f}" for chart in flat.charts)
    charts = "patch" if len(flat.charts) == 1 else "patches"
    figure.suptitle(
        f"{flat.mesh.skin.part}: {len(flat.mesh.skin)} taxels, {len(flat.charts)} {charts}, "
        f"{flat.charts[0].method}, {flat.flips} flips, edge rms {rms} %",
        fontsize=12,
    )
    _save(figure, path)


def structures_figure(skins: Mapping[str, PreparedSkin], found: Structures, path: Path) -> None:
    """Each structure once, and the flat maps of all parts coloured by structure."""
    shown = min(COLOURS, len(found.prototypes))
    columns = 10
    rows = -(-shown // columns)
    width = len(skins) if len(skins) < 4 else -(-len(skins) // 3)
    figure = plain_figure((13.0, 1.45 * rows + (7.5 if len(skins) >= 4 else 4.5)))
    top, bottom = figure.subfigures(2, 1, height_ratios=[1.45 * rows, 7.5])
    palette = _palette(len(found.prototypes))
    for s in range(shown):
        axis = top.add_subplot(rows, columns, s + 1)
        _draw_prototype(axis, found.prototypes, s, palette[s])
        axis.set_title(f"{s}: {found.counts[s]}", fontsize=8, pad=2)
    more = f" (the {shown} most common, others grey)" if shown < len(found.prototypes) else ""
    turned = "with" if found.prototypes.rotations > 1 else "without"
    top.suptitle(
        f"{len(found.prototypes)} structures {turned} rotation{more}; number: taxels that have it",
        fontsize=11,
    )
    start = 0
    for place, (name, skin) in enumerate(skins.items()):
        axis = bottom.add_subplot(-(-len(skins) // width), width, place + 1)
        labels = found.labels[start : start + len(skin)]
        start += len(skin)
        _draw_members(axis, skin.flat.uv, labels, palette)
        axis.set_title(name, fontsize=9, pad=2)
    _save(figure, path)


def _new_figure(size: tuple[float, float], rows: int, columns: int, **grid: Any) -> tuple[Any, Any]:
    figure = plain_figure(size)
    return figure, figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid)


def plain_figure(size: tuple[float, float]) -> Any:
    """An empty matplotlib figure of a size [inch]."""
    # The object interface and not pyplot: no global state, no window system.
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=DPI, layout="constrained")


def picture_bytes(figure: Any) -> bytes:
    """A matplotlib figure as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_figure(buffer, facecolor="white", format="png")
    return buffer.getvalue()


def _save(figure: Any, path: Path) -> None:
    path.write_bytes(picture_bytes(figure))


def _draw_triangles(
    axis: Any,
    flat: FlatMap,
    values: FloatArray,
    colours: str,
    limits: tuple[float, float],
    label: str,
) -> None:
    from matplotlib.collections import PolyCollection

    corners = np.concatenate([chart.uv[chart.faces] for chart in flat.charts]) * MM
    triangles = PolyCollection(
        list(corners), array=values, cmap=colours, edgecolors="white", linewidths=0.25
    )
    triangles.set_clim(*limits)
    axis.add_collection(triangles)
    dots = np.concatenate([chart.uv for chart in flat.charts]) * MM
    axis.plot(*dots.T, ".", color="#303030", markersize=1.6)
    axis.set_aspect("equal")
    axis.autoscale_view()
    axis.margins(0.03)
    axis.set_xlabel("mm")
    axis.tick_params(labelsize=8)
    bar = axis.figure.colorbar(triangles, ax=axis, shrink=0.75, extend="both")
    bar.set_label(label)


def _histogram(axis: Any, values: FloatArray, limit: float, label: str, what: str) -> None:
    axis.hist(np.clip(values, -limit, limit), bins=60, range=(-limit, limit), color="#3b6ea8")
    axis.axvline(0.0, color="black", linewidth=0.6)
    axis.set_xlabel(label)
    axis.set_ylabel(what)
    axis.spines[["top", "right"]].set_visible(False)


def _draw_prototype(axis: Any, shapes: Prototypes, s: int, colour: Any) -> None:
    points = shapes.offsets[s] * MM
    sure = shapes.required[s]
    maybe = shapes.filled[s] & ~sure
    axis.plot(*points[maybe].T, "o", color="white", markeredgecolor=GREY, markersize=5)
    axis.plot(*points[sure].T, "o", color=GREY, markersize=5)
    axis.plot(0.0, 0.0, "o", color=colour, markersize=7, markeredgecolor="black")
    reach = 10.5
    axis.set_xlim(-reach, reach)
    axis.set_ylim(-reach, reach)
    axis.set_aspect("equal")
    axis.set_axis_off()


def _draw_members(axis: Any, uv: FloatArray, labels: IntArray, palette: FloatArray) -> None:
    known = labels >= 0
    axis.scatter(*(uv[known] * MM).T, s=5, color=palette[labels[known]])
    axis.scatter(*(uv[~known] * MM).T, s=5, color=GREY, marker="x")
    axis.set_aspect("equal")
    axis.set_axis_off()


def _palette(n: int) -> FloatArray:
    """(n, 4) colours: one each for the most common structures, grey for all others."""
    from matplotlib import colormaps
    from matplotlib.colors import to_rgba

    order = [*range(0, 20, 2), *range(1, 20, 2)]  # tab20 pairs strong with pale: strong ones first
    colours = np.array([to_rgba(GREY)] * n)
    known = min(n, COLOURS)
    colours[:known] = colormaps["tab20"](np.array(order[:known], dtype=int))
    return colours

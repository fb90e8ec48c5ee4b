"""Plots of flat maps; matplotlib is imported inside, as only pictures need it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.flat.flat_map import FlatMap

DPI = 110
MM = 1e3
STRAIN_LIMIT = 4.0  # per cent; one scale for all parts, so that pictures can be compared
AREA_LIMIT = 6.0  # per cent


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
    save_figure(figure, path)


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
    # Not `print_figure`, which draws everything once more beforehand to find the layout.
    FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()


def save_figure(figure: Any, path: Path) -> None:
    """Write a matplotlib figure as PNG."""
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

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
BINS = 60
ROOM = 0.06  # round a map, of its size


class FlatMapSheet:
    """A sheet with a flat map: edge strain and area change per triangle, histograms below.

    Drawn once, it is filled for one part after the other: making axes and finding a layout takes
    longer than to draw them.
    """

    def __init__(self) -> None:
        figure = plain_figure((11.0, 7.4))
        figure.set_layout_engine("none")  # it is the same for all parts
        self._figure = figure
        self._maps = [
            _MapPanel(figure, 0.055, "viridis", (0.0, STRAIN_LIMIT), "edge strain [%]"),
            _MapPanel(figure, 0.555, "PuOr", (-AREA_LIMIT, AREA_LIMIT), "area change [%]"),
        ]
        self._counts = [
            _CountPanel(figure, 0.055, STRAIN_LIMIT, "change of edge length [%]", "edges"),
            _CountPanel(figure, 0.555, AREA_LIMIT, "change of area [%]", "triangles"),
        ]
        self._title = figure.suptitle("", fontsize=12)

    def write(self, flat: FlatMap, path: Path) -> None:
        """Write the flat map of a part as PNG."""
        charts = flat.charts
        area = np.concatenate([100.0 * (chart.distortion.area - 1.0) for chart in charts])
        strain = [100.0 * chart.distortion.face_edge_strain(chart.faces) for chart in charts]
        edges = np.concatenate([100.0 * chart.distortion.edge_strain for chart in charts])
        for panel, values in zip(self._maps, (np.concatenate(strain), area), strict=True):
            panel.fill(flat, values)
        for counts, values in zip(self._counts, (edges, area), strict=True):
            counts.fill(values)
        rms = ", ".join(f"{100.0 * chart.distortion.edge_rms:.2f}" for chart in charts)
        patches = "patch" if len(charts) == 1 else "patches"
        self._title.set_text(
            f"{flat.mesh.skin.part}: {len(flat.mesh.skin)} taxels, {len(charts)} {patches}, "
            f"{charts[0].method}, {flat.flips} flips, edge rms {rms} %"
        )
        save_figure(self._figure, path)


class _MapPanel:
    """Coloured triangles of a flat map, a dot for each taxel, and the colours' scale."""

    def __init__(
        self, figure: Any, left: float, colours: str, limits: tuple[float, float], label: str
    ) -> None:
        from matplotlib.collections import PolyCollection

        axis = figure.add_axes((left, 0.37, 0.36, 0.56))
        self._triangles = PolyCollection(
            [], array=[], cmap=colours, edgecolors="white", linewidths=0.25
        )
        self._triangles.set_clim(*limits)
        axis.add_collection(self._triangles)
        (self._dots,) = axis.plot([], [], ".", color="#303030", markersize=1.6)
        axis.set_xlabel("mm")
        axis.tick_params(labelsize=8)
        bar = figure.colorbar(
            self._triangles, cax=figure.add_axes((left + 0.37, 0.43, 0.013, 0.44)), extend="both"
        )
        bar.set_label(label)
        self._axis = axis

    def fill(self, flat: FlatMap, values: FloatArray) -> None:
        corners = np.concatenate([chart.uv[chart.faces] for chart in flat.charts]) * MM
        dots = np.concatenate([chart.uv for chart in flat.charts]) * MM
        self._triangles.set_verts(list(corners))
        self._triangles.set_array(values)
        self._dots.set_data(*dots.T)
        low, high = dots.min(axis=0), dots.max(axis=0)
        # The panel keeps its size, the map fills it one way and lies in its middle the other.
        window = np.array(self._axis.bbox.size)
        half = 0.5 * (1.0 + ROOM) * window * ((high - low) / window).max()
        (left, bottom), (right, top) = 0.5 * (low + high) - half, 0.5 * (low + high) + half
        self._axis.set(xlim=(left, right), ylim=(bottom, top))


class _CountPanel:
    """A histogram."""

    def __init__(self, figure: Any, left: float, limit: float, label: str, what: str) -> None:
        axis = figure.add_axes((left, 0.085, 0.36, 0.2))
        self._bins = np.linspace(-limit, limit, BINS + 1)
        # One outline: a rectangle a bin takes ten times as long.
        self._steps = axis.stairs(np.zeros(BINS), self._bins, fill=True, color="#3b6ea8")
        axis.axvline(0.0, color="black", linewidth=0.6)
        axis.set_xlim(-1.1 * limit, 1.1 * limit)
        axis.set_xlabel(label)
        axis.set_ylabel(what)
        axis.spines[["top", "right"]].set_visible(False)
        self._axis = axis

    def fill(self, values: FloatArray) -> None:
        counts, _ = np.histogram(np.clip(values, self._bins[0], self._bins[-1]), self._bins)
        self._steps.set_data(counts)
        self._axis.set_ylim(0.0, 1.05 * max(int(counts.max()), 1))


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

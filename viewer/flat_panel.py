"""The panel beside the body: the flat map of one part, and the list of touches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.triangles import edge_lengths
from skinmap.live.touches import NamedTouch
from viewer.colours import DOT, FAINT, PANEL, RIM, class_colour
from viewer.outlines import OutlineLayer
from viewer.overlays import Line
from viewer.polydata import make_lines, make_mesh, write_values
from viewer.skin_layer import DOT_SHARE, PRESSURE, SkinLayer, hexagons, shown

ROWS = 6  # touches that the list shows
MAP_LOW, MAP_HIGH, MAP_SIDE = 0.34, 0.86, 0.07  # where the map lies, in shares of the panel
BARS = (0.1, 0.05, 0.02, 0.01, 0.005)  # lengths of the scale bar [m]
DOT_PX = 3.0  # largest radius of a dot [px]


SEAM_STRETCH = 3.0  # longer against the skin than any flat triangle becomes


class FlatPanel:
    """Flat map of one part in a renderer of its own, coloured as the body is.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Its active renderer becomes the panel.
    layers : mapping of str to SkinLayer
        Parts that can be shown.
    flat_maps : mapping of str to FlatMap
    table : pyvista.LookupTable
        The body's colours.
    font_px : int
        Height of the letters [px].
    """

    def __init__(
        self,
        plotter: pv.Plotter,
        layers: Mapping[str, SkinLayer],
        flat_maps: Mapping[str, FlatMap],
        table: pv.LookupTable,
        font_px: int,
    ) -> None:
        self.layers, self.flat_maps = layers, flat_maps
        self.renderer = plotter.renderer
        self.renderer.SetBackground(*pv.Color(PANEL).float_rgb)
        self.renderer.parallel_projection = True
        self.part = ""
        self._sheets: dict[str, pv.PolyData] = {}
        self._uv: dict[str, FloatArray] = {}
        self._sheet = pv.Actor(mapper=pv.DataSetMapper(pv.PolyData()))
        self._dots = pv.Actor(mapper=pv.DataSetMapper(pv.PolyData()))
        self._border = pv.Actor(mapper=pv.DataSetMapper(pv.PolyData()))
        self._scale = pv.Actor(mapper=pv.DataSetMapper(pv.PolyData()))
        mapper = self._sheet.mapper
        mapper.lookup_table = table
        mapper.scalar_map_mode = "point"
        mapper.scalar_range = (0.0, 1.0)
        mapper.interpolate_before_map = True
        self._dots.prop.color = DOT
        self._border.prop.color = RIM
        self._scale.prop.color = FAINT
        self._border.prop.line_width = 1.5
        self._scale.prop.line_width = 2.0
        for actor in (self._sheet, self._border, self._dots, self._scale):
            actor.prop.lighting = False
            plotter.add_actor(actor, reset_camera=False, render=False)
        self.outlines = OutlineLayer(plotter)
        self._caption = Line(self.renderer, (MAP_SIDE, 0.965), font_px, bold=True)
        self._about = Line(self.renderer, (MAP_SIDE, 0.93), round(0.85 * font_px), colour=FAINT)
        self._length = Line(self.renderer, (MAP_SIDE, 0.31), round(0.85 * font_px), colour=FAINT)
        self._head = Line(self.renderer, (MAP_SIDE, 0.25), font_px, bold=True)
        step = 0.034
        self._rows = [
            (
                Line(self.renderer, (MAP_SIDE, 0.21 - step * row), font_px, bold=True),
                Line(self.renderer, (0.5, 0.21 - step * row), font_px),
            )
            for row in range(ROWS)
        ]

    def show(self, part: str) -> None:
        """Turn to the flat map of another part."""
        if part == self.part:
            return
        self.part = part
        layer, uv = self.layers[part], self.flat_maps[part].uv
        if part not in self._sheets:
            self._uv[part] = _lifted(layer.fine.linear @ np.nan_to_num(uv), 0.0)
            faces = _off_seams(self._uv[part], layer.fine.positions, layer.fine.faces)
            sheet = make_mesh(self._uv[part], faces)
            sheet.point_data[PRESSURE] = np.zeros(len(self._uv[part]), np.float32)
            self._sheets[part] = sheet
        # The charts' own vertices: a taxel on a seam is drawn on both of its sides.
        dots = np.concatenate([chart.uv for chart in self.flat_maps[part].charts])
        up = np.tile([0.0, 0.0, 1.0], (len(dots), 1))
        metres = self.fit()
        radius = min(DOT_SHARE * median_spacing(layer.skin.positions), DOT_PX * metres)
        self._sheet.mapper.dataset = self._sheets[part]
        self._dots.mapper.dataset = hexagons(_lifted(dots, 1e-3), up, radius)
        self._border.mapper.dataset = make_lines(_lifted(self._uv[part][:, :2], 5e-4), layer.border)
        title = part.replace("_", " ")
        self._caption.write(f"flat map: {title}")
        charts = len(self.flat_maps[part].charts)
        self._about.write(
            f"{len(layer.skin)} taxels, {charts} {'patch' if charts == 1 else 'patches'}"
        )
        self.refresh()

    def coordinates(self) -> FloatArray:
        """(v, 2) flat-map coordinates of the vertices of the sheet shown [m]."""
        return self._uv[self.part][:, :2]

    def refresh(self) -> None:
        """Colour the map by the pressures that the body shows now."""
        if self.part:
            layer = self.layers[self.part]
            write_values(self._sheets[self.part], PRESSURE, shown(layer.field(layer.pressures)))

    def fit(self) -> float:
        """Place the camera so that the map fills its place in the panel; metres per pixel."""
        uv = self._uv[self.part]
        width, height = self.renderer.GetSize()
        low, high = uv[:, :2].min(axis=0), uv[:, :2].max(axis=0)
        extent = np.maximum(high - low, 1e-6)
        room = np.array([(1 - 2 * MAP_SIDE) * width, (MAP_HIGH - MAP_LOW) * height])
        metres = float((extent / room).max())  # per pixel
        middle = (low + high) / 2
        middle[1] -= ((MAP_LOW + MAP_HIGH) / 2 - 0.5) * height * metres
        camera = self.renderer.GetActiveCamera()
        camera.SetFocalPoint(middle[0], middle[1], 0.0)
        camera.SetPosition(middle[0], middle[1], 1.0)
        camera.SetViewUp(0.0, 1.0, 0.0)
        camera.SetParallelScale(height * metres / 2)
        camera.SetClippingRange(0.5, 1.5)
        self._show_scale(middle, metres)
        return metres

    def _show_scale(self, middle: FloatArray, metres: float) -> None:
        """Draw a bar of a round length below the map."""
        width, height = self.renderer.GetSize()
        length = next((bar for bar in BARS if bar < 0.45 * width * metres), BARS[-1])
        left = middle[0] + (MAP_SIDE - 0.5) * width * metres
        y = middle[1] + (0.32 - 0.5) * height * metres
        bar = np.array([[left, y, 0.0], [left + length, y, 0.0]])
        self._scale.mapper.dataset = make_lines(bar, np.array([[0, 1]]))
        self._length.write(f"{length * 100:g} cm")

    def show_touches(
        self, touches: Sequence[NamedTouch], segments: Sequence[tuple[str, FloatArray]]
    ) -> None:
        """Outline the touches on the part shown and list all of them.

        Parameters
        ----------
        segments : sequence of (label, (k, 2, 2) float)
            Class and outline [m] of each touch on the part shown.
        """
        lines = [_lifted(part.reshape(-1, 2), 2e-3).reshape(-1, 2, 3) for _, part in segments]
        self.outlines.show(lines, [class_colour(label) for label, _ in segments])
        self._head.write("touches" if touches else "no touch")
        for number, (name, where) in enumerate(self._rows):
            if number >= len(touches):
                name.write("")
                where.write("")
                continue
            touch = touches[number]
            name.write(caption(touch), class_colour(touch.label))
            where.write(touch.part.replace("_", " "))


def caption(touch: NamedTouch) -> str:
    """What a touch is called in pictures: its class and how sure that is."""
    return f"{touch.label.replace('_', ' ')} {100 * touch.confidence:.0f} %"


def _lifted(uv: FloatArray, height: float) -> FloatArray:
    return np.column_stack([uv, np.full(len(uv), height)])


def _off_seams(uv: FloatArray, points: FloatArray, faces: IntArray) -> IntArray:
    """Faces that the flat map keeps whole: those on a seam would lie right across it."""
    flat, round_ = edge_lengths(uv, faces).max(axis=1), edge_lengths(points, faces).max(axis=1)
    return np.asarray(faces[flat <= SEAM_STRETCH * round_])

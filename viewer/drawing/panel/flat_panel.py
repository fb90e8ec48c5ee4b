"""The panel beside the body: the flat map of one part, traces of taxels, the list of touches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkImageMapper

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import check_known
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.topology import border_edges
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.touch.contacts.skin_geometry import ACTIVE
from skinmap.touch.images.contact_image import SIZE, paper_images, taxel_grid
from viewer.colours import FAINT, PANEL, RIM, touch_colour
from viewer.drawing.frame.camera import look_down
from viewer.drawing.frame.polydata import add_actor, make_lines
from viewer.drawing.panel.touch_list import TouchList
from viewer.drawing.skin.skin_layer import SkinLayer, flat_places, raised
from viewer.drawing.skin.taxel_drawing import ColourTable, TaxelDrawing
from viewer.drawing.touches.touch_marks import (
    Ground,
    KeptContours,
    Rings,
    TouchMarks,
    centre_on,
    motion_line,
    trail_on,
)
from viewer.drawing.touches.traces import TracePlot
from viewer.drawing.words.shapes import Line, small_font
from viewer.layers import Layer

SIDE = 0.07  # free at both sides, in widths of the panel
HEAD = 4.2  # of the panel, above the map [font heights]
SCALE = 3.2  # below the map, for its scale bar [font heights]
PLOT, PLOT_SHARE = 10.0, 0.22  # height of the traces [font heights], and at most of the panel's
LEAST = 9.0  # the same where the panel is low [font heights]
BARS = (10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)  # lengths of the scale bar [m]
DOT = 0.9e-3  # largest radius of a dot [m]
BORDER_RISE = 2e-3  # of the border above the map, over the discs [m]
LINE_RISE = 3e-3  # of outlines above the map [m]
FLAT = np.eye(4)
IMAGE = 3.8  # height of the contact image in the head [font heights]
FELT = ACTIVE / 255.0  # shares of the scale below which a part is at rest, and has no contact image
LETTER = 0.62  # width of a letter of the caption beside it [font heights]


class FlatPanel:
    """Flat map of one part in a renderer of its own, coloured as the body is.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Its active renderer becomes the panel.
    layers : mapping of str to SkinLayer
        Parts that can be shown.
    flat_maps : mapping of str to FlatMap
    table : ColourTable
        The body's colours.
    font_px : int
        Height of the letters [px].
    contours : KeptContours
        The body's too.
    """

    def __init__(
        self,
        plotter: pv.Plotter,
        layers: Mapping[str, SkinLayer],
        flat_maps: Mapping[str, FlatMap],
        table: ColourTable,
        font_px: int,
        contours: KeptContours,
    ) -> None:
        self.layers, self.flat_maps, self.contours = layers, flat_maps, contours
        self.renderer = plotter.renderer
        self.renderer.SetBackground(*pv.Color(PANEL).float_rgb)
        self.renderer.parallel_projection = True
        self.part = ""
        self.font_px = font_px
        # Where the skin of a part lies on its flat map, what marks on it lie on, and its image.
        self.places = cache(lambda part: flat_places(flat_maps[part], layers[part].fine, DOT))
        self.ground = cache(lambda part: Ground(layers[part], self.places(part)))
        self._grid = cache(lambda part: taxel_grid(flat_maps[part]))
        self.drawing = TaxelDrawing(plotter, table)
        self._border = add_actor(plotter, pv.PolyData(), colour=RIM, width=1.5)
        self._scale = add_actor(plotter, pv.PolyData(), colour=FAINT, width=1.5)
        self.marks, self.rings = TouchMarks(plotter, lit=False), Rings(plotter)
        # The contact image of the second paper, pixel for pixel: not a thing of the scene.
        self._image, self._levels = vtkActor2D(), vtkImageMapper()
        self._image.SetMapper(self._levels)
        self._levels.SetColorWindow(255.0)
        self._levels.SetColorLevel(127.5)
        self._image.SetVisibility(False)
        self.renderer.AddViewProp(self._image)
        self._caption = Line(self.renderer, (SIDE, 0.965), font_px, bold=True)
        self._about = Line(self.renderer, (SIDE, 0.93), font_px, colour=FAINT)
        self._length = Line(self.renderer, (SIDE, 0.31), font_px, colour=FAINT)
        self.list, self.plot = TouchList(self.renderer), TracePlot(self.renderer)
        self._plotted = False
        self._fitted: tuple[object, ...] = ()

    @property
    def actors(self) -> list[pv.Actor]:
        """What may rest between two pictures."""
        return [*self.drawing.actors, self._border, self._scale]

    def show(self, part: str) -> None:
        """Turn to the flat map of another part.

        Raises
        ------
        UnknownNameError
            A part without one.
        """
        check_known("part with a flat map", [part], self.flat_maps)
        if part == self.part:
            return
        self.part = part
        places, skin = self.places(part), self.layers[part].skin
        self.drawing.turn_to(places)
        edges = border_edges(places.faces)
        line = raised(places.points[:, :2], BORDER_RISE)
        self._border.mapper.dataset = make_lines(line, edges)
        charts = len(self.flat_maps[part].charts)
        self._caption.write(f"flat map: {part.replace('_', ' ')}")
        taxels = "1 taxel" if len(skin) == 1 else f"{len(skin):,} taxels"
        self._about.write(f"{taxels}, {charts} {'patch' if charts == 1 else 'patches'}")

    def colour(
        self, layer: Layer, style: str, field: FloatArray | None, values: FloatArray
    ) -> None:
        """Colour the map as the body: values (n,) of its part and their field (v,)."""
        self.drawing.show(layer, style, field, values)
        # Noise at rest is not shown: the image is stretched to its largest pressure.
        least = FELT * layer.limits[1] if layer.name == "pressure" else np.inf
        self._show_image(values if np.nanmax(values, initial=0.0) >= least else np.zeros(0))

    def _show_image(self, pressures: FloatArray) -> None:
        """The contact image of pressures (n,), in the head of the panel; none where all rest."""
        width, height = self.renderer.GetSize()
        rows, columns = (round(side * IMAGE * self.font_px / SIZE[0]) for side in SIZE)
        felt = np.nan_to_num(pressures)
        # Beside the caption; not in a panel that has no room for both.
        caption = SIDE * width + LETTER * self.font_px * len(f"flat map: {self.part}")
        shown = bool((felt > 0).any()) and width > columns + caption
        self._image.SetVisibility(shown)
        if not shown:
            return
        grey = paper_images(self._grid(self.part), felt[None], size=(rows, columns))[0]
        picture = pv.ImageData(dimensions=(columns, rows, 1))
        picture.point_data["grey"] = grey[::-1].ravel()
        self._levels.SetInputData(picture)
        self._image.SetPosition(
            width - columns - self.font_px / 2, height - rows - 0.2 * self.font_px
        )

    def fit(self, font_px: int) -> float:
        """Place map, traces and list in the panel as large as it is; metres per pixel."""
        self.font_px = font_px
        width, height = self.renderer.GetSize()
        key = (self.part, width, height, font_px, self._plotted)
        uv = self.places(self.part).points[:, :2]
        side = SIDE * width
        low = self.list.height(font_px) + font_px
        if self._plotted:
            low += self._plot_height(font_px)
        box = (side, low + SCALE * font_px, width - side, height - HEAD * font_px)
        least, most = uv.min(axis=0), uv.max(axis=0)
        extent = np.maximum(most - least, 1e-6)
        room = np.maximum([box[2] - box[0], box[3] - box[1]], 4.0 * font_px)
        metres = float((extent / room).max())  # per pixel
        if key == self._fitted:
            return metres
        self._fitted = key
        place = np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2])
        middle = (least + most) / 2 - (place - np.array([width, height]) / 2) * metres
        look_down(self.renderer, middle, metres)
        self._write_around(middle, metres, low)
        return metres

    def _plot_height(self, font_px: int) -> float:
        """Of the traces [px]: room for names and axes in any window."""
        share = PLOT_SHARE * float(self.renderer.GetSize()[1])
        return min(PLOT * font_px, max(share, LEAST * font_px))

    def _write_around(self, middle: FloatArray, metres: float, low: float) -> None:
        """Caption above the map, a bar of a round length below it, traces and list."""
        width, height = self.renderer.GetSize()
        font, side = self.font_px, SIDE * width
        small = small_font(font)
        self._caption.style(font, bold=True)
        self._caption.move(side, height - 1.3 * font)
        self._about.style(small)
        self._about.move(side, height - 2.8 * font)
        length = next((bar for bar in BARS if bar < 0.45 * width * metres), BARS[-1])
        y = low + 1.8 * font
        start = middle + (np.array([side, y]) - np.array([width, height]) / 2) * metres
        bar = raised(np.array([start, start + np.array([length, 0.0])]))
        self._scale.mapper.dataset = make_lines(bar, np.array([[0, 1]]))
        self._length.style(small)
        self._length.move(side, y - 0.4 * font)
        self._length.write(f"{length:g} m" if length >= 1 else f"{length * 100:g} cm")
        self.list.place(side, font)
        bottom = self.list.height(font) + font
        self.plot.place((side, bottom, width - side, bottom + self._plot_height(font)), font)

    def show_touches(
        self, touches: Sequence[NamedTouch], time: float, *, faded: bool = False
    ) -> None:
        """Mark the touches on the part shown, and list all of them."""
        ground = self.ground(self.part)
        layer = self.layers[self.part]
        here = [touch for touch in touches if touch.part == self.part]
        lines: list[tuple[FloatArray, str]] = []
        solids: list[tuple[FloatArray, IntArray, str]] = []
        for touch in here:
            lines += trail_on(ground, touch, LINE_RISE)
            lines += motion_line(ground, touch, LINE_RISE)
            outline = self.contours.of(ground, layer, touch, touches, LINE_RISE)
            lines.append((outline, touch_colour(touch)))
            solids += centre_on(ground, touch)
        self.marks.show(lines, solids, faded=faded)
        self.list.show(touches, time, faded=faded)

    def show_selection(self, selection: Mapping[str, IntArray], *, plotted: bool = False) -> None:
        """Ring the selected taxels of the part shown; `plotted` where something else is plotted."""
        taxels = selection.get(self.part)
        shown = [] if taxels is None else [(self.places(self.part), taxels, FLAT)]
        self.rings.show(shown)
        self._plotted = self.list.scant = bool(selection) or plotted
        if not self._plotted:
            self.plot.hide()

    def over_plot(self, x: float, y: float) -> bool:
        """Whether a pixel of the window is on the plot."""
        x0, y0 = self.renderer.GetOrigin()
        left, bottom, right, top = self.plot.outer
        return self._plotted and left <= x - x0 <= right and bottom <= y - y0 <= top

    def point(self, x: float, y: float) -> bool:
        """Tell the values plotted at a pixel of the window; whether that changes the picture."""
        x0, y0 = self.renderer.GetOrigin()
        return self.plot.point(x - x0, y - y0)

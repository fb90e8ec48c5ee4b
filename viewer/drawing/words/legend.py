"""What the colours mean: a bar with values and unit, or the list of categories."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkCellArray
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkRenderer

from skinmap.arrays import FloatArray
from viewer.colours import FAINT, INK, rgb
from viewer.drawing.skin.symbols import SIGNS, sign_quads
from viewer.drawing.skin.taxel_drawing import fade
from viewer.drawing.words.label_places import Box
from viewer.drawing.words.text_lines import Line, small_font
from viewer.layer import Layer

LEFT, BOTTOM = 1.5, 3.4  # of the legend [font heights]
LENGTH, THICK = 13.5, 0.85  # of the bar
SHARE = 0.32  # of the picture's height that the bar takes at most
WIDE = 9.0  # longer lines are broken: beside them stands the body
ROW = 1.55  # between two categories
CLIPPED = ("uncertainty", "distortion")  # their values go beyond the limits
BAR_STEPS = 64
Quad = tuple[FloatArray, NDArray[np.uint8]]


class Legend:
    """Bar or list at the left of a renderer's picture, rebuilt only when it must change."""

    def __init__(self, renderer: vtkRenderer) -> None:
        self.renderer = renderer
        self.box: Box = (0.0, 0.0, 0.0, 0.0)
        self._shown: tuple[object, ...] = ()
        self._lines: list[Line] = []
        self._used, self._font_px = 0, 12
        self._ruler = Line(renderer, (0.0, 0.0), 12)
        self._ruler.write("")
        self._shapes = pv.PolyData()
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._shapes)
        mapper.SetScalarModeToUseCellData()
        self.actor = vtkActor2D()
        self.actor.SetMapper(mapper)
        self.actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
        renderer.AddViewProp(self.actor)

    @property
    def texts(self) -> tuple[str, ...]:
        """What is written now."""
        return tuple(line.text for line in self._lines[: self._used])

    def show(
        self, layer: Layer, font_px: int, notes: Sequence[str] = (), *, faded: bool = False
    ) -> None:
        """Explain a layer, with notes (why there is no value, how many taxels are marked) below."""
        key = (
            layer.name,
            layer.unit,
            layer.limits,
            font_px,
            tuple(notes),
            faded,
            self.renderer.GetSize(),
        )
        if key == self._shown:
            return
        self._shown, self._used, self._font_px = key, 0, font_px
        table = fade(layer.table) if faded else layer.table
        left = LEFT * font_px
        small = small_font(font_px)
        below = [text for note in notes for text in self._broken(note, small)]
        bottom = (BOTTOM + 1.3 * max(len(below) - 1, 0)) * font_px
        if layer.categories:
            quads, top = self._categories(layer, table, left, bottom, font_px)
        else:
            quads, top = self._bar(layer, table, left, bottom, font_px)
        for text in reversed(self._broken(layer.unit, small)):
            self._write(text, left, top, small, FAINT)
            top += 1.3 * small
        top += 0.1 * font_px
        for text in reversed(self._broken(layer.title, font_px, bold=True)):
            self._write(text, left, top, font_px, INK, bold=True)
            top += 1.3 * font_px
        top -= 1.3 * font_px
        for row, text in enumerate(below):
            self._write(text, left, bottom - (1.2 + 1.3 * row) * font_px, small, FAINT)
        for line in self._lines[self._used :]:
            line.write("")
        draw(self._shapes, quads)
        right = max(line.right() for line in self._lines[: self._used])
        low = bottom - (1.2 + 1.3 * len(below)) * font_px
        self.box = (left, low, right + font_px, top + 0.4 * font_px)

    def _broken(self, text: str, font_px: int, *, bold: bool = False) -> list[str]:
        """A text in lines of at most `WIDE` heights of the large letters, broken between words."""
        most = WIDE * self._font_px
        lines: list[str] = []
        for word in text.split():
            longer = f"{lines[-1]} {word}" if lines else word
            if lines and self._measure(longer, font_px, bold) <= most:
                lines[-1] = longer
            else:
                lines.append(word)
        return lines

    def _measure(self, text: str, font_px: int, bold: bool) -> float:
        """How wide a text would be written [px]."""
        self._ruler.style(font_px, bold=bold)
        self._ruler.write(text)
        width = self._ruler.width()
        self._ruler.write("")
        return width

    def _bar(
        self, layer: Layer, table: NDArray[np.uint8], left: float, bottom: float, font: int
    ) -> tuple[list[Quad], float]:
        """A ladder of the table's colours, its values at the right of it."""
        thick = THICK * font
        length = min(LENGTH * font, SHARE * float(self.renderer.GetSize()[1]))
        ink = np.rint(rgb(FAINT) * 255).astype(np.uint8)
        quads = [(_rectangle(left - 1, bottom - 1, thick + 2, length + 2), ink)]
        rows = np.linspace(0, len(table) - 1, BAR_STEPS).round().astype(int)
        step = length / BAR_STEPS
        for k, row in enumerate(rows):
            quads.append((_rectangle(left, bottom + k * step, thick, step), table[row, :3]))
        low, high = layer.limits
        for share in (0.0, 0.5, 1.0):
            value = low + share * (high - low)
            more = "+" if share == 1.0 and layer.name in CLIPPED else ""
            words = f"{value:.0f}" if high - low >= 20 else f"{value:.3g}"
            y = bottom + share * length + 0.5 * font
            self._write(words + more, left + 1.5 * thick, y, font)
        return quads, bottom + length + 2.1 * font

    def _categories(
        self, layer: Layer, table: NDArray[np.uint8], left: float, bottom: float, font: int
    ) -> tuple[list[Quad], float]:
        """A swatch and a name for each category, the first on top."""
        quads: list[Quad] = []
        ink, side = np.rint(rgb(INK) * 255).astype(np.uint8), 1.0 * font
        faint, white = np.rint(rgb(FAINT) * 255).astype(np.uint8), np.full(3, 255, np.uint8)
        count = len(layer.categories)
        for row, (name, colour) in enumerate(zip(layer.categories, table, strict=True)):
            y = bottom + (count - 1 - row) * ROW * font
            quads.append((_rectangle(left - 1, y - 1, side + 2, side + 2), faint))
            quads.append((_rectangle(left, y, side, side), colour[:3]))
            if layer.name == "health" and name in SIGNS:
                middle = np.array([left, y]) + side / 2
                for grown, tint in ((0.12, white), (0.0, ink)):
                    signs = middle + 0.5 * side * sign_quads(name, grown)
                    quads += [(quad, tint) for quad in signs]
            self._write(name, left + 1.6 * side, y + 0.98 * font, font)
        return quads, bottom + count * ROW * font + 0.9 * font

    def _write(
        self, text: str, x: float, y: float, font_px: int, colour: str = INK, *, bold: bool = False
    ) -> None:
        if self._used == len(self._lines):
            self._lines.append(Line(self.renderer, (0.0, 0.0), font_px))
            self._lines[-1].back()
        line = self._lines[self._used]
        self._used += 1
        line.style(font_px, bold=bold)
        line.move(x, y)
        line.write(text, colour)


def _rectangle(left: float, bottom: float, width: float, height: float) -> FloatArray:
    x = np.array([left, left + width, left + width, left])
    y = np.array([bottom, bottom, bottom + height, bottom + height])
    return np.column_stack([x, y])


def draw(mesh: pv.PolyData, quads: Sequence[Quad]) -> None:
    """Rebuild a mesh in picture coordinates from quadrilaterals (4, 2) [px] and their colours."""
    mesh.Initialize()
    if not quads:
        return
    flat = np.concatenate([corners for corners, _ in quads])
    mesh.points = np.column_stack([flat, np.zeros(len(flat))])
    cells = vtkCellArray()
    for start in range(0, len(flat), 4):
        cells.InsertNextCell(4, range(start, start + 4))
    mesh.SetPolys(cells)
    tints = np.array([colour for _, colour in quads]).astype(np.uint8)
    mesh.GetCellData().SetScalars(numpy_to_vtk(tints, deep=True))
    mesh.Modified()

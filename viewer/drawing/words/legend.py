"""What the colours mean: a bar with values and unit, or the list of categories."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer

from viewer.colours import FAINT, INK
from viewer.drawing.skin.taxel_drawing import SIGNS, fade, sign_quads
from viewer.drawing.words.labels import Box
from viewer.drawing.words.shapes import Line, Shape, Shapes, rectangle, small_font, tint
from viewer.layers import Layer

LEFT, BOTTOM = 1.5, 3.4  # of the legend [font heights]
LENGTH, THICK = 13.5, 0.85  # of the bar
SHARE = 0.32  # of the picture's height that the bar takes at most
WIDE = 9.0  # longer lines are broken: beside them stands the body
ROW = 1.55  # between two categories
BAR_STEPS = 64

LOW = 24.0  # height of a picture that has room for notes, in letters


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
        self._shapes = Shapes(renderer)

    @property
    def texts(self) -> tuple[str, ...]:
        """What is written now."""
        return tuple(line.text for line in self._lines[: self._used])

    def show(
        self, layer: Layer, font_px: int, notes: Sequence[str] = (), *, faded: bool = False
    ) -> None:
        """Explain a layer, with notes (why there is no value, how many taxels are marked) below."""
        key = (layer, font_px, tuple(notes), faded, self.renderer.GetSize())
        if key == self._shown:
            return
        self._shown, self._used, self._font_px = key, 0, font_px
        if self.renderer.GetSize()[1] < LOW * font_px:
            notes = ()  # a small picture has no room for them
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
        self._shapes.draw(polygons=quads)
        right = max(line.right() for line in self._lines[: self._used])
        low = bottom - (1.2 + 1.3 * len(below)) * font_px
        self.box = (left, low, right + font_px, top + 0.4 * font_px)

    def hide(self) -> None:
        """Explain nothing."""
        self._shown, self._used = (), 0
        self._shapes.draw()
        for line in self._lines:
            line.write("")

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
    ) -> tuple[list[Shape], float]:
        """A ladder of the table's colours, its values at the right of it."""
        thick = THICK * font
        length = min(LENGTH * font, SHARE * float(self.renderer.GetSize()[1]))
        quads: list[Shape] = [(rectangle(left - 1, bottom - 1, thick + 2, length + 2), tint(FAINT))]
        rows = np.linspace(0, len(table) - 1, BAR_STEPS).round().astype(int)
        step = length / BAR_STEPS
        for k, row in enumerate(rows):
            quads.append((rectangle(left, bottom + k * step, thick, step), table[row, :3]))
        low, high = layer.limits
        for share in (0.0, 0.5, 1.0):
            value = low + share * (high - low)
            words = f"{value:.0f}" if high - low >= 20 else f"{value:.3g}"
            if share in (0.0, 1.0) and layer.cut[int(share)]:
                words = f"{words}+" if share else f"≤{words}"
            y = bottom + share * length + 0.5 * font
            self._write(words, left + 1.5 * thick, y, font)
        return quads, bottom + length + 2.1 * font

    def _categories(
        self, layer: Layer, table: NDArray[np.uint8], left: float, bottom: float, font: int
    ) -> tuple[list[Shape], float]:
        """A swatch and a name for each category, the first on top."""
        quads: list[Shape] = []
        side = 1.0 * font
        count = len(layer.categories)
        for row, (name, colour) in enumerate(zip(layer.categories, table, strict=True)):
            y = bottom + (count - 1 - row) * ROW * font
            quads.append((rectangle(left - 1, y - 1, side + 2, side + 2), tint(FAINT)))
            quads.append((rectangle(left, y, side, side), colour[:3]))
            if layer.name == "health" and name in SIGNS:
                middle = np.array([left, y]) + side / 2
                for grown, ink in ((0.12, "#ffffff"), (0.0, INK)):
                    signs = middle + 0.5 * side * sign_quads(name, grown)
                    quads += [(quad, tint(ink)) for quad in signs]
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

"""Text in front of the picture that comes and goes: the box at a taxel, the help, short notices."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkRenderer

from skinmap.arrays import FloatArray
from viewer.colours import INK, PANEL, rgb
from viewer.drawing.frame.polydata import make_lines
from viewer.drawing.words.text_lines import Line

ASIDE = 1.1  # of the box from what it tells of, in letters
SECONDS = 4.0  # that a notice stays [s]
RING = 0.45  # radius of the mark on a taxel, in letters
CORNERS = 24


class TextBox(Line):
    """Lines of text on a dark ground, whole inside its renderer wherever it is asked to stand."""

    def __init__(self, renderer: vtkRenderer, font_px: int, *, mono: bool = False) -> None:
        super().__init__(renderer, (0.0, 0.0), font_px)
        self.font_px = font_px
        self.actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
        style = self.actor.GetTextProperty()
        style.SetColor(*rgb(PANEL))
        style.SetBackgroundColor(*rgb(INK))
        style.SetBackgroundOpacity(0.93)
        style.SetVerticalJustificationToBottom()
        if mono:
            style.SetFontFamilyToCourier()
        self.write("")

    @property
    def shown(self) -> bool:
        """Whether it is in the picture."""
        return bool(self.actor.GetVisibility())

    def remove(self) -> None:
        """Take it out of the renderer."""
        self.renderer.RemoveViewProp(self.actor)

    def hide(self) -> None:
        """Take it out of the picture."""
        self.write("")

    def scale(self, font_px: int) -> None:
        """Write in letters of another height [px], from the next `tell` on at the right place."""
        self.font_px = font_px
        self.style(font_px)

    def tell(self, lines: Sequence[str], x: float | None = None, y: float | None = None) -> None:
        """Show lines beside a pixel (x, y) of the renderer; in its middle where none is given."""
        self.write("\n".join(f" {line} " for line in lines))
        size = [0.0, 0.0]
        self.actor.GetSize(self.renderer, size)
        width, height = self.renderer.GetSize()
        if x is None or y is None:
            left, bottom = (width - size[0]) / 2, (height - size[1]) / 2
        else:
            aside = ASIDE * self.font_px
            left, bottom = x + aside, y + aside
            if left + size[0] > width:
                left = x - aside - size[0]
            if bottom + size[1] > height:
                bottom = y - aside - size[1]
        left = min(max(left, 0.0), max(width - size[0], 0.0))
        bottom = min(max(bottom, 0.0), max(height - size[1], 0.0))
        self.actor.SetPosition(left, bottom)
        self.to_front()


class Notice(TextBox):
    """One line at the head of the picture that goes away by itself."""

    def __init__(self, renderer: vtkRenderer, font_px: int) -> None:
        super().__init__(renderer, font_px)
        self._until = 0.0

    def say(self, text: str, *, seconds: float = SECONDS) -> None:
        """Show a line for so long."""
        self._until = time.perf_counter() + seconds
        width, height = self.renderer.GetSize()
        self.tell([text], 0.24 * width, 0.885 * height)

    def stay(self) -> None:
        """Keep the line until another takes its place."""
        self._until = float("inf")

    def over(self) -> bool:
        """Take the line away when its time is up; whether that happened just now."""
        if not self.shown or time.perf_counter() < self._until:
            return False
        self.hide()
        return True


class Trace2D:
    """Lines in front of the picture, in pixels of the renderer: a lasso, or a ring at a taxel."""

    def __init__(self, renderer: vtkRenderer, colour: str = INK, width: float = 2.0) -> None:
        self.renderer = renderer
        self._mapper = vtkPolyDataMapper2D()
        self.actor = vtkActor2D()
        self.actor.SetMapper(self._mapper)
        self.actor.GetProperty().SetColor(*rgb(colour))
        self.actor.GetProperty().SetLineWidth(width)
        self.hide()
        renderer.AddViewProp(self.actor)

    @property
    def shown(self) -> bool:
        """Whether it is in the picture."""
        return bool(self.actor.GetVisibility())

    def remove(self) -> None:
        """Take it out of the renderer."""
        self.renderer.RemoveViewProp(self.actor)

    def hide(self) -> None:
        """Take it out of the picture."""
        self._mapper.SetInputData(pv.PolyData())
        self.actor.SetVisibility(False)

    def draw(self, corners: FloatArray) -> None:
        """Show a closed line through corners (k, 2) [px]."""
        k = np.arange(len(corners))
        points = np.column_stack([corners, np.zeros(len(corners))])
        self._mapper.SetInputData(make_lines(points, np.stack([k, np.roll(k, -1)], axis=1)))
        self.actor.SetVisibility(True)

    def ring(self, x: float, y: float, radius: float) -> None:
        """Show a circle [px]."""
        angle = np.arange(CORNERS) * 2 * np.pi / CORNERS
        self.draw(np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)]))

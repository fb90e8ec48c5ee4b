"""Plain text and the colour bar: flat things that stand at a fixed place of the picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyvista as pv
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkPolyDataMapper2D,
    vtkRenderer,
    vtkTextActor,
)

from viewer.colours import FAINT, INK, pressure_colours, rgb
from viewer.label_places import Box
from viewer.polydata import make_mesh

BAR_STEPS = 64


class Line:
    """One line of text, placed in shares of the renderer's width and height.

    Parameters
    ----------
    renderer : vtkRenderer
        Where it appears.
    place : (float, float)
        Left end (or middle) and upper end, 0 to 1.
    font_px : int
        Height of the letters [px].
    """

    def __init__(
        self,
        renderer: vtkRenderer,
        place: tuple[float, float],
        font_px: int,
        *,
        bold: bool = False,
        centred: bool = False,
        colour: str = INK,
    ) -> None:
        self.renderer = renderer
        self.actor = vtkTextActor()
        style = self.actor.GetTextProperty()
        style.SetFontSize(font_px)
        style.SetBold(bold)
        style.SetColor(*rgb(colour))
        style.SetVerticalJustificationToTop()
        if centred:
            style.SetJustificationToCentered()
        self.actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
        self.actor.SetPosition(*place)
        renderer.AddViewProp(self.actor)

    def write(self, text: str, colour: str | None = None) -> None:
        """Replace the text; an empty one hides the line."""
        self.actor.SetInput(text)
        self.actor.SetVisibility(bool(text))
        if colour is not None:
            self.actor.GetTextProperty().SetColor(*rgb(colour))

    def to_front(self) -> None:
        """Draw it after all else: VTK draws flat things in the order in which they came."""
        self.renderer.RemoveViewProp(self.actor)
        self.renderer.AddViewProp(self.actor)

    def width(self) -> float:
        """How wide it is written now [px]."""
        size = [0.0, 0.0]
        self.actor.GetSize(self.renderer, size)
        return size[0] if self.actor.GetVisibility() else 0.0


class ColourBar:
    """The colours of pressures with their values, at the left of the picture."""

    LEFT, BOTTOM, TOP, WIDTH = 0.028, 0.08, 0.34, 0.016  # in picture heights

    def __init__(self, renderer: vtkRenderer, font_px: int) -> None:
        self.renderer = renderer
        self.font_px = font_px
        width, height = renderer.GetSize()
        left, bottom, top, thick = (
            share * height for share in (self.LEFT, self.BOTTOM, self.TOP, self.WIDTH)
        )
        self.box: Box = (left, bottom - font_px, left + 11 * font_px, top + 3.4 * font_px)
        self.actor = vtkActor2D()
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(_strip(left, bottom, thick, top - bottom))
        mapper.SetScalarModeToUseCellData()
        self.actor.SetMapper(mapper)
        renderer.AddViewProp(self.actor)
        self._write(["0", "0.5", "1"], left + 1.5 * thick, bottom, top, (width, height))

    def _write(
        self, values: Sequence[str], x: float, bottom: float, top: float, size: tuple[int, int]
    ) -> None:
        width, height = size
        left = self.LEFT * height
        places = np.linspace(bottom, top, len(values)) + 0.5 * self.font_px
        for value, y in zip(values, places, strict=True):
            Line(self.renderer, (x / width, y / height), self.font_px).write(value)
        title = top + 3.1 * self.font_px
        Line(self.renderer, (left / width, title / height), self.font_px, bold=True).write(
            "pressure"
        )
        small = round(0.8 * self.font_px)
        Line(
            self.renderer,
            (left / width, (title - 1.3 * self.font_px) / height),
            small,
            colour=FAINT,
        ).write("share of full scale")


def _strip(left: float, bottom: float, width: float, height: float) -> pv.PolyData:
    """A ladder of coloured quads [px]."""
    y = bottom + np.linspace(0.0, height, BAR_STEPS + 1)
    points = np.concatenate(
        [np.column_stack([np.full_like(y, x), y, np.zeros_like(y)]) for x in (left, left + width)]
    )
    k = np.arange(BAR_STEPS)
    n = BAR_STEPS + 1
    quads = np.stack([k, k + n, k + n + 1, k + 1], axis=1)
    strip = make_mesh(points, quads)
    strip.GetCellData().SetScalars(numpy_to_vtk(pressure_colours(BAR_STEPS)[:, :3], deep=True))
    return strip

"""Lines and polygons in front of a renderer's picture, in its pixels, each in a colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkCellArray
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkRenderer, vtkTextActor

from skinmap.arrays import FloatArray
from viewer.colours import BACKGROUND, INK, rgb

Shape = tuple[FloatArray, NDArray[Any]]  # points (k, 2) [px] and a colour (3,), 0 to 255


class Shapes:
    """One actor with all of them.

    Parameters
    ----------
    renderer : vtkRenderer
    width : float
        Of lines [px].
    """

    def __init__(self, renderer: vtkRenderer, width: float = 1.0) -> None:
        self.renderer, self.mesh = renderer, pv.PolyData()
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self.mesh)
        mapper.SetScalarModeToUseCellData()
        self.actor = vtkActor2D()
        self.actor.SetMapper(mapper)
        self.actor.GetProperty().SetLineWidth(width)
        self.actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
        renderer.AddViewProp(self.actor)

    def draw(self, lines: Sequence[Shape] = (), polygons: Sequence[Shape] = ()) -> None:
        """Draw these, and nothing that was there before."""
        self.mesh.Initialize()
        shapes = [*lines, *polygons]
        if not shapes:
            return
        flat = np.concatenate([points for points, _ in shapes])
        self.mesh.points = np.column_stack([flat, np.zeros(len(flat))])
        start = 0
        for some, put in ((lines, self.mesh.SetLines), (polygons, self.mesh.SetPolys)):
            cells = vtkCellArray()
            for points, _ in some:
                cells.InsertNextCell(len(points), range(start, start + len(points)))
                start += len(points)
            put(cells)
        tints = np.array([colour for _, colour in shapes]).astype(np.uint8)
        self.mesh.GetCellData().SetScalars(numpy_to_vtk(tints, deep=True))
        self.mesh.Modified()

    def remove(self) -> None:
        """Take the actor out of the renderer."""
        self.renderer.RemoveViewProp(self.actor)


def tint(colour: str) -> FloatArray:
    """(3,) a colour as `Shapes` takes it."""
    return np.rint(255 * rgb(colour))


def rectangle(left: float, bottom: float, width: float, height: float) -> FloatArray:
    """(4, 2) corners."""
    x = np.array([left, left + width, left + width, left])
    y = np.array([bottom, bottom, bottom + height, bottom + height])
    return np.column_stack([x, y])


def disc(x: float, y: float, radius: float, corners: int = 16) -> FloatArray:
    """(corners, 2) points around a place."""
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    return np.array([x, y]) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


# Plain text that stands at a fixed place of the picture.

BACKED = 0.75  # how far the ground covers what is behind a text
SMALL, LEAST = 0.82, 10  # small letters, in heights of the others; smaller ones are not read [px]


def small_font(font_px: int) -> int:
    """Height of the letters of what explains, beside letters so high [px]."""
    return max(round(SMALL * font_px), min(LEAST, font_px))


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
        colour: str = INK,
    ) -> None:
        self.renderer = renderer
        self.actor = vtkTextActor()
        style = self.actor.GetTextProperty()
        style.SetFontSize(font_px)
        style.SetBold(bold)
        style.SetColor(*rgb(colour))
        style.SetVerticalJustificationToTop()
        self.actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
        self.actor.SetPosition(*place)
        renderer.AddViewProp(self.actor)

    def write(self, text: str, colour: str | None = None) -> None:
        """Replace the text; an empty one hides the line."""
        self.actor.SetInput(text)
        self.actor.SetVisibility(bool(text))
        if colour is not None:
            self.actor.GetTextProperty().SetColor(*rgb(colour))

    @property
    def text(self) -> str:
        """What is written now."""
        return str(self.actor.GetInput() or "") if self.actor.GetVisibility() else ""

    def style(self, font_px: int, *, bold: bool = False) -> None:
        """Letters of another height [px]."""
        text = self.actor.GetTextProperty()
        text.SetFontSize(font_px)
        text.SetBold(bold)

    def back(self, colour: str = BACKGROUND, opacity: float = BACKED) -> None:
        """Put a box of a colour behind the text: it stays readable over the body."""
        text = self.actor.GetTextProperty()
        text.SetBackgroundColor(*rgb(colour))
        text.SetBackgroundOpacity(opacity)

    def move(self, x: float, y: float) -> None:
        """Place its left (or middle) upper end [px], y upwards."""
        width, height = self.renderer.GetSize()
        self.actor.SetPosition(x / width, y / height)

    def to_front(self) -> None:
        """Draw it after all else: VTK draws flat things in the order in which they came."""
        self.renderer.RemoveViewProp(self.actor)
        self.renderer.AddViewProp(self.actor)

    def width(self) -> float:
        """How wide it is written now [px]."""
        size = [0.0, 0.0]
        self.actor.GetSize(self.renderer, size)
        return size[0] if self.actor.GetVisibility() else 0.0

    def right(self) -> float:
        """Where it ends [px]."""
        start = self.actor.GetPosition()[0] * float(self.renderer.GetSize()[0])
        return start + self.width()

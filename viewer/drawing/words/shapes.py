"""Lines and polygons in front of a renderer's picture, in its pixels, each in a colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkCellArray
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkRenderer

from skinmap.arrays import FloatArray
from viewer.colours import rgb

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

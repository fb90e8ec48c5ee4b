"""Arrays to VTK meshes and back: the one place where PyVista's loose types meet ours."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike, NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray


def make_mesh(points: ArrayLike, faces: NDArray[Any]) -> pv.PolyData:
    """A mesh of points (n, 3) [m] and polygons (m, k) of equal size k, stored in single floats."""
    mesh, cells = _placed(points, faces)
    mesh.SetPolys(cells)
    return mesh


def make_lines(points: ArrayLike, pairs: NDArray[Any]) -> pv.PolyData:
    """Segments between pairs (k, 2) of points (n, 3) [m]."""
    mesh, cells = _placed(points, pairs)
    mesh.SetLines(cells)
    return mesh


def _placed(points: ArrayLike, corners: NDArray[Any]) -> tuple[pv.PolyData, vtkCellArray]:
    """A mesh with points (n, 3) alone, and cells of corners (m, k) that it is to have."""
    # VTK's own ways: PyVista's checks take longer than all the rest.
    mesh, places, cells = pv.PolyData(), vtkPoints(), vtkCellArray()
    places.SetData(numpy_to_vtk(np.asarray(points, np.float32), deep=True))
    ids = numpy_to_vtkIdTypeArray(np.asarray(corners, np.int64).ravel(), deep=True)
    cells.SetData(corners.shape[1], ids)
    mesh.SetPoints(places)
    return mesh, cells


def add_actor(
    plotter: pv.Plotter,
    mesh: pv.PolyData,
    *,
    colour: str = "white",
    width: float = 1.0,
    lit: bool = False,
) -> pv.Actor:
    """A mesh in a plotter's active renderer, in one colour; lines are so wide [px]."""
    actor = pv.Actor(mapper=pv.DataSetMapper(mesh))
    actor.mapper.SetScalarVisibility(False)
    actor.prop.color, actor.prop.line_width = colour, width
    actor.prop.lighting = lit
    plotter.add_actor(actor, reset_camera=False, render=False)
    return actor


def show_cells(
    target: pv.PolyData, mesh: pv.PolyData, colours: NDArray[np.uint8] | None = None
) -> None:
    """Make a mesh that is drawn another one, with colours (m, 3) of its cells if they differ.

    What was empty and stays so is left alone: it would count as changed and be drawn anew.
    """
    if not (mesh.n_cells or target.n_cells):
        return
    if colours is not None:
        tints = numpy_to_vtk(np.ascontiguousarray(colours), deep=True)
        tints.SetName("colour")
        mesh.GetCellData().SetScalars(tints)
    target.ShallowCopy(mesh)

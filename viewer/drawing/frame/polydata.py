"""Arrays to VTK meshes and back: the one place where PyVista's loose types meet ours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike, NDArray
from vtkmodules.vtkFiltersCore import vtkAppendPolyData


def make_mesh(points: ArrayLike, faces: NDArray[Any]) -> pv.PolyData:
    """A mesh of points (n, 3) [m] and polygons (m, k) of equal size k, stored in single floats."""
    build: Any = pv.PolyData.from_regular_faces
    mesh: pv.PolyData = build(np.asarray(points, np.float32), faces)
    return mesh


def make_lines(points: ArrayLike, pairs: NDArray[Any]) -> pv.PolyData:
    """Segments between pairs (k, 2) of points (n, 3) [m]."""
    build: Any = pv.PolyData
    cells = np.column_stack([np.full(len(pairs), 2), pairs]).ravel()
    mesh: pv.PolyData = build(np.asarray(points, np.float32), lines=cells)
    return mesh


def join(meshes: Sequence[pv.PolyData]) -> pv.PolyData:
    """All meshes as one."""
    append = vtkAppendPolyData()
    for mesh in meshes:
        append.AddInputData(mesh)
    if meshes:
        append.Update()
    joined: pv.PolyData = pv.wrap(append.GetOutput())
    return joined

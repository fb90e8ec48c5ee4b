"""What stands in the way: rays against the links, which move with the joints.

Each link keeps one search structure in its own frame, so that a new pose costs nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonCore import mutable
from vtkmodules.vtkCommonDataModel import vtkPolyData, vtkStaticCellLocator

from skinmap.arrays import FloatArray


class Blocks(Protocol):
    """Anything that can stand between two points."""

    def blocks(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the segment between two points (3,) [m] is interrupted."""


class Surface:
    """One surface that does not move."""

    def __init__(self, surface: vtkPolyData) -> None:
        self._surface = surface
        self._locator: vtkStaticCellLocator | None = None  # made when first asked

    def blocks(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the segment between two points (3,) meets the surface."""
        if self._locator is None:
            self._locator = vtkStaticCellLocator()
            self._locator.SetDataSet(self._surface)
            self._locator.BuildLocator()
        # Typed by VTK as plain numbers, which it could not write to.
        distance: Any = mutable(0.0)
        sub: Any = mutable(0)
        cell: Any = mutable(0)
        hit, local = [0.0] * 3, [0.0] * 3
        return bool(
            self._locator.IntersectWithLine(
                start.tolist(), end.tolist(), 1e-6, distance, hit, local, sub, cell
            )
        )


class Occluders:
    """The links of a body.

    Parameters
    ----------
    meshes : mapping of str to pyvista.PolyData
        In the frame of each link [m].
    poses : mapping of str to (4, 4) float
        T_root_link of each.
    """

    def __init__(self, meshes: Mapping[str, pv.PolyData], poses: Mapping[str, FloatArray]) -> None:
        meshes = {link: mesh for link, mesh in meshes.items() if mesh.n_cells}
        self.links = tuple(meshes)
        self._surfaces = [Surface(mesh) for mesh in meshes.values()]
        bounds = np.array([mesh.bounds for mesh in meshes.values()]).reshape(-1, 3, 2)
        self._centres = bounds.mean(axis=2)
        self._radii = np.linalg.norm(np.ptp(bounds, axis=2), axis=1) / 2
        self.place(poses)

    def place(self, poses: Mapping[str, FloatArray]) -> None:
        """Move the links."""
        T = np.array([poses[link] for link in self.links]).reshape(-1, 4, 4)
        self._to_link = np.linalg.inv(T)
        self._middles = np.einsum("kij,kj->ki", T[:, :3, :3], self._centres) + T[:, :3, 3]

    def blocks(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the segment between two points (3,) [m] meets any link."""
        way = end - start
        share = (self._middles - start) @ way / max(float(way @ way), 1e-12)
        nearest = start + np.clip(share, 0.0, 1.0)[:, None] * way
        near = np.linalg.norm(self._middles - nearest, axis=1) <= self._radii
        for k in np.flatnonzero(near):
            T = self._to_link[k]
            if self._surfaces[k].blocks(T[:3, :3] @ start + T[:3, 3], T[:3, :3] @ end + T[:3, 3]):
                return True
        return False

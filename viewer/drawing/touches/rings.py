"""Rings around selected taxels, on the body and on the flat map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_points
from viewer.colours import INK, TRACES, rgb
from viewer.drawing.frame.polydata import make_mesh
from viewer.drawing.skin.draw_positions import Places, tangents

SIDES = 12
INNER, OUTER = 1.2, 1.65  # in radii of a disc
HALO = 0.22  # white on both sides of the ring, in radii of a disc
RISE = 5e-4  # above the discs [m]


class Rings:
    """All rings of one renderer: one mesh."""

    def __init__(self, plotter: pv.Plotter) -> None:
        self.mesh = pv.PolyData()
        self.actor = pv.Actor(mapper=pv.DataSetMapper(self.mesh))
        self.actor.mapper.SetScalarModeToUseCellData()
        self.actor.prop.lighting = False
        plotter.add_actor(self.actor, reset_camera=False, render=False)

    def show(self, parts: Sequence[tuple[Places, IntArray, FloatArray]]) -> None:
        """Ring taxels (k,) of parts placed by poses (4, 4), and no others."""
        points, colours = [], []
        for places, taxels, pose in parts:
            rows = np.flatnonzero(np.isin(places.taxels, taxels))
            order = np.searchsorted(taxels, places.taxels[rows])
            for inner, outer, rise, white in (
                (INNER - HALO, OUTER + HALO, RISE, True),
                (INNER, OUTER, 2 * RISE, False),
            ):
                centres = places.centres[rows] + rise * places.facing[rows]
                quads = _quads(
                    centres, places.facing[rows], inner * places.disc, outer * places.disc
                )
                turned = transform_points(pose, quads.reshape(-1, 3))
                points.append(turned.reshape(-1, 4, 3))
                tint = np.full((len(rows), 3), 1.0) if white else trace_colours(order, len(taxels))
                colours.append(np.repeat(tint, SIDES, axis=0))
        if not points and self.mesh.n_cells == 0:
            return
        self.mesh.Initialize()
        if not points:
            return
        corners = np.concatenate(points)
        ringed = make_mesh(corners.reshape(-1, 3), np.arange(4 * len(corners)).reshape(-1, 4))
        tints: NDArray[np.uint8] = np.rint(np.concatenate(colours) * 255).astype(np.uint8)
        ringed.GetCellData().SetScalars(numpy_to_vtk(tints, deep=True))
        self.mesh.ShallowCopy(ringed)


def trace_colours(order: IntArray, count: int) -> FloatArray:
    """(k, 3) the colour of each selected taxel's trace; ink where there are too many of them."""
    if count > len(TRACES):
        return np.tile(rgb(INK), (len(order), 1))
    return np.array([rgb(TRACES[k]) for k in order.tolist()]).reshape(-1, 3)


def _quads(centres: FloatArray, normals: FloatArray, inner: float, outer: float) -> FloatArray:
    """(k SIDES, 4, 3) quadrilaterals of rings around centres (k, 3) [m]."""
    right, up = tangents(normals)
    angle = np.arange(SIDES + 1) * 2 * np.pi / SIDES
    way = np.cos(angle)[:, None] * right[:, None] + np.sin(angle)[:, None] * up[:, None]
    near, far = centres[:, None] + inner * way, centres[:, None] + outer * way
    quads = np.stack([near[:, :-1], far[:, :-1], far[:, 1:], near[:, 1:]], axis=2)
    return quads.reshape(-1, 4, 3)

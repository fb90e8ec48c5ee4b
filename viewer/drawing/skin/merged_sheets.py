"""The coloured sheets of all parts as one mesh: a third of the cost where most of them change.

Each actor costs VTK as much as some hundred triangles. A sheet of its own for each part is
cheaper only where few parts change: the others are kept from picture to picture then.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_directions, transform_points
from viewer.drawing.body.shading import light
from viewer.drawing.frame.polydata import make_mesh
from viewer.drawing.skin.skin_view import SkinView
from viewer.drawing.skin.taxel_drawing import (
    ColourTable,
    new_actor,
    new_sheet,
    set_normals,
    with_values,
    write,
)

LEAST = 4  # parts, with fewer of which it is not worth it
MANY, FEW = 0.5, 0.25  # share of the parts that change: drawn as one from the first on
CALM = 250  # pictures with fewer than FEW before each part is drawn by itself again: a change
# of ways draws the whole body anew


class JoinedSheets:
    """One actor in place of the sheets of all parts, while that is cheaper.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Its active renderer is the body's.
    views : mapping of str to SkinView
    table : ColourTable
    """

    def __init__(
        self, plotter: pv.Plotter, views: Mapping[str, SkinView], table: ColourTable
    ) -> None:
        self.views = list(views.values())
        self.actor = new_actor(plotter, pv.PolyData(), table, "point")
        light(self.actor)
        self.actor.SetVisibility(False)
        self.on = False
        self._calm = 0
        self._kinds: tuple[str, ...] = ()
        self._poses: list[FloatArray] = []
        self._points: list[FloatArray] = []
        self._mesh: Any = None

    def choose(self, changed: int) -> bool:
        """Take the place of the parts' own sheets, or give it back; whether it did either.

        Parameters
        ----------
        changed : int
            How many parts have other colours than in the picture before.
        """
        smooth = all(view.field is not None for view in self.views)
        many = changed >= max(LEAST, MANY * len(self.views))
        self._calm = 0 if changed >= FEW * len(self.views) else self._calm + 1
        on = smooth and (many or (self.on and self._calm < CALM))
        turned = on != self.on
        if turned:
            self.on = on
            self.actor.SetVisibility(on)
            for view in self.views:
                view.join(on)
        self.refresh()
        return turned

    def refresh(self) -> None:
        """Follow places, detail and colours of the parts."""
        if not self.on:
            return
        kinds = tuple(view.drawing.sheet_kind for view in self.views)
        if kinds != self._kinds:
            self._kinds = kinds
            self._build()
        self._place()
        values = [
            view.field[view.layer.places.vertex[: len(points)]]
            for view, points in zip(self.views, self._points, strict=True)
            if view.field is not None
        ]
        write(self._mesh, np.concatenate(values))

    def _build(self) -> None:
        """The mesh of sheets as fine as those of the parts."""
        sheets = [new_sheet(view.layer.places, view.drawing.sheet_kind) for view in self.views]
        self._points = [points for points, _ in sheets]
        starts = np.cumsum([0, *(len(points) for points in self._points)])
        faces = [faces + start for (_, faces), start in zip(sheets, starts, strict=False)]
        self._mesh = with_values(make_mesh(np.zeros((starts[-1], 3)), np.concatenate(faces)))
        self._poses = []
        self.actor.mapper.dataset = self._mesh

    def _place(self) -> None:
        """Stand where the parts stand."""
        poses = [view.pose for view in self.views]
        if len(poses) == len(self._poses) and all(
            a is b for a, b in zip(poses, self._poses, strict=True)
        ):
            return
        self._poses = poses
        normals = [view.layer.places.normals for view in self.views]
        points = [
            transform_points(pose, one) for pose, one in zip(poses, self._points, strict=True)
        ]
        turned = [
            transform_directions(pose, one[: len(at)])
            for pose, one, at in zip(poses, normals, points, strict=True)
        ]
        self._mesh.points[:] = np.concatenate(points)
        set_normals(self._mesh, np.concatenate(turned))

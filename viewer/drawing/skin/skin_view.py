"""The skin of one part in the body's renderer: its taxels, edge and back, moved as one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_directions, transform_points
from viewer.colours import RIM
from viewer.drawing.body.body_view import light
from viewer.drawing.frame.polydata import add_actor, make_mesh
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.skin.taxel_drawing import (
    SIGNS,
    ColourTable,
    TaxelDrawing,
    new_actor,
    new_sheet,
    set_normals,
    with_values,
    write,
)
from viewer.layers import STALE, STATES, Layer, Layers

SIGNED = np.array([state in SIGNS for state in STATES])  # whether a taxel of that state has a sign

LEAST = 4  # parts, with fewer of which it is not worth it
MANY, FEW = 0.5, 0.25  # share of the parts that change: drawn as one from the first on
CALM = 250  # pictures with fewer than FEW before each part is drawn by itself again: a change


class SkinView:
    """Actors of one part's skin on the body.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Its active renderer is the body's.
    layer : SkinLayer
    table : ColourTable
    pose : (4, 4) float
        T_root_link.
    backed : bool
        Whether the link is drawn too: it hides the sheet's back.
    """

    def __init__(
        self,
        plotter: pv.Plotter,
        layer: SkinLayer,
        table: ColourTable,
        pose: FloatArray,
        *,
        backed: bool = True,
    ) -> None:
        self.layer = layer
        self._shells: dict[bool, pv.DataSetMapper] = {}
        self.drawing = TaxelDrawing(plotter, table)
        self.drawing.turn_to(layer.places)
        self.actors = list(self.drawing.actors)
        if layer.shell.n_cells:
            quick = layer.edge if backed else layer.shell
            self._shells = {True: pv.DataSetMapper(quick)}
            self._shells[True].SetScalarVisibility(False)
            shell = add_actor(plotter, layer.shell, colour=RIM, lit=True)
            self._shells[False] = shell.mapper
            shell.prop.culling = "back"
            light(shell)
            self.actors.append(shell)
            self._shell = shell
        self.values = np.full(len(layer.skin), np.nan)
        self.empty = True  # nothing is known of any taxel
        self.signs: tuple[IntArray, list[str]] = (np.zeros(0, np.int64), [])
        self.field: FloatArray | None = None
        self._key: tuple[str, str, bool] | None = None
        self._shown: tuple[Layer, str] | None = None
        self.move(pose)

    def move(self, pose: FloatArray) -> None:
        """Stand on the link placed by `pose` (4, 4)."""
        self.pose = pose
        for actor in self.actors:
            actor.user_matrix = pose

    def show(self, layer: Layer, style: str, values: FloatArray) -> bool:
        """Colour the part by values (n,); whether anything changed."""
        key = (layer.name, style, self.drawing.coarse)
        if self._key == key and np.array_equal(values, self.values, equal_nan=True):
            return False
        self._key, self.values = key, values.copy()
        self.empty = not np.isfinite(values).any()
        smooth = style == "surface" and not layer.categories
        self.field = self.layer.field(values) if smooth else None
        self._shown = layer, style
        self._draw()
        return True

    def _draw(self) -> None:
        if self._shown is not None:
            self.drawing.show(*self._shown, self.field, self.values)

    def join(self, joined: bool) -> None:
        """Leave the sheet to who draws those of all parts, or draw it here."""
        self.drawing.joined = joined
        self._draw()

    def detail(self, quick: bool) -> None:
        """Draw fewer triangles, for while the picture moves, or all of them."""
        if quick != self.drawing.quick:
            self.drawing.quick = quick
            if self._shells:
                self._shell.SetMapper(self._shells[quick])
            self._draw()


def signs_of(
    data: Layers, part: str, layer: Layer, values: FloatArray
) -> tuple[IntArray, list[str]]:
    """Taxels whose values mean nothing, with the name of the sign that says why."""
    states, silent = data.watch.known(part), ~np.isfinite(values)
    # A part of which nothing is known is grey.
    if silent.any() and not (silent.all() or layer.grey):
        states = np.where(silent & ~data.watch.unfit(part), STALE, states)
    rows = np.flatnonzero(SIGNED[states])
    return rows, [STATES[state] for state in states[rows]]


# of ways draws the whole body anew


class JoinedSheets:
    """One actor in place of the sheets of all parts, while that is cheaper.

    It takes a third of the time where most of them change: each actor costs VTK as much as some
    hundred triangles. A sheet of its own for each part is cheaper only where few parts change: the
    others are kept from picture to picture then.

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

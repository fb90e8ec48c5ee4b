"""The skin of one part in the body's renderer: its taxels, edge and back, moved as one."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray, IntArray
from viewer.colours import RIM
from viewer.drawing.body.shading import light
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.skin.symbols import SIGNS
from viewer.drawing.skin.taxel_drawing import ColourTable, TaxelDrawing
from viewer.health import STATES
from viewer.layer import Layer
from viewer.layers import Layers

SIGNED = np.array([state in SIGNS for state in STATES])  # whether a taxel of that state has a sign


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
        self.actors, self.resting = list(self.drawing.actors), list(self.drawing.resting)
        if layer.shell.n_cells:
            quick = layer.edge if backed else layer.shell
            self._shells = {False: pv.DataSetMapper(layer.shell), True: pv.DataSetMapper(quick)}
            for mapper in self._shells.values():
                mapper.SetScalarVisibility(False)
            shell = pv.Actor(mapper=self._shells[False])
            shell.prop.color = RIM
            shell.prop.culling = "back"
            light(shell)
            plotter.add_actor(shell, reset_camera=False, render=False)
            self.actors.append(shell)
            self.resting.append(shell)
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
        self.drawing.show(layer, style, self.field, values)
        self._shown = layer, style
        return True

    def join(self, joined: bool) -> None:
        """Leave the sheet to who draws those of all parts, or draw it here."""
        self.drawing.joined = joined
        if self._shown is not None:
            self.drawing.show(*self._shown, self.field, self.values)

    def detail(self, quick: bool) -> None:
        """Draw fewer triangles, for while the picture moves, or all of them."""
        if quick != self.drawing.quick:
            self.drawing.quick = quick
            if self._shells:
                self._shell.SetMapper(self._shells[quick])
            if self._shown is not None:
                self.drawing.show(*self._shown, self.field, self.values)


def signs_of(data: Layers, part: str, values: FloatArray) -> tuple[IntArray, list[str]]:
    """Taxels whose values mean nothing, with the name of the sign that says why."""
    states = data.watch.known(part)
    if not states.any() and np.isfinite(values).all():  # all well, as nearly always
        return np.zeros(0, np.int64), []
    silent = ~np.isfinite(values)
    if silent.any() and not silent.all():  # of a part of which nothing is known its grey says so
        states = np.where(silent & ~data.watch.unfit(part), STATES.index("stale"), states)
    rows = np.flatnonzero(SIGNED[states])
    return rows, [STATES[state] for state in states[rows]]

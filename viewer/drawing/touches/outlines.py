"""Outlines of touches: on the body and on the flat map, coloured by class."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyvista as pv
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray

from skinmap.arrays import FloatArray
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.touch.contacts import ACTIVE
from viewer.colours import rgb
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.touches.contours import Outline, outline

PEAK_SHARE = 0.25  # of a touch's largest pressure: where its outline runs, if above the noise
WIDTH = 3.0  # [px]
HALO = 6.0  # white under the line, so that it shows on any pressure [px]


def touch_field(
    layer: SkinLayer, touch: NamedTouch, others: Sequence[NamedTouch] = ()
) -> tuple[FloatArray, float]:
    """(v,) pressures that one touch is outlined by, without those of other touches; their level."""
    pressures = np.nan_to_num(layer.pressures)
    for other in others:
        if other is not touch and other.part == touch.part:
            pressures[np.setdiff1d(other.taxels, touch.taxels)] = 0.0
    values = layer.soft @ pressures
    touched = np.zeros(len(pressures))
    touched[touch.taxels] = 1.0
    peak = float(values[layer.fine.linear @ touched > 0.0].max(initial=0.0))
    return values, max(ACTIVE, PEAK_SHARE * peak)


def outline_touch(
    layer: SkinLayer, touch: NamedTouch, others: Sequence[NamedTouch] = ()
) -> Outline:
    """Outline of one touch on its part, without the pressures of other touches on it."""
    values, level = touch_field(layer, touch, others)
    return outline(layer.fine.faces, layer.border, values, level)


class OutlineLayer:
    """All outlines of one renderer: one mesh, drawn as coloured lines with a white halo."""

    def __init__(self, plotter: pv.Plotter) -> None:
        self.lines = pv.PolyData()
        self.actors = []
        for width, halo in ((HALO, True), (WIDTH, False)):
            actor = pv.Actor(mapper=pv.DataSetMapper(self.lines))
            actor.prop.line_width = width
            actor.prop.lighting = False
            actor.prop.render_lines_as_tubes = False
            actor.mapper.SetScalarVisibility(not halo)
            # Both lie on the sheet: the halo is pushed back, the line pulled forward.
            actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
            offset = 0.0 if halo else -20.0
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, offset)
            actor.prop.color = "white"
            plotter.add_actor(actor, reset_camera=False, render=False)
            self.actors.append(actor)

    def show(self, segments: Sequence[FloatArray], colours: Sequence[str]) -> None:
        """Draw segments (k, 2, 3) [m] of each touch in its colour; replaces what was there."""
        if not sum(len(part) for part in segments):
            if self.lines.n_cells:
                self.lines.Initialize()
            return
        points = np.concatenate([part.reshape(-1, 3) for part in segments])
        tints = [
            np.tile(np.rint(rgb(colour) * 255).astype(np.uint8), (len(part), 1))
            for part, colour in zip(segments, colours, strict=True)
        ]
        count = len(points) // 2
        self.lines.Initialize()
        # VTK's own ways: PyVista's checks take longer than all the rest.
        places, cells = vtkPoints(), vtkCellArray()
        places.SetData(numpy_to_vtk(points.astype(np.float32), deep=True))
        cells.SetData(2, numpy_to_vtkIdTypeArray(np.arange(2 * count), deep=True))
        self.lines.SetPoints(places)
        self.lines.SetLines(cells)
        colour = numpy_to_vtk(np.concatenate(tints), deep=True)
        colour.SetName("colour")
        self.lines.GetCellData().SetScalars(colour)

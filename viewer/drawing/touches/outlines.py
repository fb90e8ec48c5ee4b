"""Outlines of touches: on the body and on the flat map, coloured by class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray, IntArray
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.touch.contacts.skin_geometry import ACTIVE
from viewer.colours import repeated
from viewer.drawing.frame.polydata import add_actor, make_lines, show_cells
from viewer.drawing.skin.skin_layer import HALF, SkinLayer

PEAK_SHARE = 0.25  # of a touch's largest pressure: where its outline runs, if above the noise
WIDTH = 3.0  # [px]
HALO = 6.0  # white under the line, so that it shows on any pressure [px]


@dataclass(frozen=True, eq=False, slots=True)
class Outline:
    """k segments; each end lies on an edge between two vertices.

    Attributes
    ----------
    first, second : (k, 2) int
        Vertices of the edge on which each end lies.
    share : (k, 2) float
        Where on it, 0 at the first vertex, 1 at the second.
    """

    first: IntArray
    second: IntArray
    share: FloatArray

    def points(self, coordinates: FloatArray) -> FloatArray:
        """(k, 2, d) ends of the segments for coordinates (v, d) of the vertices."""
        share = self.share[:, :, None]
        return np.asarray(coordinates[self.first] * (1 - share) + coordinates[self.second] * share)


def outline(faces: IntArray, border: IntArray, values: FloatArray, level: float) -> Outline:
    """Closed outline of the region where `values` exceed `level`.

    Parameters
    ----------
    faces : (m, 3) int
        Triangles.
    border : (b, 2) int
        Edges of the mesh's border: the outline runs along them where the region reaches them.
    values : (v,) float
        Field at the vertices.
    level : float
        Same unit as `values`.
    """
    above = values > level
    inside = above[faces].sum(axis=1)
    crossed = faces[(inside == 1) | (inside == 2)]
    one = above[crossed].sum(axis=1) == 1
    # The corner that is alone on its side of the level; both crossed edges start there.
    lone = np.argmax(above[crossed] == one[:, None], axis=1)
    row = np.arange(len(crossed))
    apex = np.repeat(crossed[row, lone][:, None], 2, axis=1)
    others = np.stack([crossed[row, (lone + 1) % 3], crossed[row, (lone + 2) % 3]], axis=1)
    edge = border[above[border].any(axis=1)]
    start = np.where(above[edge], edge, edge[:, ::-1])  # an end outside moves to the crossing
    first = np.concatenate([apex, start])
    second = np.concatenate([others, edge])
    return Outline(first, second, _crossing(values[first], values[second], level))


def _crossing(a: FloatArray, b: FloatArray, level: float) -> FloatArray:
    """Where between a and b the level lies; 0 where the two are on one side of it."""
    crosses = (a > level) != (b > level)
    span = np.where(crosses, b - a, 1.0)
    return np.where(crosses, np.clip((level - a) / span, 0.0, 1.0), 0.0)


def touch_field(
    layer: SkinLayer, touch: NamedTouch, others: Sequence[NamedTouch] = ()
) -> tuple[FloatArray, float]:
    """(v,) pressures that one touch is outlined by, and their level.

    Only its own taxels and those beside them count, without those of other touches: whatever else
    the part feels is not this touch. A taxel of which nothing is known is left out like a hole.
    """
    known = np.isfinite(layer.pressures)
    own = np.zeros(len(known))
    own[touch.taxels] = 1.0
    near = (layer.beside @ own) > 0.0
    for other in others:
        if other is not touch and other.part == touch.part:
            near[np.setdiff1d(other.taxels, touch.taxels)] = False
    values = layer.soft @ np.where(near & known, layer.pressures, 0.0)
    if not known.all():
        values[layer.fine.linear @ known.astype(np.float64) < HALF] = 0.0
    peak = float(values[layer.fine.linear @ own > 0.0].max(initial=0.0))
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
        # Both lie on the sheet: the halo is pushed back, the line pulled forward.
        for width, coloured, offset in ((HALO, False, 0.0), (WIDTH, True, -20.0)):
            actor = add_actor(plotter, self.lines, width=width)
            actor.mapper.SetScalarVisibility(coloured)
            actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, offset)
            self.actors.append(actor)

    def show(self, lines: Sequence[tuple[FloatArray, str]]) -> None:
        """Draw segments (k, 2, 3) [m], each some in their colour; replaces what was there."""
        ends = np.concatenate([np.zeros((0, 2, 3)), *(part for part, _ in lines)])
        mesh = make_lines(ends.reshape(-1, 3), np.arange(2 * len(ends)).reshape(-1, 2))
        tints = repeated([colour for _, colour in lines], [len(part) for part, _ in lines])
        show_cells(self.lines, mesh, tints)

"""What both sides of the calibration view draw: coloured hexagons, rings, lines, names, a bar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkPolyDataMapper2D,
    vtkRenderer,
    vtkTextActor,
)

from calibration.commands.anchor_session import AnchorSession
from skinmap.arrays import FloatArray, IntArray
from viewer.colours import INK, rgb
from viewer.drawing.frame.polydata import make_lines, make_mesh
from viewer.drawing.skin.draw_positions import hexagons
from viewer.drawing.words.text_lines import Line

ANCHOR, NEXT, CHOSEN = "#101418", "#d3202f", "#d6249f"  # none is a colour of viridis
UNKNOWN = "#c9ced4"  # taxels before there is a solution
BAR_STEPS = 64
Limits = tuple[float, float]


def viridis(steps: int = 256) -> NDArray[np.uint8]:
    """(steps, 3) colours of predicted errors, the report's: even, and safe for all eyes."""
    from matplotlib import colormaps

    return np.asarray(colormaps["viridis"](np.linspace(0, 1, steps), bytes=True)[:, :3])


def paint(values: FloatArray, limits: Limits) -> NDArray[np.uint8]:
    """(n, 3) colours of values (n,) between two limits."""
    low, high = limits
    return viridis()[np.rint(255 * np.clip((values - low) / (high - low), 0.0, 1.0)).astype(int)]


def round_limits(values_mm: FloatArray) -> Limits:
    """Ends of a scale for values [mm]: the least and the largest, rounded outward to a tenth."""
    low = float(np.floor(10.0 * values_mm.min() + 1e-9)) / 10.0
    high = float(np.ceil(10.0 * values_mm.max() - 1e-9)) / 10.0
    return low, max(high, low + 0.1)


def channels(session: AnchorSession) -> list[str]:
    """What the anchors' taxels are called."""
    return [str(session.channel(anchor.taxel)) for anchor in session.anchors]


def ranked(session: AnchorSession, taxels: IntArray) -> list[str]:
    """What taxels to measure next are called, the best first."""
    names = session.board.channels[taxels]
    return [f"{rank}: {name}" for rank, name in enumerate(names, start=1)]


class Marks:
    """One mesh in a renderer, replaced as often as one likes without a new actor."""

    def __init__(self, plotter: pv.Plotter, colour: str = INK, *, width: float = 2.0) -> None:
        self.actor = pv.Actor(mapper=pv.DataSetMapper(pv.PolyData()))
        self.actor.prop.color = colour
        self.actor.prop.lighting = False
        self.actor.prop.line_width = width
        plotter.add_actor(self.actor, reset_camera=False, render=False)
        self.mesh: pv.PolyData = pv.PolyData()

    def show(self, mesh: pv.PolyData | None, colours: NDArray[np.uint8] | None = None) -> None:
        """Draw a mesh, None for nothing; colours (cells, 3) where it has more than one."""
        self.mesh = pv.PolyData() if mesh is None else mesh
        mapper: Any = self.actor.mapper
        if colours is not None:
            array = numpy_to_vtk(np.ascontiguousarray(colours), deep=True)
            self.mesh.GetCellData().SetScalars(array)
            mapper.SetScalarModeToUseCellData()
            mapper.SetColorModeToDirectScalars()
        mapper.SetScalarVisibility(colours is not None)
        mapper.SetInputData(self.mesh)

    def discs(
        self,
        places: FloatArray,
        normals: FloatArray,
        radius: float,
        colours: NDArray[np.uint8] | None = None,
    ) -> None:
        """A hexagon at each place (k, 3), facing its normal (k, 3) [m]."""
        self.show(hexagons(places, normals, radius) if len(places) else None, colours)

    def rings(self, places: FloatArray, normals: FloatArray, radius: float, share: float) -> None:
        """The rims of such hexagons, `share` of the radius thick."""
        if len(places) == 0:
            self.show(None)
            return
        n = len(places)
        outer = np.asarray(hexagons(places, normals, radius).points)
        inner = np.asarray(hexagons(places, normals, (1.0 - share) * radius).points)
        at = np.arange(6 * n).reshape(n, 6)
        after = np.roll(at, -1, axis=1)
        quads = np.stack([at, after, after + 6 * n, at + 6 * n], axis=2).reshape(-1, 4)
        self.show(make_mesh(np.concatenate([outer, inner]), quads))

    def segments(self, starts: FloatArray, ends: FloatArray) -> None:
        """Lines from starts (k, 3) to ends (k, 3) [m]."""
        if len(starts) == 0:
            self.show(None)
            return
        k = np.arange(len(starts))
        pairs = np.column_stack([k, k + len(k)])
        self.show(make_lines(np.concatenate([starts, ends]), pairs))


class Names:
    """Words that stand beside places of the scene and follow the camera."""

    def __init__(self, renderer: vtkRenderer, font_px: int, colour: str) -> None:
        self.renderer, self.font_px, self.colour = renderer, font_px, colour
        self.actors: list[vtkTextActor] = []
        self.places = np.zeros((0, 3))
        self.normals: FloatArray | None = None
        watched: Any = renderer
        watched.AddObserver("StartEvent", lambda *_: self._turn())

    def show(
        self, words: Sequence[str], places: FloatArray, normals: FloatArray | None = None
    ) -> None:
        """Words beside places (k, 3) [m]; those whose normal (k, 3) looks away are left out."""
        while len(self.actors) < len(words):
            self.actors.append(self._made())
        self.places, self.normals = places, normals
        for number, actor in enumerate(self.actors):
            actor.SetVisibility(number < len(words))
            if number < len(words):
                actor.SetInput(words[number])
                actor.GetPositionCoordinate().SetValue(*places[number])

    def _turn(self) -> None:
        """Hide what is on the far side now."""
        if self.normals is None or len(self.normals) == 0:
            return
        eye = np.array(self.renderer.GetActiveCamera().GetPosition())
        seen = np.einsum("kd,kd->k", eye - self.places, self.normals) > 0.0
        for actor, visible in zip(self.actors, seen, strict=False):
            actor.SetVisibility(bool(visible))

    def _made(self) -> vtkTextActor:
        actor = vtkTextActor()
        style = actor.GetTextProperty()
        style.SetFontSize(self.font_px)
        style.SetBold(True)
        style.SetColor(*rgb(self.colour))
        style.SetBackgroundColor(1.0, 1.0, 1.0)
        style.SetBackgroundOpacity(0.75)
        actor.GetPositionCoordinate().SetCoordinateSystemToWorld()
        self.renderer.AddViewProp(actor)
        return actor


class ErrorBar:
    """The colours of predicted errors with their values [mm], at the left of the picture."""

    LEFT, BOTTOM, TOP, WIDTH = 0.03, 0.12, 0.42, 0.018  # in picture heights

    def __init__(self, renderer: vtkRenderer, font_px: int) -> None:
        width, height = renderer.GetSize()
        left, bottom, top, thick = (
            share * height for share in (self.LEFT, self.BOTTOM, self.TOP, self.WIDTH)
        )
        y = bottom + np.linspace(0.0, top - bottom, BAR_STEPS + 1)
        sides = [np.column_stack([np.full_like(y, x), y, 0 * y]) for x in (left, left + thick)]
        k, n = np.arange(BAR_STEPS), BAR_STEPS + 1
        strip = make_mesh(np.concatenate(sides), np.stack([k, k + n, k + n + 1, k + 1], axis=1))
        strip.GetCellData().SetScalars(numpy_to_vtk(viridis(BAR_STEPS), deep=True))
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(strip)
        mapper.SetScalarModeToUseCellData()
        self.actor = vtkActor2D()
        self.actor.SetMapper(mapper)
        renderer.AddViewProp(self.actor)
        beside = (left + 1.5 * thick) / width
        self.values = [
            Line(renderer, (beside, (place + 0.5 * font_px) / height), font_px)
            for place in np.linspace(bottom, top, 3)
        ]
        place = (left / width, (top + 2.4 * font_px) / height)
        self.title = Line(renderer, place, font_px, bold=True)

    def show(self, limits: Limits | None) -> None:
        """Values between two limits [mm]; None hides the bar."""
        self.actor.SetVisibility(limits is not None)
        self.title.write("" if limits is None else "predicted error (sd) [mm]")
        values = [""] * 3 if limits is None else [f"{v:.2f}" for v in np.linspace(*limits, 3)]
        for line, value in zip(self.values, values, strict=True):
            line.write(value)

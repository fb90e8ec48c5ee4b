"""The link of the calibration view with its patch, and the marks that both sides draw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkRenderingCore import (
    vtkRenderer,
    vtkTextActor,
)

from calibration.commands.anchor_session import AnchorSession
from calibration.commands.results import MM
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.triangles import face_normals, unit
from viewer.colours import BODY, INK, RAW_STOPS, ramp
from viewer.drawing.frame.polydata import make_lines, make_mesh
from viewer.drawing.skin.draw_positions import hexagons
from viewer.drawing.touches.touch_marks import ring_quads
from viewer.drawing.words.text_lines import Line
from viewer.interaction.picking import world_points
from viewer.layers import Layer

ANCHOR, NEXT, CHOSEN = "#101418", "#d3202f", "#d6249f"  # none is a colour of viridis
UNKNOWN = "#c9ced4"  # taxels before there is a solution
Limits = tuple[float, float]


FEATURE_ANGLE = 35.0  # sharper edges stay sharp [deg]
LIFT = 2.0e-3  # of the patch above its taxels [m]: covers lie up to 1 mm above taxels
DISC, RING, BALL = 0.42, 0.75, 0.30  # radii in pitches
TURNED = np.radians([25.0, 20.0])  # the first view looks from beside and above, not flat on
AWAY = 2.6  # of the camera, in lengths of what it looks at
NO_POINT: FloatArray = np.zeros((0, 3))


def error_layer(limits: Limits) -> Layer:
    """Colours of predicted errors between two limits [mm]: viridis, as in the report."""
    about = "error", "predicted error", "sd, mm"
    return Layer(*about, limits, ramp(RAW_STOPS), (), False, "", lambda *_: np.zeros(0))


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
        """Rings instead, `share` of the radius thick."""
        if len(places) == 0:
            self.show(None)
            return
        quads = ring_quads(places, normals, (1.0 - share) * radius, radius)
        self.show(make_mesh(quads.reshape(-1, 3), np.arange(4 * len(quads)).reshape(-1, 4)))

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
            line = Line(self.renderer, (0.0, 0.0), self.font_px, bold=True, colour=self.colour)
            line.back("#ffffff")
            line.actor.GetPositionCoordinate().SetCoordinateSystemToWorld()
            self.actors.append(line.actor)
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


class LinkPicture:
    """The link in a plotter's active renderer.

    Parameters
    ----------
    plotter : pyvista.Plotter
    session : AnchorSession
    font_px : int
        Height of the letters [px].
    """

    def __init__(self, plotter: pv.Plotter, session: AnchorSession, font_px: int) -> None:
        self.session = session
        self.renderer = plotter.renderer
        self.vertices = np.ascontiguousarray(session.link[0], np.float64)
        self.faces = np.ascontiguousarray(session.link[1], np.int64)
        self._mesh = make_mesh(self.vertices, self.faces)
        self.normals = face_normals(self.vertices, self.faces)
        self.pitch = median_spacing(session.board.layout)
        body = pv.Actor(mapper=pv.DataSetMapper(_smooth(self._mesh)))
        body.prop.color = BODY
        body.prop.ambient, body.prop.diffuse = 0.35, 0.65
        plotter.add_actor(body, reset_camera=False, render=False)
        self.patch = Marks(plotter)
        self.lines = Marks(plotter, NEXT, width=3.0)
        self.following = Marks(plotter, NEXT)
        self.chosen = Marks(plotter, CHOSEN)
        self.balls = Marks(plotter, ANCHOR)
        self.names = Names(self.renderer, font_px, ANCHOR)
        self.next_names = Names(self.renderer, font_px, NEXT)

    def show(self) -> Limits | None:
        """Draw what the session has now; the limits of the scale [mm], None without a patch."""
        session, found = self.session, self.session.found
        points = session.task().points if session.anchors else NO_POINT
        radius = BALL * self.pitch
        known = [anchor.taxel for anchor in session.anchors]
        out = self._outward(points)
        if found is not None:  # above the patch, which is drawn above its taxels
            points = points + 1.2 * LIFT * found.normals[known]
        self.balls.show(_balls(points, radius))
        self.names.show(channels(session), points, out)
        chosen = session.point
        self.chosen.show(None if chosen is None else _balls(chosen[None], 1.3 * radius))
        if found is None:
            for marks in (self.patch, self.lines, self.following):
                marks.show(None)
            self.next_names.show([], NO_POINT)
            return None
        limits = round_limits(MM * found.predicted_sd)
        high = found.positions + LIFT * found.normals
        colours = error_layer(limits).colours(MM * found.predicted_sd)
        self.patch.discs(high, found.normals, DISC * self.pitch, colours)
        self.lines.segments(points, found.positions[known] + 1.2 * LIFT * found.normals[known])
        after = found.next_taxels
        self.following.rings(
            high[after] + 0.5 * LIFT * found.normals[after],
            found.normals[after],
            RING * self.pitch,
            0.3,
        )
        self.next_names.show(ranked(session, after), high[after], found.normals[after])
        return limits

    def pick(self, x: float, y: float) -> FloatArray | None:
        """The point (3,) [m] of the link under a pixel; None beside it."""
        near, far = world_points(self.renderer, x, y)
        point, _ = self._mesh.ray_trace(near, far, first_point=True)
        return np.asarray(point, np.float64) if len(point) else None

    def _outward(self, points: FloatArray) -> FloatArray:
        """(k, 3) normals of the link nearest to some points (k, 3)."""
        if len(points) == 0:
            return NO_POINT
        return np.asarray(self.normals[self._mesh.find_closest_cell(points)]).reshape(-1, 3)

    def look(self) -> None:
        """Turn to the patch, or where there is none yet to the link, from where the anchors are."""
        found, anchors = self.session.found, self.session.anchors
        points, out = self.vertices, np.array([1.0, 0.0, 0.3])
        if found is not None:
            points, out = found.positions, found.normals.mean(axis=0)
        elif anchors:
            out = self.session.task().points.mean(axis=0) - self.vertices.mean(axis=0)
        _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        out = unit(out if np.linalg.norm(out) > 1e-9 else axes[-1])
        up = axes[0] - (axes[0] @ out) * out
        up = unit(up if np.linalg.norm(up) > 0.1 else np.cross(out, axes[1]))
        up = up * (np.sign(up[np.argmax(np.abs(up))]) or 1.0)
        side = np.cross(up, out)
        beside, above = np.tan(TURNED)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        camera: Any = self.renderer.GetActiveCamera()
        camera.SetFocalPoint(*middle)
        camera.SetPosition(*(middle + AWAY * size * unit(out + beside * side + above * up)))
        camera.SetViewUp(*up)
        self.renderer.ResetCameraClippingRange()


def _smooth(mesh: pv.PolyData) -> pv.PolyData:
    """The link as it came, shaded smoothly; picks go to the same triangles."""
    return mesh.clean(point_merging=True).compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=FEATURE_ANGLE,
        consistent_normals=False,
    )  # fmt: skip


def _balls(places: FloatArray, radius: float) -> pv.PolyData | None:
    ball = pv.Sphere(radius=radius, theta_resolution=16, phi_resolution=12)
    return pv.PolyData(places).glyph(geom=ball, scale=False, orient=False) if len(places) else None

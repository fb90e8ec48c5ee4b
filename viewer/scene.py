"""The scene: a robot's body with its skin, pressures, named touches, and a flat map beside it.

scene = Scene(robot, meshes, flat_maps)
scene.set_pressures("torso", pressures)
scene.set_touches(touches)
scene.show_flat_map("torso")
scene.screenshot("touches.png")
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike, NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

from skinmap.arrays import FloatArray
from skinmap.errors import UnknownNameError
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.io.output import staged_file
from skinmap.live.touches import NamedTouch
from skinmap.skin.robot import Robot
from skinmap.surface.surface_mesh import SurfaceMesh
from viewer.body import body_meshes, body_points
from viewer.camera import Margins, Target, View, front_view, project
from viewer.colours import BODY, class_colour
from viewer.display import require_opengl
from viewer.flat_panel import FlatPanel, caption
from viewer.framing import Framing, Mode
from viewer.labels import Label, LabelLayer
from viewer.outlines import OutlineLayer, outline_touch
from viewer.overlays import ColourBar, Line
from viewer.plotter import new_plotter
from viewer.polydata import join
from viewer.skin_layer import LINE_LIFT, SkinLayer, add_layer, build_layer, pressure_table

TURN_STEP = 5.0  # how far the camera turns from one frame to the next [deg]
STILL_SAMPLES = 8  # per pixel, for stills only: too slow for live pictures


class Scene:
    """A robot to look at.

    Parameters
    ----------
    robot : Robot
        Its body and skins.
    meshes : mapping of str to SurfaceMesh
        Surface mesh of each part to show.
    flat_maps : mapping of str to FlatMap
        Flat maps for the panel; without any there is no panel.
    angles : mapping of str to float, optional
        Joint angles [rad]; the robot's natural pose by default.
    parts : iterable of str, optional
        Parts to show; all of `meshes` by default.
    links : iterable of str, optional
        Links to draw; all that have a mesh by default.
    window_size : (int, int)
        Width and height [px].
    off_screen : bool
        Draw without a window.
    camera : {"auto", "still", "free"}
        Whether the camera turns by itself to show touches, keeps its view, or obeys the mouse.
    """

    def __init__(
        self,
        robot: Robot,
        meshes: Mapping[str, SurfaceMesh],
        flat_maps: Mapping[str, FlatMap],
        *,
        angles: Mapping[str, float] | None = None,
        parts: Iterable[str] | None = None,
        links: Iterable[str] | None = None,
        window_size: tuple[int, int] = (1400, 900),
        off_screen: bool = True,
        camera: Mode = "auto",
    ) -> None:
        require_opengl(window=not off_screen)
        self.robot = robot
        shown_parts = tuple(meshes) if parts is None else tuple(parts)
        for part in shown_parts:
            if part not in meshes:
                raise UnknownNameError("part with a surface mesh", part, meshes)
        self.poses = robot.body.poses(robot.pose if angles is None else angles)
        self.layers: dict[str, SkinLayer] = {p: build_layer(meshes[p]) for p in shown_parts}
        self._maps = {part: flat_maps[part] for part in shown_parts if part in flat_maps}
        self._touches: tuple[NamedTouch, ...] = ()
        self._targets: list[Target] = []
        self._aimed: tuple[tuple[str, str], ...] = ()
        self._title: str | None = None
        self._changed = True
        self.font_px = max(11, round(window_size[1] / 52))
        self.plotter = new_plotter(window_size, off_screen, panel=bool(self._maps))
        self._table = pressure_table()
        body, points = self._add_body(links)
        for part, layer in self.layers.items():
            for actor in add_layer(self.plotter, layer, self._table):
                actor.user_matrix = self._pose(part)
        self._outlines = OutlineLayer(self.plotter)
        renderer = self.plotter.renderer
        self._heading = Line(renderer, (0.02, 0.975), round(1.25 * self.font_px), bold=True)
        self._bar = ColourBar(renderer, self.font_px)
        self._labels = LabelLayer(renderer, round(1.1 * self.font_px))
        self._body_renderer = renderer
        self.panel = self._add_panel()
        self.framing = self._new_framing(body, points, camera)

    def _add_body(self, links: Iterable[str] | None) -> tuple[pv.PolyData, FloatArray]:
        """Add the links; the placed body comes back, and points of body and skin [m]."""
        meshes = body_meshes(self.robot, links)
        placed = []
        for link, mesh in meshes.items():
            actor = pv.Actor(mapper=pv.DataSetMapper(mesh))
            actor.user_matrix = self.poses[link]
            actor.prop.color = BODY
            actor.prop.ambient, actor.prop.diffuse = 0.25, 0.75
            actor.prop.specular, actor.prop.specular_power = 0.08, 20
            actor.mapper.SetScalarVisibility(False)
            actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
            # Pushed back a little: what lies on the skin is never torn by the cover below it.
            actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(1.0, 8.0)
            self.plotter.add_actor(actor, reset_camera=False, render=False)
            actor.prop.culling = "back"
            placed.append(mesh.transform(self.poses[link], inplace=False))
        skins = [transform_points(self._pose(p), layer.points) for p, layer in self.layers.items()]
        points = np.concatenate([body_points(meshes, self.poses), *skins])
        return join(placed), points

    def _new_framing(self, body: pv.PolyData, points: FloatArray, mode: Mode) -> Framing:
        normals = [
            transform_directions(self._pose(part), layer.skin.normals)
            for part, layer in self.layers.items()
        ]
        front = front_view(np.concatenate([np.zeros((1, 3)), *normals]))
        unit = float(self.font_px)
        margins = Margins(left=9 * unit, right=7 * unit, top=3.2 * unit, bottom=1.6 * unit)
        return Framing(self._body_renderer, body, points, front, margins, mode)

    def _add_panel(self) -> FlatPanel | None:
        if not self._maps:
            return None
        self.plotter.subplot(0, 1)
        panel = FlatPanel(self.plotter, self.layers, self._maps, self._table, self.font_px)
        self.plotter.subplot(0, 0)
        panel.show(next(iter(self._maps)))
        return panel

    def _pose(self, part: str) -> FloatArray:
        return self.poses[self.layers[part].skin.link]

    def _layer(self, part: str) -> SkinLayer:
        if part not in self.layers:
            raise UnknownNameError("part in this scene", part, self.layers)
        return self.layers[part]

    @property
    def front(self) -> View:
        """From where most of the skin is seen."""
        return self.framing.front

    @property
    def touches(self) -> tuple[NamedTouch, ...]:
        """The touches shown now."""
        return self._touches

    def set_pressures(self, part: str, pressures: ArrayLike) -> None:
        """Colour a part by pressures (n,) of 0 to 255 counts.

        Raises
        ------
        UnknownNameError, SkinMismatchError
            A part that is not in the scene, or another number of pressures than taxels.
        """
        self._layer(part).set_pressures(pressures)
        self._changed = True

    def set_touches(self, touches: Iterable[NamedTouch]) -> None:
        """Outline and label these touches, and no others."""
        self._touches = tuple(touches)
        for touch in self._touches:
            self._layer(touch.part)
        self._changed = True

    def show_flat_map(self, part: str) -> None:
        """Show the flat map of one part beside the body."""
        self._layer(part)
        if self.panel is None or part not in self._maps:
            raise UnknownNameError("part with a flat map", part, self._maps)
        self.panel.show(part)
        self._changed = True

    def set_title(self, text: str | None) -> None:
        """Replace the title; None brings back robot, taxels and touches."""
        self._title = text
        self._changed = True

    def look(self, azimuth: float, elevation: float = 12.0) -> None:
        """Look from a direction [deg], azimuth about +z counted from +x; the camera stays there."""
        self.framing.look(View(azimuth, elevation), "still")

    def screenshot(self, path: str | Path) -> Path:
        """Write a still of the scene, smoothed, turned to show its touches."""
        import imageio.v3 as iio

        window: Any = self.plotter.render_window
        window.SetMultiSamples(STILL_SAMPLES)
        try:
            picture = self._draw(step=360.0)
        finally:
            window.SetMultiSamples(0)
        with staged_file(Path(path)) as stage:
            iio.imwrite(stage, picture)
        return Path(path)

    def frame(self) -> NDArray[np.uint8]:
        """One picture (h, w, 3) of a movie: the camera turns a little towards the touches."""
        return self._draw(step=TURN_STEP)

    def close(self) -> None:
        """Give the window and its memory back."""
        self.plotter.close()

    def _draw(self, step: float) -> NDArray[np.uint8]:
        self.update(step)
        window: Any = self.plotter.render_window
        window.Render()
        width, height = window.GetSize()
        pixels = vtkUnsignedCharArray()
        window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
        picture = vtk_to_numpy(pixels).reshape(height, width, 3)[::-1]
        return np.ascontiguousarray(picture)

    def update(self, step: float = TURN_STEP) -> None:
        """Bring outlines, labels, panel and camera up to date; `step` [deg] limits its turn."""
        if self._changed:
            self._targets = [self._target(touch) for touch in self._touches]
            names = tuple((touch.part, touch.label) for touch in self._touches)
            if names != self._aimed:
                self._aimed = names
                self.framing.aim(self._targets)
            self._show_outlines()
        self.framing.turn(step)
        self._show_labels()
        self._changed = False

    def _target(self, touch: NamedTouch) -> Target:
        pose, skin = self._pose(touch.part), self.layers[touch.part].skin
        points = skin.positions[touch.taxels]
        middle = int(np.argmin(np.linalg.norm(points - touch.centre, axis=1)))
        normals = transform_directions(pose, skin.normals[touch.taxels])
        return Target(transform_points(pose, points), normals, middle)

    def _show_outlines(self) -> None:
        world, flat, colours = [], [], []
        for touch in self._touches:
            layer = self.layers[touch.part]
            line = outline_touch(layer, touch, self._touches)
            raised = layer.points + LINE_LIFT * layer.fine.normals
            ends = line.points(raised).reshape(-1, 3)
            world.append(transform_points(self._pose(touch.part), ends).reshape(-1, 2, 3))
            colours.append(class_colour(touch.label))
            if self.panel is not None and touch.part == self.panel.part:
                uv = self.panel.coordinates()
                flat.append((touch.label, line.points(uv)))
        self._outlines.show(world, colours)
        if self.panel is not None:
            self.panel.refresh()
            self.panel.show_touches(self._touches, flat)
        self._heading.write(self._title if self._title is not None else self._summary())

    def _show_labels(self) -> None:
        renderer = self._body_renderer
        centres = np.array([target.points[target.middle] for target in self._targets])
        anchors = project(renderer, centres.reshape(-1, 3))
        labels = [
            Label(
                f"{touch.part}/{number}",
                caption(touch),
                class_colour(touch.label),
                (float(x), float(y)),
                self.framing.hidden(target),
            )
            for number, (touch, target, (x, y)) in enumerate(
                zip(self._touches, self._targets, anchors, strict=True)
            )
        ]
        height = float(renderer.GetSize()[1])
        heading = (0.0, 0.94 * height, self._heading.width() + 2.0 * self.font_px, height)
        self._labels.show(labels, [self._bar.box, heading], self.framing.busy())

    def _summary(self) -> str:
        taxels = sum(len(layer.skin) for layer in self.layers.values())
        count = len(self._touches)
        touches = "1 touch" if count == 1 else f"{count} touches"
        return f"{self.robot.name}   {taxels:,} taxels   {touches}"

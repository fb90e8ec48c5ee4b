"""All that is drawn of a scene, brought up to date with what it shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.flat_map import FlatMap
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.moment import Moment
from skinmap.skin.robot import Robot
from viewer.drawing.body.bare_body import Links
from viewer.drawing.body.body_view import GOOD_PX, BodyView
from viewer.drawing.frame.camera import Margins
from viewer.drawing.frame.framing import Framing, Mode
from viewer.drawing.frame.idle_actors import Resting
from viewer.drawing.frame.plotter import new_plotter
from viewer.drawing.frame.render_cache import RenderCache
from viewer.drawing.panel.flat_panel import FlatPanel
from viewer.drawing.skin.merged_sheets import JoinedSheets
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.skin.skin_view import SkinView, signs_of
from viewer.drawing.skin.taxel_drawing import ColourTable, TaxelDrawing
from viewer.drawing.touches.contour_cache import EVERY, KeptContours
from viewer.drawing.touches.rings import Rings
from viewer.drawing.touches.touch_view import TouchView
from viewer.drawing.touches.traces import History
from viewer.drawing.words.label_places import Box
from viewer.drawing.words.legend import Legend
from viewer.drawing.words.status import Status
from viewer.drawing.words.text_lines import Line
from viewer.layer import Layer
from viewer.layers import Layers

TURN_STEP = 5.0  # how far the camera turns from one frame to the next [deg]
FOOT = 1.6  # free below the body [font heights]
COARSE_PX = 7.0  # spacing of taxels below which a sheet with fewer triangles looks the same [px]
LEAST_FONT, FONTS = 11, 52  # smallest letters [px]; how many stand above each other


@dataclass(eq=False, slots=True)
class Content:
    """What a scene shows.

    Attributes
    ----------
    name : str
        Of the robot.
    data : Layers
    layer : Layer
    style : str
    moment : Moment
    touches : tuple of NamedTouch
    selection : mapping of str to (k,) int
    title : str or None
        None for robot, taxels and touches.
    """

    name: str
    data: Layers
    layer: Layer
    style: str
    moment: Moment
    touches: tuple[NamedTouch, ...] = ()
    selection: Mapping[str, IntArray] = field(default_factory=dict)
    title: str | None = None


class Canvas:
    """Plotter, body, skins, marks, overlays and panel; nothing is added once it stands.

    Parameters
    ----------
    robot : Robot
    layers : mapping of str to SkinLayer
        Parts to draw.
    maps : mapping of str to FlatMap
        For the panel; without any there is none.
    poses : mapping of str to (4, 4) float
        T_root_link.
    links, window_size, off_screen, camera, detail, contour_rate
        As for `viewer.scene.Scene`.
    """

    def __init__(
        self,
        robot: Robot,
        layers: Mapping[str, SkinLayer],
        maps: Mapping[str, FlatMap],
        poses: Mapping[str, FloatArray],
        links: Links,
        window_size: tuple[int, int],
        off_screen: bool,
        camera: Mode,
        *,
        detail: float = GOOD_PX,
        contour_rate: float = EVERY,
    ) -> None:
        self.layers, self.poses = layers, poses
        self.changed, self._moved, self._unsure = True, False, True
        self._foot, self.contours = FOOT, KeptContours(contour_rate)
        self.font_px = font_for(window_size[1])
        self.plotter = new_plotter(window_size, off_screen, panel=bool(maps))
        self.renderer = self.plotter.renderer
        self.table = ColourTable()
        self.body = BodyView(self.plotter, robot, links, poses, tuple(layers), detail)
        self.skins = {
            part: SkinView(
                self.plotter,
                one,
                self.table,
                poses[one.skin.link],
                backed=one.skin.link in self.body.links,
            )
            for part, one in layers.items()
        }
        self.joined = JoinedSheets(self.plotter, self.skins, self.table)
        self.touch_view = TouchView(self.plotter, layers, self.font_px, self.contours)
        self.rings = Rings(self.plotter)
        self.heading = Line(self.renderer, (0.02, 0.975), self.font_px, bold=True)
        self.legend, self.status = Legend(self.renderer), Status(self.renderer)
        self.panel = self._add_panel(maps) if maps else None
        self.framing = Framing(
            self.renderer,
            self.body.occluders,
            lambda: self.body.outline(layers),
            lambda: self.body.points(layers),
            self.body.front(layers),
            self._margins(),
            camera,
        )
        self.cache = self._new_cache()
        self._aimed: tuple[tuple[str, str, int], ...] = ()
        self._seen: tuple[object, ...] = ()

    def _new_cache(self) -> RenderCache:
        """What rests between two pictures: the body, and the skins' edges and dots."""
        props = list(self.body.actors.values())
        for view in self.skins.values():
            props += view.actors
        props.append(self.joined.actor)
        body = Resting(self.renderer, props, self._detail)
        panel = []
        if self.panel is not None:
            panel.append(Resting(self.panel.renderer, self.panel.actors))
        return RenderCache(self.plotter.render_window, body, *panel)

    def _detail(self, quick: bool) -> None:
        """Draw the body quickly, while it moves, or well."""
        self.body.detail(quick)
        for view in self.skins.values():
            view.detail(quick)
        self.joined.refresh()

    def _add_panel(self, maps: Mapping[str, FlatMap]) -> FlatPanel:
        self.plotter.subplot(0, 1)
        panel = FlatPanel(self.plotter, self.layers, maps, self.table, self.font_px, self.contours)
        self.plotter.subplot(0, 0)
        panel.show(next(iter(maps)))
        return panel

    def _margins(self) -> Margins:
        unit = float(self.font_px)
        return Margins(left=11 * unit, right=7 * unit, top=4.6 * unit, bottom=self._foot * unit)

    def reserve(self, foot: float) -> None:
        """Keep so much free below the body [font heights]: something stands there."""
        self._foot = foot
        self.framing.margins = self._margins()

    def move(self, poses: Mapping[str, FloatArray]) -> None:
        """Place links and skins by poses (4, 4)."""
        self.poses = poses
        self.body.move(poses)
        for view in self.skins.values():
            view.move(poses[view.layer.skin.link])
        self.joined.refresh()
        self.framing.move()
        self.changed = self._moved = True

    def draw(
        self, content: Content, history: History, step: float, *, samples: int = 0
    ) -> NDArray[np.uint8]:
        """One picture (h, w, 3) to keep, smoothed by so many samples per pixel."""
        self.update(content, history, step)
        window: Any = self.plotter.render_window
        if samples:
            window.SetMultiSamples(samples)
        try:
            if samples:
                self.cache.draw_all()
            else:
                self.cache.draw(good=True)
            width, height = window.GetSize()
            pixels = vtkUnsignedCharArray()
            window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
        finally:
            if samples:
                window.SetMultiSamples(0)
        picture = vtk_to_numpy(pixels).reshape(height, width, 3)[::-1]
        return np.ascontiguousarray(picture)

    def update(self, content: Content, history: History, step: float) -> None:
        """Bring everything up to date; `step` [deg] limits the camera's turn."""
        self._resize()
        self._choose_sheets()
        if self.changed:
            self._show_skins(content)
            self._show_touches(content)
            self._show_selection(content, history)
        self.framing.turn(step)
        self.status.write(0.02 * self.renderer.GetSize()[0], self.font_px)
        camera = self.renderer.GetActiveCamera()
        seen = (camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewAngle())
        moving = self._moved or seen != self._seen
        self._unsure |= self.changed or moving
        # While the body moves, what hides a centre is not searched for: it would cost too much.
        look = self._unsure and not self._moved
        self.touch_view.write_labels(self.framing, self._avoided(), look=look, moving=moving)
        self._unsure = self._unsure and not look
        self._seen, self.changed, self._moved = seen, False, False

    def _resize(self) -> None:
        """Follow the window's size."""
        height = self.renderer.GetSize()[1]
        font = font_for(height)
        if font != self.font_px:
            self.font_px = font
            self.framing.margins = self._margins()
            self.touch_view.labels.set_font(round(1.1 * font))
            self.changed = True
        self.heading.style(round(1.25 * font), bold=True)
        self.heading.move(0.02 * self.renderer.GetSize()[0], height - 0.9 * font)
        if self.panel is not None:
            self._choose_detail(self.panel.drawing, self.panel.fit(font))

    def _choose_sheets(self) -> None:
        """Draw triangles between taxels as four only where the camera can tell."""
        camera, height = self.renderer.GetActiveCamera(), self.renderer.GetSize()[1]
        metres = 2 * camera.GetDistance() * np.tan(np.radians(camera.GetViewAngle() / 2)) / height
        for view in self.skins.values():
            self._choose_detail(view.drawing, metres)

    def _choose_detail(self, drawing: TaxelDrawing, metres: float) -> None:
        """Follow the size of a pixel [m] in a drawing."""
        limit = COARSE_PX * (1.2 if drawing.coarse else 1.0)  # no flicker at the limit
        coarse = drawing.spacing < limit * metres
        self.changed |= coarse != drawing.coarse
        drawing.coarse = coarse

    def _show_skins(self, content: Content) -> None:
        layer, moment = content.layer, content.moment
        self.table.use(layer, faded=moment.stale and layer.live and not layer.categories)
        changed = 0
        for part, view in self.skins.items():
            values = layer.values(part, moment)
            if view.show(layer, content.style, values):
                changed += 1
                view.signs = signs_of(content.data, part, values)
                view.drawing.sign(*view.signs)
        if self.joined.choose(changed):
            # Nothing moves, though other actors show the same: no coarse picture in between.
            self.cache.forget()
        if self.panel is not None:
            view = self.skins[self.panel.part]
            self.panel.colour(layer, content.style, view.field, view.values)
            self.panel.drawing.sign(*view.signs)
        nothing = all(view.empty for view in self.skins.values())
        marked = sum(len(view.signs[0]) for view in self.skins.values())
        notes = [layer.missing] if nothing else []
        if marked and not nothing and layer.name != "health":
            why = "not calibrated, or " if layer.name == "uncertainty" else ""
            notes.append(f"{marked:,} taxels with a sign: {why}not to be trusted")
        self.legend.show(layer, self.font_px, notes, faded=moment.stale and layer.live)

    def _show_touches(self, content: Content) -> None:
        touches = content.touches
        self.contours.begin(content.moment.time)
        self.touch_view.show(touches, self.poses)
        names = tuple((touch.part, touch.label, touch.identity) for touch in touches)
        if names != self._aimed:
            self._aimed = names
            self.framing.aim(self.touch_view.targets)
        if self.panel is not None:
            self.panel.show_touches(touches, content.moment.time)
        title = content.title
        self.heading.write(self._summary(content) if title is None else title)

    def _show_selection(self, content: Content, history: History) -> None:
        rings = [
            (self.layers[part].places, taxels, self.poses[self.layers[part].skin.link])
            for part, taxels in content.selection.items()
        ]
        self.rings.show(rings)
        if self.panel is not None:
            self.panel.show_selection(content.selection)
            self.panel.fit(self.font_px)
            self.panel.show_traces(content.selection, history)

    def _avoided(self) -> list[Box]:
        """Where labels are better not."""
        height, font = float(self.renderer.GetSize()[1]), self.font_px
        right = self.heading.right() + 2.0 * font
        return [self.legend.box, (0.0, height - 4.8 * font, right, height)]

    def _summary(self, content: Content) -> str:
        taxels = sum(len(layer.skin) for layer in self.layers.values())
        count = len(content.touches)
        touches = "1 touch" if count == 1 else f"{count} touches"
        return f"{content.name}   {taxels:,} taxels   {touches}"


def font_for(height: int) -> int:
    """Height of letters in a picture so high [px]."""
    return max(LEAST_FONT, round(height / FONTS))

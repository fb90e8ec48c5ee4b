"""All that is drawn of a scene, brought up to date with what it shows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

from skinmap.arrays import FloatArray
from skinmap.flat.flat_map import FlatMap
from skinmap.skin.robot import Robot
from viewer.colours import BACKGROUND, rgb
from viewer.drawing.body.bare_body import Links
from viewer.drawing.body.body_view import BodyView
from viewer.drawing.frame.camera import Framing, Margins, Mode
from viewer.drawing.frame.render_cache import RenderCache, Resting
from viewer.drawing.panel.flat_panel import FlatPanel
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.skin.skin_view import JoinedSheets, SkinView, signs_of
from viewer.drawing.skin.taxel_drawing import ColourTable, TaxelDrawing
from viewer.drawing.touches.touch_marks import KeptContours, Rings, TouchView
from viewer.drawing.words.labels import Box
from viewer.drawing.words.legend import Legend
from viewer.drawing.words.shapes import Line

if TYPE_CHECKING:
    from viewer.scene import Scene
import time

from vtkmodules.vtkRenderingCore import vtkRenderer, vtkTextActor

from skinmap.live.contacts.named_touch import Moment
from viewer.colours import FAINT, WARNING
from viewer.drawing.panel.touch_list import known
from viewer.drawing.words.shapes import small_font

ARROWS = "arrows: out of the skin at a touch, longer the harder; along it where it moves"
TURN_STEP = 5.0  # how far the camera turns from one frame to the next [deg]
NAMED = 4  # absent parts at most: a longer list would cover the body
NARROW = 24.0  # width of a picture that has no room beside the body [font heights]
FOOT = 1.6  # free below the body [font heights]
COARSE_PX = 7.0  # spacing of taxels below which a sheet with fewer triangles looks the same [px]
LEAST_FONT, FONTS = 11, 52  # smallest letters [px]; how many stand above each other
WIDTHS = 40  # heights of letters that a picture is wide at least: names are not cut

BODY_SHARE = 0.68  # of the window's width; the rest is the panel
BODY_RISE = 0.62  # of its height, where the panel stands below the body
TALL = 0.95  # windows that are narrower than this, in their heights, have the panel below


@dataclass(frozen=True, slots=True)
class Drawing:
    """How a scene is drawn.

    Attributes
    ----------
    links : iterable of str, "all" or "skin", optional
        Links to draw; all that have a mesh by default, "skin" for those under the parts shown.
    window_size : (int, int)
        Width and height [px].
    off_screen : bool
        Without a window.
    camera : {"auto", "still", "free"}
        Whether the camera turns by itself to show touches, keeps its view, or obeys the mouse.
    cached : bool, optional
        Whether what rests is kept from picture to picture; where software draws by default.
    close : bool
        Whether the camera frames the links that carry the parts, and not the whole body.
    """

    links: Links = None
    window_size: tuple[int, int] = (1400, 900)
    off_screen: bool = True
    camera: Mode = "auto"
    cached: bool | None = None
    close: bool = False


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
    how : Drawing
    """

    def __init__(
        self,
        robot: Robot,
        layers: Mapping[str, SkinLayer],
        maps: Mapping[str, FlatMap],
        poses: Mapping[str, FloatArray],
        how: Drawing,
    ) -> None:
        self.layers, self.poses = layers, poses
        self.changed, self._moved, self._unsure = True, False, True
        self._foot, self.contours = FOOT, KeptContours()
        self.font_px = font_for(*how.window_size)
        self.plotter = new_plotter(how.window_size, how.off_screen, panel=bool(maps))
        self.renderer = self.plotter.renderer
        self.table = ColourTable()
        self.body = BodyView(self.plotter, robot, how.links, poses, tuple(layers))
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
        self.heading.back()
        self.legend, self.status = Legend(self.renderer), Status(self.renderer)
        self.panel = self._add_panel(maps) if maps else None
        self.framing = Framing(
            self.renderer,
            self.body.occluders,
            lambda: self.body.outline(layers, close=how.close),
            lambda: self.body.points(layers),
            self.body.front(layers),
            self._margins(),
            how.camera,
        )
        self.cache = self._new_cache(how.cached)
        self._aimed: tuple[tuple[str, str, int], ...] = ()
        self._signed = -1  # version of the taxels' health that signs are drawn for
        self._seen: tuple[object, ...] = ()

    def _new_cache(self, cached: bool | None) -> RenderCache:
        """What rests between two pictures: the body, and the skins' edges and dots."""
        props = list(self.body.actors.values())
        for view in self.skins.values():
            props += view.actors
        props.append(self.joined.actor)
        body = Resting(self.renderer, props, self._detail)
        shown = [] if self.panel is None else [self.panel]
        panel = (Resting(one.renderer, one.actors) for one in shown)
        return RenderCache(self.plotter.render_window, body, *panel, cached=cached)

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
        left, right = (11, 7) if self.renderer.GetSize()[0] > NARROW * unit else (5, 2)
        return Margins(left * unit, right * unit, top=4.6 * unit, bottom=self._foot * unit)

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

    def draw(self, scene: Scene, step: float, *, samples: int = 0) -> NDArray[np.uint8]:
        """One picture (h, w, 3) to keep, smoothed by so many samples per pixel."""
        self.update(scene, step)
        if samples and self.framing.settle():
            self.touch_view.labels.forget()
            self.update(scene, step)
        window: Any = self.plotter.render_window
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
            window.SetMultiSamples(0)
        picture = vtk_to_numpy(pixels).reshape(height, width, 3)[::-1]
        return np.ascontiguousarray(picture)

    def update(self, scene: Scene, step: float) -> None:
        """Bring everything up to date; `step` [deg] limits the camera's turn."""
        self._resize()
        self._choose_sheets()
        if self.changed:
            self._show_skins(scene)
            self._show_touches(scene)
            self._show_selection(scene)
        self.framing.turn(step)
        self.status.write(0.02 * self.renderer.GetSize()[0], self.font_px)
        camera = self.renderer.GetActiveCamera()
        seen = (camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewAngle())
        moving = self._moved or seen != self._seen
        self._unsure |= self.changed or moving
        # What stands at the foot of the window, its time line, stays free of labels.
        self.touch_view.labels.floor = self._foot * self.font_px if self._foot > FOOT else 0.0
        # While the body moves, what hides a centre is not searched for: it would cost too much.
        look = self._unsure and not self._moved
        self.touch_view.write_labels(
            self.framing, self._avoided(), look=look, moving=moving, faded=self.status.stale
        )
        if self.panel is not None:
            self.panel.list.tell_age(self.status.silent if self.status.stale else None)
        self._unsure = self._unsure and not look
        self._seen, self.changed, self._moved = seen, False, False

    def _resize(self) -> None:
        """Follow the window's size."""
        if self.panel is not None:
            place_panel(self.plotter)
        height = self.renderer.GetSize()[1]
        font = font_for(*self.plotter.window_size)
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

    def _show_skins(self, scene: Scene) -> None:
        layer, moment = scene.layer, scene.moment
        self.table.use(layer, faded=moment.stale and layer.live and not layer.categories)
        changed, version = 0, scene.data.watch.version
        for part, view in self.skins.items():
            values = layer.values(part, moment)
            news = view.show(layer, scene.style, values)
            changed += news
            if news or version != self._signed:
                view.signs = signs_of(scene.data, part, layer, values)
                view.drawing.sign(*view.signs)
        self._signed = version
        if self.joined.choose(changed):
            # Nothing moves, though other actors show the same: no coarse picture in between.
            self.cache.forget()
        if self.panel is not None:
            view = self.skins[self.panel.part]
            self.panel.colour(layer, scene.style, view.field, view.values)
            self.panel.drawing.sign(*view.signs)
        nothing = all(view.empty for view in self.skins.values())
        marked = Counter(name for view in self.skins.values() for name in view.signs[1])
        notes = [layer.missing] if nothing else []
        if not nothing and layer.heard:
            notes += absent(part for part, view in self.skins.items() if view.empty)
        if not nothing and layer.grey:
            notes.append(f"grey: {layer.grey}")
        if any(touch.normal is not None for touch in scene.touches):
            notes.append(ARROWS)
        if marked and not nothing and layer.name != "health":
            states = ", ".join(f"{count:,} {name}" for name, count in marked.items())
            why = "not calibrated, or " if layer.name == "uncertainty" else ""
            notes.append(f"with a sign, {why}not to be trusted: {states}")
        self.legend.show(layer, self.font_px, notes, faded=moment.stale and layer.live)

    def _show_touches(self, scene: Scene) -> None:
        touches = scene.touches
        self.contours.forget()
        self.touch_view.show(touches, self.poses, faded=scene.moment.stale)
        names = tuple((touch.part, touch.label, touch.identity) for touch in touches)
        if names != self._aimed:
            self._aimed = names
            self.framing.aim(self.touch_view.targets)
        if self.panel is not None:
            self.panel.show_touches(touches, scene.moment.time, faded=scene.moment.stale)
        self.heading.write(self._summary(scene) if scene.title is None else scene.title)

    def _show_selection(self, scene: Scene) -> None:
        rings = [
            (self.layers[part].places, taxels, self.poses[self.layers[part].skin.link])
            for part, taxels in scene.selection.items()
        ]
        self.rings.show(rings)
        if self.panel is not None:
            taxels = scene.plot == "taxels"
            self.panel.show_selection(scene.selection, plotted=not taxels)
            self.panel.fit(self.font_px)
            plot = scene.plotted()
            if plot is not None:
                self.panel.plot.show(plot)

    def _avoided(self) -> list[Box]:
        """Where labels are better not."""
        height, font = float(self.renderer.GetSize()[1]), self.font_px
        right = self.heading.right() + 2.0 * font
        return [self.legend.box, (0.0, height - 4.8 * font, right, height)]

    def _summary(self, scene: Scene) -> str:
        taxels = sum(len(layer.skin) for layer in self.layers.values())
        count = len(scene.touches)
        touches = "1 touch" if count == 1 else f"{count} touches"
        return f"{scene.robot.name}   {taxels:,} {'taxel' if taxels == 1 else 'taxels'}   {touches}"


def absent(parts: Iterable[str]) -> list[str]:
    """A note on parts of which nothing comes: they are grey. Few are named, more are counted."""
    names = [part.replace("_", " ") for part in parts]
    if not names:
        return []
    said = ", ".join(names) if len(names) <= NAMED else f"{len(names)} parts"
    return [f"grey: not in this source: {said}"]


def font_for(width: int, height: int) -> int:
    """Height of letters in a picture so wide and high [px]."""
    return max(LEAST_FONT, round(min(height / FONTS, width / WIDTHS)))


def new_plotter(window_size: tuple[int, int], off_screen: bool, *, panel: bool) -> pv.Plotter:
    """A plotter without anything in it; its active renderer is the body's.

    No anti-aliasing and an even background: both cost more than the body in software rendering.
    """
    plotter = pv.Plotter(
        shape=(1, 2) if panel else (1, 1),
        off_screen=off_screen,
        window_size=list(window_size),
        border=False,
        lighting="none",
    )
    window: Any = plotter.render_window
    window.SetMultiSamples(0)
    if panel:
        place_panel(plotter)
        plotter.renderers[1].InteractiveOff()  # the mouse turns the body, not the flat map
    for renderer in plotter.renderers:
        renderer.camera.is_set = True  # we place them: PyVista must not when the window opens
    plotter.subplot(0, 0)
    plotter.renderer.SetBackground(*rgb(BACKGROUND))
    plotter.add_light(pv.Light(light_type="headlight", intensity=0.8))
    fill = pv.Light(light_type="camera light", intensity=0.35)
    fill.position = (-0.6, 1.2, 1.0)  # from above the left shoulder of who looks
    plotter.add_light(fill)
    return plotter


def place_panel(plotter: pv.Plotter) -> None:
    """Put the panel beside the body, or below it in a tall window."""
    width, height = plotter.window_size
    if width < TALL * height:
        body, panel = (0.0, 1.0 - BODY_RISE, 1.0, 1.0), (0.0, 0.0, 1.0, 1.0 - BODY_RISE)
    else:
        body, panel = (0.0, 0.0, BODY_SHARE, 1.0), (BODY_SHARE, 0.0, 1.0, 1.0)
    for renderer, place in zip(plotter.renderers, (body, panel), strict=True):
        if renderer.GetViewport() != place:
            renderer.SetViewport(*place)


# What is said of the stream: its rate, how late it is shown, and that it has fallen silent.

TOLD = 0.5  # between two figures of how old the pictures are [s]
UP = 3.4  # of the line below the picture's upper end [font heights]


class Status:
    """A line below the heading, and a warning where nothing comes any more.

    Parameters
    ----------
    renderer : vtkRenderer
    """

    def __init__(self, renderer: vtkRenderer) -> None:
        self.renderer, self.clock = renderer, time.perf_counter
        self._fresh = self.clock()
        self.stale = False
        self._line = Line(renderer, (0.0, 0.0), 12, colour=FAINT)
        self._warning = Line(renderer, (0.0, 0.0), 12, bold=True)
        self._line.back()
        self._warning.back(WARNING, 1.0)
        self._moment = Moment(0.0, {})
        self._worst, self._since, self._told = 0.0, self._fresh, float("nan")
        self._late = ""

    @property
    def silent(self) -> float:
        """How long nothing has come [s]."""
        return self.clock() - self._fresh

    @property
    def actors(self) -> tuple[vtkTextActor, vtkTextActor]:
        """What it draws with."""
        return self._line.actor, self._warning.actor

    @property
    def texts(self) -> tuple[str, ...]:
        """What is written now."""
        return tuple(line.text for line in (self._line, self._warning) if line.text)

    def take(self, moment: Moment) -> None:
        """Remember what a moment says of its stream."""
        self.stale = moment.stale
        if not moment.stale:
            self._fresh = self.clock()
        self._moment = moment

    def shown(self, age: float) -> None:
        """A picture is on the screen whose sample is so old [s]: NaN where nothing is live."""
        if not known(age):
            self._worst, self._told = 0.0, float("nan")
            return
        self._worst = max(self._worst, age)
        now = self.clock()
        # The worst of a while: it says more than the last, and can be read.
        if now - self._since >= TOLD or not known(self._told):
            self._told, self._worst, self._since = self._worst, 0.0, now

    def mark(self, age: float | None) -> None:
        """Say in the next picture that it comes late, its sample so old [s]; None: it does not."""
        self._late = "" if age is None else f" late: shown after {1e3 * age:.0f} ms "

    @property
    def _about(self) -> str:
        """What is said of the stream."""
        moment, words = self._moment, []
        latency = self._told if known(self._told) else moment.latency
        if known(moment.rate):
            words.append(f"{moment.rate:.0f} samples/s")
        if known(latency):
            words.append(f"shown after {1e3 * latency:.0f} ms")
        if moment.dropped:
            words.append(f"{moment.dropped:,} left out")
        return ",  ".join(words)

    def write(self, left: float, font_px: int) -> None:
        """Bring both lines up to date."""
        height = float(self.renderer.GetSize()[1])
        small = small_font(font_px)
        for line, size in ((self._line, small), (self._warning, font_px)):
            line.style(size, bold=line is self._warning)
            line.move(left, height - UP * font_px)
        self._line.write("" if self.stale or self._late else self._about)
        warning = f" no data for {self.silent:.1f} s " if self.stale else self._late
        self._warning.write(warning, "#ffffff")

"""The scene: a robot's body with its skin, pressures, named touches, and a flat map beside it.

scene = Scene.load("icub", ["torso", "left_arm"])
scene.show_moment(moment)
scene.set_layer("health")
scene.select("torso", [3, 4])
scene.screenshot("touches.png")
"""

from __future__ import annotations

from collections import UserDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import IntArray
from skinmap.display import require_opengl
from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError, check_known
from skinmap.flat.flat_map import FlatMap
from skinmap.io.output import staged_file
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.live.touched_taxels import Touched
from skinmap.skin.robot import Robot
from skinmap.surface.surface_mesh import SurfaceMesh
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.drawing.body.bare_body import posed
from viewer.drawing.frame.camera import Framing, View
from viewer.drawing.frame.canvas import TURN_STEP, Canvas, Drawing
from viewer.drawing.panel.flat_panel import FlatPanel
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.skin.taxel_drawing import check_style
from viewer.drawing.touches.traces import (
    PLOT_KINDS,
    SAMPLES,
    SECONDS,
    Plot,
    plot_taxels,
    plot_touches,
)
from viewer.layers import Layer, Layers, check_values
from viewer.playing.player import Player
from viewer.playing.recent_moments import History

STILL_SAMPLES = 8  # per pixel, for stills only: too slow for live pictures


class LazyMaps(UserDict[str, Any]):
    """Flat maps of prepared skins, each made when first looked at."""

    def __getitem__(self, part: str) -> FlatMap:
        flat: FlatMap = self.data[part].flat
        return flat


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
    data : Layers, optional
        What the skin can show; made of meshes and flat maps by default.
    layer : str
        One of `viewer.layers.LAYERS`.
    style : {"surface", "discs"}
        A coloured surface with a dot for each taxel, or a coloured disc for each.
    drawing
        As `viewer.drawing.frame.canvas.Drawing` has them: links, window_size, off_screen, camera,
        cached, close.

    Attributes
    ----------
    angles : mapping of str to float
        Joint angles shown now [rad]; joints not named stand in the robot's natural pose.
    layer : Layer
        What the skin shows.
    style : str
        How: "surface" or "discs".
    moment : Moment
        What is shown now.
    touches : tuple of NamedTouch
        Those shown now.
    selection : mapping of str to (k,) int
        Selected taxels by part; parts without any are left out.
    plot : str
        What the panel plots, over `plot_seconds` [s].
    player : Player or None
        Remembers what is plotted, where one gives the moments.
    canvas : Canvas
        All that is drawn.
    plotter : pyvista.Plotter
        The window or picture that is drawn in.
    panel : FlatPanel or None
        Beside the body, where there are flat maps.
    framing : Framing
        The camera's behaviour.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        A part, link, layer or style that does not exist; a number out of its range.
    MissingLibraryError
        No OpenGL to draw with.

    Examples
    --------
    >>> import skinmap
    >>> scene = skinmap.Scene.load("kaspar", ["torso"], links="skin")
    >>> scene.set_pressures("torso", [100.0] * 240)
    >>> scene.screenshot("torso.png").name
    'torso.png'
    >>> scene.close()
    """

    def __init__(
        self,
        robot: Robot,
        meshes: Mapping[str, SurfaceMesh],
        flat_maps: Mapping[str, FlatMap],
        *,
        angles: Mapping[str, float] | None = None,
        parts: Iterable[str] | None = None,
        data: Layers | None = None,
        layer: str = "pressure",
        style: str = "surface",
        **drawing: Any,
    ) -> None:
        how = Drawing(**drawing)
        require_opengl(window=not how.off_screen)
        self.robot = robot
        shown = tuple(meshes) if parts is None else tuple(parts)
        check_known("part with a surface mesh", shown, meshes)
        self.angles: Mapping[str, float] = dict(angles or {})
        self.poses = posed(robot, self.angles)
        self.layers: dict[str, SkinLayer] = {part: SkinLayer(meshes[part]) for part in shown}
        if data is None:
            data = Layers({p: PreparedSkin.of(meshes[p], flat_maps.get(p)) for p in shown})
        self.data = data
        self.layer: Layer = data.get(layer)
        self.style: str = check_style(style)
        sizes = {part: len(one.skin) for part, one in self.layers.items()}
        self.moment = Moment(float("nan"), {part: np.zeros(n) for part, n in sizes.items()})
        self.touches: tuple[NamedTouch, ...] = ()
        self.selection: Mapping[str, IntArray] = {}
        self.title: str | None = None
        self.past = History(SECONDS, SAMPLES, spread=True)
        self.player: Player | None = None
        self.plot, self.plot_seconds = "taxels", SECONDS
        maps = LazyMaps({part: data.skins[part] for part in shown if part in flat_maps})
        self.canvas = Canvas(robot, self.layers, maps, self.poses, how)
        self.plotter = self.canvas.plotter
        self.panel: FlatPanel | None = self.canvas.panel
        self.framing: Framing = self.canvas.framing

    @classmethod
    def load(
        cls,
        robot: Robot | str | Path = "icub",
        parts: Iterable[str] | None = None,
        *,
        covariances: Mapping[str, ArrayLike] | None = None,
        healths: Mapping[str, ArrayLike] | None = None,
        **options: Any,
    ) -> Scene:
        """A scene of a robot by name, its skins prepared on the way; no window is needed.

        Parameters
        ----------
        robot : Robot, str or path
            As `skinmap.load_robot` takes it.
        parts : iterable of str, optional
            All of the robot's parts by default.
        covariances, healths : mapping, optional
            As `viewer.layers.Layers` takes them.
        options
            As `Scene` takes them.
        """
        import skinmap

        loaded = robot if isinstance(robot, Robot) else skinmap.load_robot(str(robot))
        names = loaded.parts if parts is None else tuple(parts)
        skins = {part: PreparedSkin(loaded.skin(part)) for part in names}
        data = Layers(skins, covariances=covariances, healths=healths)
        meshes = {part: skin.mesh for part, skin in skins.items()}
        return cls(loaded, meshes, LazyMaps(skins), data=data, **options)

    @property
    def font_px(self) -> int:
        """Height of the letters [px]."""
        return self.canvas.font_px

    @property
    def front(self) -> View:
        """From where most of the skin is seen."""
        return self.framing.front

    def show_moment(self, moment: Moment) -> None:
        """Show a moment: its pressures, touches and joint angles; parts not shown are left out.

        Raises
        ------
        SkinMismatchError
            Values or touches of another skin; nothing of the moment is shown then.
        UnknownNameError, InvalidArrayError
            A joint that the body lacks, or an angle beyond its limits.
        """
        touches = check_moment(moment, self.layers)
        if moment.angles and dict(moment.angles) != self.angles:
            self.set_pose(moment.angles)
        if self.panel is not None and np.isnan(self.moment.time):
            maps = list(self.panel.flat_maps)  # of a part that the source has, unless one is chosen
            here = [part for part in maps if part in moment.pressures]
            if here and self.panel.part == maps[0]:
                self.show_flat_map(here[0])
        self.data.observe(moment)
        felt = self.data.felt(moment)
        for part, pressures in felt.items():
            self.layers[part].set_pressures(pressures)
        self.moment = moment
        self.touches = self._touches(touches)
        if self.player is None and np.isfinite(moment.time) and not moment.stale:
            self.past.add(replace(moment, pressures=felt, raw={}, block=None))
        self.canvas.status.take(moment)
        self.canvas.changed = True

    def follow(self, moment: Moment) -> None:
        """Show a moment, with the flat map of the part that was touched last."""
        self.show_moment(moment)
        if self.panel is not None:
            for touch in reversed(moment.touches):
                if touch.part in self.panel.flat_maps:
                    self.show_flat_map(touch.part)
                    return

    def show_sums(self, touched: Touched | None) -> None:
        """Name the recordings that the layer "touched" counts, and turn to the part touched most.

        No moment is shown then.
        """
        if touched is None or not touched.parts:
            return
        names, several = touched.recordings, len(touched.recordings) > 1
        source = f"{len(names)} recordings" if several else names[0]
        self.set_title(f"{self.robot.name}   {source}   {touched.seconds:,.0f} s")
        most = max(touched.parts, key=lambda part: int(touched.parts[part].count.sum()))
        if self.panel is not None and most in self.panel.flat_maps:
            self.show_flat_map(most)
            self.panel.list.tell(f"{touched.parts[most].count.max()} touches of a taxel at most")

    def set_pressures(self, part: str, pressures: ArrayLike) -> None:
        """Take pressures (n,) of 0 to 255 counts for one part.

        Raises
        ------
        UnknownNameError, SkinMismatchError
            A part that is not in the scene, or another number of pressures than taxels.
        """
        layer = check_part(part, self.layers)
        layer.set_pressures(pressures)
        felt = {**self.moment.pressures, part: layer.pressures}
        self.moment = replace(self.moment, pressures=felt)
        self.canvas.changed = True

    def set_touches(self, touches: Iterable[NamedTouch]) -> None:
        """Outline and label these touches, and no others."""
        chosen = tuple(touches)
        check_touches(chosen, self.layers)
        self.touches = chosen
        self.canvas.changed = True

    def set_layer(self, name: str) -> None:
        """Show another of `viewer.layers.LAYERS` on body and flat map.

        Raises
        ------
        UnknownNameError
            No such layer.
        """
        others = "difference" in (self.layer.name, name)
        self.layer = self.data.get(name)
        if others:
            self.touches = self._touches(check_moment(self.moment, self.layers))
        self.canvas.changed = True

    def _touches(self, own: tuple[NamedTouch, ...]) -> tuple[NamedTouch, ...]:
        """Touches that the layer shows, of the moment's own."""
        if self.layer.name != "difference" or self.data.pair is None:
            return own
        shown = self.data.pair.touches(self.moment.time)
        return tuple(one for one in shown if one.part in self.layers)

    def set_plot(self, plot: str) -> None:
        """Plot the chosen "taxels" in the panel, or one of `COURSES` of the touches.

        Raises
        ------
        UnknownNameError
            Another plot.
        """
        check_known("plot", [plot], PLOT_KINDS)
        self.plot = plot
        self.canvas.changed = True

    def plotted(self) -> Plot | None:
        """What is plotted, up to the moment shown; None where nothing is to be."""
        if self.plot == "taxels" and not self.selection:
            return None
        part = next(iter(self.selection), "")
        if self.panel is not None and self.panel.part in self.selection:
            part = self.panel.part
        return make_plot(
            self.past.moments() if self.player is None else self.player,
            self.moment.time, self.plot_seconds, self.plot, self.selection, part, self.data,
        )  # fmt: skip

    def set_style(self, style: str) -> None:
        """Draw the skin as "discs", one for each taxel, or as a coloured "surface".

        Raises
        ------
        UnknownNameError
            Another style.
        """
        self.style = check_style(style)
        self.canvas.changed = True

    def select(self, part: str, taxels: ArrayLike) -> None:
        """Mark taxels (k,) of a part on body and flat map, instead of those marked before.

        Raises
        ------
        UnknownNameError, InvalidArrayError
            A part or taxels that are not there.
        """
        chosen = check_taxels(taxels, part, len(check_part(part, self.layers).skin))
        others = {name: rows for name, rows in self.selection.items() if name != part}
        self.selection = {**others, part: chosen} if chosen.size else others
        self.canvas.changed = True

    def set_pose(self, angles: Mapping[str, float]) -> None:
        """Move the body to joint angles [rad]; joints not named take their natural angle.

        Raises
        ------
        UnknownNameError, InvalidArrayError
            A joint that the body lacks, or an angle beyond its limits (names joint and limits).
        """
        self.poses = posed(self.robot, angles)
        self.angles = dict(angles)
        self.canvas.move(self.poses)

    def show_flat_map(self, part: str) -> None:
        """Show the flat map of one part beside the body."""
        check_part(part, self.layers)
        if self.panel is None:
            raise UnknownNameError("part with a flat map", part, ())
        self.panel.show(part)
        self.canvas.changed = True

    def set_title(self, text: str | None) -> None:
        """Replace the title; None brings back robot, taxels and touches."""
        self.title = text
        self.canvas.changed = True

    def look(self, azimuth: float, elevation: float = 12.0) -> None:
        """Look from a direction [deg], azimuth about +z counted from +x; the camera stays there."""
        self.framing.look(View(azimuth, elevation), "still")

    def screenshot(self, path: str | Path) -> Path:
        """Write a still of the scene, smoothed, turned to show its touches.

        A figure of lines and letters for `.svg` and `.pdf` (`viewer.export.vector_figure`).
        """
        from PIL import Image

        if Path(path).suffix.lower() in (".svg", ".pdf"):
            from viewer.export.vector_figure import write_figure

            return write_figure(self, Path(path))
        picture = self.canvas.draw(self, 360.0, samples=STILL_SAMPLES)
        with staged_file(Path(path)) as stage:
            Image.fromarray(picture).save(stage)
        return Path(path)

    def frame(self, step: float = TURN_STEP) -> NDArray[np.uint8]:
        """One picture (h, w, 3) of a movie: the camera turns `step` [deg] towards the touches."""
        return self.canvas.draw(self, step)

    def update(self, step: float = TURN_STEP) -> None:
        """Bring all that is drawn up to date; `step` [deg] limits the camera's turn."""
        self.canvas.update(self, step)

    def refresh(self, step: float = TURN_STEP) -> bool:
        """Bring the window up to date; False where nothing had to be drawn.

        While camera or body move, the body is drawn coarser; it is refined once they rest.
        """
        self.update(step)
        return self.canvas.cache.draw()

    def close(self) -> None:
        """Give the window and its memory back."""
        self.canvas.cache.close()
        self.plotter.close()


def make_plot(
    source: Player | Sequence[Moment], now: float, span: float, plot: str,
    selection: Mapping[str, IntArray], part: str, data: Layers,
) -> Plot:  # fmt: skip
    """The chosen taxels of a part, or a course of the touches, over `span` seconds up to a time.

    A player gives what it remembers of them, and the levels of a taxel that is chosen alone.
    """
    levels: Mapping[str, float] = {}
    if isinstance(source, Player):
        moments: Sequence[Moment] = source.recall(now - span, now)
        taxels = selection.get(part)
        if plot == "taxels" and taxels is not None and len(taxels) == 1:
            levels = source.levels(part, int(taxels[0]))
    else:
        moments = [one for one in source if now - span <= one.time <= now]
    if plot != "taxels":
        return plot_touches(moments, now, span, plot, selection)  # type: ignore[arg-type]
    skin = data.skins[part].skin
    return plot_taxels(
        moments, now, span, part, selection[part], skin.channels,
        unfit=data.watch.unfit(part), levels=levels,
    )  # fmt: skip


def check_part(part: str, layers: Mapping[str, SkinLayer]) -> SkinLayer:
    """The layer of a part.

    Raises
    ------
    UnknownNameError
        No such part.
    """
    check_known("part in this scene", [part], layers)
    return layers[part]


def check_moment(moment: Moment, layers: Mapping[str, SkinLayer]) -> tuple[NamedTouch, ...]:
    """The touches of a moment that lie on the parts shown.

    Raises
    ------
    SkinMismatchError
        None of its parts is shown, or values or touches of another skin.
    """
    if moment.pressures and not any(part in layers for part in moment.pressures):
        raise SkinMismatchError(
            f"a moment of {', '.join(moment.pressures)} for a scene of {', '.join(layers)}"
        )
    for values in (moment.pressures, moment.raw):
        for part in values:
            if part in layers:
                check_values(values[part], len(layers[part].skin), part)
    touches = tuple(touch for touch in moment.touches if touch.part in layers)
    check_touches(touches, layers)
    return touches


def check_touches(touches: Iterable[NamedTouch], layers: Mapping[str, SkinLayer]) -> None:
    """Refuse touches of parts or taxels that are not there.

    Raises
    ------
    UnknownNameError, SkinMismatchError
    """
    for touch in touches:
        n = len(check_part(touch.part, layers).skin)
        if touch.taxels.size and not 0 <= touch.taxels.min() <= touch.taxels.max() < n:
            raise SkinMismatchError(
                f"a touch of taxels {touch.taxels.min()} to {touch.taxels.max()} for the {n} "
                f"of {touch.part!r}"
            )


def check_taxels(taxels: ArrayLike, part: str, n: int) -> IntArray:
    """Different taxels (k,) of a part with n of them, in their order.

    Raises
    ------
    InvalidArrayError
        Taxels that are not there.
    """
    chosen = np.unique(np.asarray(taxels, np.int64))
    if chosen.size and not 0 <= chosen[0] <= chosen[-1] < n:
        raise InvalidArrayError(
            f"part {part!r} has taxels 0 to {n - 1}, not {chosen[0]} to {chosen[-1]}"
        )
    return chosen

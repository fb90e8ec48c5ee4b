"""The calibration view: a flat board beside its link, clicks that become anchors, the patch.

All of it works without a screen; `run` adds mouse, keys and the loop. A patch is solved in a
second or two, for which the window waits.
"""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera

from calibration.commands.anchor_session import AnchorSession
from calibration.commands.calibration_options import Outputs
from calibration.commands.results import MM
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import SkinError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.triangles import face_normals, unit
from viewer.colours import BODY, FAINT, INK, PANEL, RAW_STOPS, ramp, rgb
from viewer.drawing.frame.camera import look_down, world_points
from viewer.drawing.frame.canvas import BODY_SHARE, new_plotter
from viewer.drawing.frame.polydata import add_actor, make_lines, make_mesh, show_cells
from viewer.drawing.skin.skin_layer import LIFT, polygons
from viewer.drawing.touches.touch_marks import ring_quads
from viewer.drawing.words.legend import Legend
from viewer.drawing.words.shapes import Line
from viewer.layers import Layer

SIZE = (1280, 800)  # of the window [px]
GOOD, DOUBTFUL = "#00795c", "#b04a00"
STATUS_WORDS = {
    "ok": "may be used as it is",
    "low_coverage": "the anchors cover too little of the patch",
    "ambiguous": "the anchors do not settle where the patch is",
    "unobservable": "the patch can still move",
    "not_settled": "the search ended before it came to rest",
}
LINES = 5  # of reasons
LETTER = 0.56  # mean width of a letter, in heights
LOW, HIGH, SIDE = 0.30, 0.90, 0.08  # where the board lies, in shares of the panel
ANCHOR, NEXT, CHOSEN = "#101418", "#d3202f", "#d6249f"  # none is a colour of viridis
UNKNOWN = "#c9ced4"  # taxels before there is a solution
FEATURE_ANGLE = 35.0  # sharper edges stay sharp [deg]
DISC, RING, BALL = 0.42, 0.75, 0.30  # radii in pitches
FLAT_RING = 0.72  # on the board
TURNED = np.radians([25.0, 20.0])  # the first view looks from beside and above, not flat on
AWAY = 2.6  # of the camera, in lengths of what it looks at
Limits = tuple[float, float]
NONE: IntArray = np.zeros(0, np.int64)
NO_POINT: FloatArray = np.zeros((0, 3))
KEYS = (
    "click a taxel here, then its point on the link",
    "(or the point first); drag turns the link",
    "s  solve        u  take back      x  remove anchor",
    "w  save         W  save whatever the status",
    "r  look at the patch              q  close",
)

STILL = 4  # a mouse that moved less than this between press and release has clicked [px]
IDLE = 0.02  # between two looks at mouse and keys [s]


def error_layer(limits: Limits) -> Layer:
    """Colours of predicted errors between two limits [mm]: viridis, as in the report."""
    about = "error", "predicted error", "sd, mm"
    return Layer(*about, limits, ramp(RAW_STOPS), lambda *_: np.zeros(0))


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
        self.mesh = pv.PolyData()
        self.actor = add_actor(plotter, self.mesh, colour=colour, width=width)

    def show(self, mesh: pv.PolyData, colours: NDArray[np.uint8] | None = None) -> None:
        """Draw a mesh; colours (cells, 3) where it has more than one."""
        self.actor.mapper.SetScalarVisibility(colours is not None)
        show_cells(self.mesh, mesh, colours)


def rings(places: FloatArray, normals: FloatArray, radius: float, share: float) -> pv.PolyData:
    """A ring around each place (k, 3), facing its normal (k, 3) [m], `share` of it thick."""
    quads = ring_quads(places, normals, (1.0 - share) * radius, radius)
    return make_mesh(quads.reshape(-1, 3), np.arange(4 * len(quads)).reshape(-1, 4))


def balls(places: FloatArray, radius: float) -> pv.PolyData:
    """A ball at each place (k, 3) [m]."""
    ball = pv.Sphere(radius=radius, theta_resolution=16, phi_resolution=12)
    here = pv.PolyData(places)
    return here.glyph(geom=ball, scale=False, orient=False) if len(places) else here


class Names:
    """Words that stand beside places of the scene and follow the camera."""

    def __init__(self, renderer: Any, font_px: int, colour: str) -> None:
        self.renderer, self.font_px, self.colour = renderer, font_px, colour
        self.actors: list[Any] = []
        self.places, self.normals = NO_POINT, NO_POINT
        renderer.AddObserver("StartEvent", lambda *_: self._turn())

    def show(
        self, words: Sequence[str], places: FloatArray, normals: FloatArray = NO_POINT
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
        if len(self.normals) == 0:
            return
        eye = np.array(self.renderer.GetActiveCamera().GetPosition())
        seen = np.einsum("kd,kd->k", eye - self.places, self.normals) > 0.0
        for actor, visible in zip(self.actors, seen, strict=False):
            actor.SetVisibility(bool(visible))


class Half:
    """What both halves of the picture have: marks and names in a plotter's active renderer.

    Parameters
    ----------
    plotter : pyvista.Plotter
    session : AnchorSession
    font_px : int
        Height of the letters [px].
    """

    def __init__(self, plotter: pv.Plotter, session: AnchorSession, font_px: int) -> None:
        self.session, self.renderer = session, plotter.renderer
        self.pitch = median_spacing(session.board.layout)
        self.patch, self.following = Marks(plotter), Marks(plotter, NEXT)
        self.chosen, self.anchors = Marks(plotter, CHOSEN), Marks(plotter, ANCHOR)
        self.names = Names(self.renderer, font_px, ANCHOR)
        self.next_names = Names(self.renderer, font_px, NEXT)


class LinkPicture(Half):
    """The link."""

    def __init__(self, plotter: pv.Plotter, session: AnchorSession, font_px: int) -> None:
        super().__init__(plotter, session, font_px)
        self.vertices = np.ascontiguousarray(session.link[0], np.float64)
        faces = np.ascontiguousarray(session.link[1], np.int64)
        self._mesh = make_mesh(self.vertices, faces)
        self.normals = face_normals(self.vertices, faces)
        body = add_actor(plotter, _smooth(self._mesh), colour=BODY, lit=True)
        body.prop.ambient, body.prop.diffuse = 0.35, 0.65
        self.lines = Marks(plotter, NEXT, width=3.0)

    def show(self) -> Limits | None:
        """Draw what the session has now; the limits of the scale [mm], None without a patch."""
        session, found = self.session, self.session.found
        points = session.task().points if session.anchors else NO_POINT
        radius = BALL * self.pitch
        known = [anchor.taxel for anchor in session.anchors]
        out = self._outward(points)
        if found is not None:  # above the patch, which is drawn above its taxels
            points = points + 1.2 * LIFT * found.normals[known]
        self.anchors.show(balls(points, radius))
        self.names.show(channels(session), points, out)
        chosen = NO_POINT if session.point is None else session.point[None]
        self.chosen.show(balls(chosen, 1.3 * radius))
        if found is None:
            for marks in (self.patch, self.lines, self.following):
                marks.show(pv.PolyData())
            self.next_names.show([], NO_POINT)
            return None
        limits = round_limits(MM * found.predicted_sd)
        high = found.positions + LIFT * found.normals
        colours = error_layer(limits).colours(MM * found.predicted_sd)
        self.patch.show(polygons(high, found.normals, DISC * self.pitch), colours)
        feet = found.positions[known] + 1.2 * LIFT * found.normals[known]
        pairs = np.arange(2 * len(feet)).reshape(2, -1).T
        self.lines.show(make_lines(np.concatenate([points, feet]), pairs))
        after, facing = found.next_taxels, found.normals[found.next_taxels]
        around = high[after] + 0.5 * LIFT * facing
        self.following.show(rings(around, facing, RING * self.pitch, 0.3))
        self.next_names.show(ranked(session, after), high[after], facing)
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


class BoardPanel(Half):
    """The board."""

    def __init__(self, plotter: pv.Plotter, session: AnchorSession, font_px: int) -> None:
        super().__init__(plotter, session, font_px)
        self.renderer.SetBackground(*rgb(PANEL))
        self.renderer.parallel_projection = True
        layout = session.board.layout
        self.places = np.column_stack([layout, np.zeros(len(layout))])
        self.up = np.tile([0.0, 0.0, 1.0], (len(layout), 1))
        small = round(0.85 * font_px)
        Line(self.renderer, (SIDE, 0.975), font_px, bold=True).write("board, seen from outside")
        self.count = Line(self.renderer, (SIDE, 0.942), small, colour=FAINT)
        step = 1.45 * font_px / self.renderer.GetSize()[1]
        for row, text in enumerate(KEYS):
            Line(self.renderer, (SIDE, 0.20 - row * step), small, colour=FAINT).write(text)
        self._look()

    def show(self, limits: Limits | None) -> None:
        """Draw what the session has now, on the link's scale [mm]."""
        session, found = self.session, self.session.found
        if found is None or limits is None:
            grey = np.rint(255 * rgb(UNKNOWN)).astype(np.uint8)
            colours = np.tile(grey, (len(self.places), 1))
            following = NONE
        else:
            colours = error_layer(limits).colours(MM * found.predicted_sd)
            following = found.next_taxels
        self.patch.show(polygons(self.places, self.up, DISC * self.pitch), colours)
        known = np.array([anchor.taxel for anchor in session.anchors], np.int64)
        chosen = np.array([] if session.taxel is None else [session.taxel], np.int64)
        radius = FLAT_RING * self.pitch
        for marks, taxels, layer, wide, share in (
            (self.anchors, known, 1, radius, 0.3),
            (self.following, following, 1, radius, 0.3),
            (self.chosen, chosen, 2, 1.25 * radius, 0.35),
        ):
            above = self.places[taxels] + [0.0, 0.0, layer * 1e-4]
            marks.show(rings(above, self.up[taxels], wide, share))
        beside = np.array([0.5, 0.5, 0.0]) * self.pitch
        self.names.show(channels(session), self.places[known] + beside)
        self.next_names.show(ranked(session, following), self.places[following] + beside)
        self.count.write(f"{len(self.places)} taxels, {len(known)} anchors")

    def place(self, x: float, y: float) -> FloatArray:
        """The place (2,) on the board under a pixel [m]."""
        return world_points(self.renderer, x, y)[0][:2]

    def _look(self) -> None:
        """Fit the board between the caption and the keys."""
        width, height = self.renderer.GetSize()
        low, high = self.places[:, :2].min(axis=0), self.places[:, :2].max(axis=0)
        wide, tall = high - low + 3.0 * self.pitch
        metres = max(wide / ((1 - 2 * SIDE) * width), tall / ((HIGH - LOW) * height))  # a pixel
        middle = 0.5 * (low + high)
        middle[1] -= ((HIGH + LOW) / 2 - 0.5) * height * metres
        look_down(self.renderer, middle, metres)


class CalibrationView:
    """What a session looks like, and what clicks and keys do to it.

    Parameters
    ----------
    session : AnchorSession
    window_size : (int, int)
        [px].
    off_screen : bool
    output : Outputs
        What `w` saves, and where.
    """

    def __init__(
        self,
        session: AnchorSession,
        *,
        window_size: tuple[int, int] = SIZE,
        off_screen: bool = True,
        output: Outputs = Outputs(),  # noqa: B008  (frozen)
    ) -> None:
        self.session, self.output = session, output
        self.closed = False
        self.saved: tuple[str, ...] = ()
        self.mouse: object = None  # what turns events into clicks and keys, kept alive here
        width, height = window_size
        font = max(11, round(min(height / 50, width / 80)))
        self.plotter = new_plotter(window_size, off_screen, panel=True)
        self.link = LinkPicture(self.plotter, session, font)
        body = self.link.renderer
        self.font, self.legend = font, Legend(body)
        self.letters = int(BODY_SHARE * width * 0.94 / (LETTER * font))
        step = 1.35 * font / height
        Line(body, (0.02, 0.975), font, bold=True).write(session.title)
        self.status = Line(body, (0.02, 0.975 - 1.2 * step), font, bold=True)
        self.reasons = [
            Line(body, (0.02, 0.975 - (2.2 + row) * step), font) for row in range(LINES)
        ]
        for line in (self.status, *self.reasons):  # they stand before the link
            line.back(opacity=0.8)
        self.message = Line(body, (0.02, 0.055), font, bold=True)
        self.plotter.subplot(0, 1)
        self.board = BoardPanel(self.plotter, session, font)
        self.link.look()
        self.refresh()

    def refresh(self) -> None:
        """Draw what the session has now."""
        limits = self.link.show()
        self.board.show(limits)
        if limits is None:
            self.legend.hide()
        else:
            self.legend.show(error_layer(limits), self.font)
        words, colour, why = self._verdict()
        self.status.write(words, colour)
        rows = [row for reason in why for row in textwrap.wrap(reason, self.letters)]
        if len(rows) > LINES:
            rows = [*rows[: LINES - 1], rows[LINES - 1][: self.letters - 4] + " ..."]
        for line, text in zip(self.reasons, rows + [""] * LINES, strict=False):
            line.write(text)
        self.message.write(textwrap.shorten(self.session.message, self.letters, placeholder=" ..."))

    def _verdict(self) -> tuple[str, str, list[str]]:
        """Status in words, its colour, and the reasons."""
        session, found = self.session, self.session.found
        solution = session.solution
        if solution is None:
            return f"{len(session.anchors)} anchors, not solved yet", FAINT, []
        old = "  (anchors have changed since)" if session.stale else ""
        if found is None:
            return f"not solved{old}", NEXT, [solution.problem]
        status = str(found.status)
        sd = MM * found.predicted_sd
        words = f"{status}: {STATUS_WORDS[status]}{old}"
        about = (
            f"predicted error {np.median(sd):.2f} mm (median), {sd.max():.2f} mm (worst); "
            f"{100 * found.coverage:.0f} % covered; {found.weakest}"
        )
        colour = GOOD if status == "ok" else DOUBTFUL
        return words, INK if old else colour, [*found.reasons, about]

    def click(self, x: float, y: float) -> None:
        """A click on a pixel, counted from the lower left: a taxel of the board, or a point."""
        if self.over_link(x):
            self.session.pick_point(self.link.pick(x, y))
        else:
            self.session.pick_board(self.board.place(x, y))
        self._changed()

    def over_link(self, x: float) -> bool:
        """Whether a pixel is on the link's side of the picture."""
        return x < BODY_SHARE * self.size[0]

    def press(self, key: str) -> None:
        """What a key stands for; other keys do nothing."""
        actions: dict[str, Callable[[], Any]] = {
            "s": self.solve_now,
            "u": self.session.undo,
            "BackSpace": self.session.undo,
            "x": self.session.remove,
            "Delete": self.session.remove,
            "w": self.save,
            "W": lambda: self.save(accept=True),
            "r": self.link.look,
            "q": self.close,
            "Escape": self.close,
        }
        if key in actions:
            actions[key]()
            self._changed(solve=key != "s")

    def _changed(self, *, solve: bool = True) -> None:
        """Solve as soon as there are anchors enough that were not solved yet, and draw."""
        if solve and self.session.ready:
            self.session.message = "solving"
            self.refresh()  # so that the click is seen before the window waits
            self.solve_now()
        else:
            self.refresh()

    def solve_now(self) -> None:
        """Solve and turn to the patch when there was none before."""
        first = self.session.found is None
        self.session.solve()
        if first and self.session.found is not None:
            self.link.look()
        self.refresh()

    def save(self, *, accept: bool = False) -> None:
        """Write the results; what goes wrong is said in the picture."""
        if self.output.out is None:
            self.session.message = "nowhere to save to: start with -o FOLDER"
            return
        output = replace(self.output, accept=accept or self.output.accept)
        try:
            self.saved = self.session.save(output)
        except SkinError as error:
            self.session.message = str(error)

    def close(self) -> None:
        """End the loop of a window."""
        self.closed = True

    @property
    def size(self) -> tuple[int, int]:
        """Width and height now [px]."""
        width, height = self.window.GetSize()
        return int(width), int(height)

    @property
    def window(self) -> Any:
        """VTK's window."""
        return self.plotter.render_window

    def frame(self) -> NDArray[np.uint8]:
        """(height, width, 3) picture as it is now."""
        self.window.Render()
        return np.asarray(self.plotter.screenshot(return_img=True), np.uint8)

    def shut(self) -> None:
        """Give the window back."""
        self.plotter.close()


class Mouse:
    """Clicks told from drags: a drag turns the link, a click picks."""

    def __init__(self, view: CalibrationView, interactor: Any) -> None:
        self.view, self.interactor = view, interactor
        self._pressed: tuple[int, int] | None = None
        # Other keys of VTK's would end the program (e) or draw a wireframe (w) behind our back.
        interactor.RemoveObservers("CharEvent")
        interactor.RemoveObservers("KeyPressEvent")
        interactor.AddObserver("KeyPressEvent", lambda *_: view.press(interactor.GetKeySym()))
        # Through the style: while it drags, no other observer hears of the mouse.
        style: Any = vtkInteractorStyleTrackballCamera()
        interactor.SetInteractorStyle(style)
        self.style = style
        # Only VTK would know of the style and us otherwise: Python would clear us away meanwhile.
        view.mouse = self
        self.style.AddObserver("LeftButtonPressEvent", lambda *_: self.press())
        self.style.AddObserver("LeftButtonReleaseEvent", lambda *_: self.release())
        # So that the style leaves letters alone: its w would draw a wireframe.
        self.style.AddObserver("CharEvent", lambda *_: None)
        interactor.AddObserver("ExitEvent", lambda *_: view.close())

    def press(self) -> None:
        """Remember where the button went down; over the link a drag may follow."""
        self._pressed = self.interactor.GetEventPosition()
        if self.view.over_link(self._pressed[0]):
            self.style.OnLeftButtonDown()

    def release(self) -> None:
        """A click where it came up at the same place."""
        self.style.OnLeftButtonUp()
        if self._pressed is None:
            return
        (x0, y0), (x, y) = self._pressed, self.interactor.GetEventPosition()
        self._pressed = None
        if abs(x - x0) < STILL and abs(y - y0) < STILL:
            self.view.click(x, y)


def run(view: CalibrationView) -> None:
    """Show a view made with `off_screen=False` until the user closes it."""
    plotter: Any = view.plotter
    plotter.subplot(0, 0)
    plotter.show(interactive_update=True, auto_close=False, title="Skinmap: anchors")
    interactor = plotter.iren.interactor
    Mouse(view, interactor)
    if view.session.ready:
        view.solve_now()
    try:
        while not view.closed:
            interactor.ProcessEvents()
            if interactor.GetDone():
                break
            view.window.Render()
            time.sleep(IDLE)
    finally:
        view.shut()

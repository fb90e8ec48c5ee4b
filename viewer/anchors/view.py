"""The calibration view: a flat board beside its link, clicks that become anchors, the patch.

All of it works without a screen; `run` adds mouse, keys, the loop, and a solver beside it.
"""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera

from calibration.commands.anchor_session import AnchorSession, Solution, solve
from calibration.commands.calibration_options import Outputs
from calibration.commands.results import MM
from skinmap.arrays import FloatArray
from skinmap.errors import SkinError
from skinmap.geometry.proximity import median_spacing
from viewer.anchors.link import (
    ANCHOR,
    CHOSEN,
    NEXT,
    UNKNOWN,
    Limits,
    LinkPicture,
    Marks,
    Names,
    channels,
    error_layer,
    ranked,
)
from viewer.colours import BACKGROUND, FAINT, INK, PANEL, rgb
from viewer.drawing.frame.camera import look_down, project
from viewer.drawing.frame.canvas import BODY_SHARE, new_plotter
from viewer.drawing.words.legend import Legend
from viewer.drawing.words.text_lines import Line
from viewer.interaction.picking import world_points

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
DISC, RING = 0.42, 0.72  # radii in pitches
KEYS = (
    "click a taxel here, then its point on the link",
    "(or the point first); drag turns the link",
    "s  solve        u  take back      x  remove anchor",
    "w  save         W  save whatever the status",
    "r  look at the patch              q  close",
)

STILL = 4  # a mouse that moved less than this between press and release has clicked [px]
IDLE = 0.02  # between two looks at mouse and keys [s]


class BoardPanel:
    """The board in a plotter's active renderer.

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
        self.renderer.SetBackground(*rgb(PANEL))
        self.renderer.parallel_projection = True
        layout = session.board.layout
        self.pitch = median_spacing(layout)
        self.places = np.column_stack([layout, np.zeros(len(layout))])
        self.up = np.tile([0.0, 0.0, 1.0], (len(layout), 1))
        self.taxels = Marks(plotter)
        self.following = Marks(plotter, NEXT)
        self.anchors = Marks(plotter, ANCHOR)
        self.chosen = Marks(plotter, CHOSEN)
        self.names = Names(self.renderer, font_px, ANCHOR)
        self.next_names = Names(self.renderer, font_px, NEXT)
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
            following = np.zeros(0, np.int64)
        else:
            colours = error_layer(limits).colours(MM * found.predicted_sd)
            following = found.next_taxels
        self.taxels.discs(self.places, self.up, DISC * self.pitch, colours)
        known = np.array([anchor.taxel for anchor in session.anchors], np.int64)
        radius = RING * self.pitch
        self.anchors.rings(self._lifted(known, 1), self.up[known], radius, 0.3)
        self.following.rings(self._lifted(following, 1), self.up[following], radius, 0.3)
        chosen = np.array([] if session.taxel is None else [session.taxel], np.int64)
        self.chosen.rings(self._lifted(chosen, 2), self.up[chosen], 1.25 * radius, 0.35)
        beside = np.array([0.5, 0.5, 0.0]) * self.pitch
        self.names.show(channels(session), self.places[known] + beside)
        self.next_names.show(ranked(session, following), self.places[following] + beside)
        self.count.write(f"{len(self.places)} taxels, {len(known)} anchors")

    def place(self, x: float, y: float) -> FloatArray:
        """The place (2,) on the board under a pixel [m]."""
        return world_points(self.renderer, x, y)[0][:2]

    def _lifted(self, taxels: FloatArray | Any, layer: int) -> FloatArray:
        """Places of some taxels, in a layer above the discs [m]."""
        return self.places[taxels] + [0.0, 0.0, layer * 1e-4]

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
        self.solve: Callable[[], None] = self.solve_now  # a window does it beside itself,
        self.finish: Callable[[], object] = lambda: None  # and waits for that before it saves
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
            style = line.actor.GetTextProperty()
            style.SetBackgroundColor(*rgb(BACKGROUND))
            style.SetBackgroundOpacity(0.8)
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
            "s": self.solve,
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
            self.solve()
        self.refresh()

    def solve_now(self) -> None:
        """Solve and turn to the patch when there was none before."""
        first = self.session.found is None
        self.session.solve()
        self.show_solution(first)

    def show_solution(self, first: bool) -> None:
        """Draw what was solved; the first patch is looked at."""
        if first and self.session.found is not None:
            self.link.look()
        self.refresh()

    def save(self, *, accept: bool = False) -> None:
        """Write the results; what goes wrong is said in the picture."""
        if self.output.out is None:
            self.session.message = "nowhere to save to: start with -o FOLDER"
            return
        self.finish()
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

    def pixel(self, point: NDArray[Any], *, board: bool = False) -> tuple[int, int]:
        """The pixel of a point (3,) on the link or the board [m], from the lower left."""
        renderer = self.board.renderer if board else self.link.renderer
        x, y = project(renderer, np.asarray(point)[None])[0] + renderer.GetOrigin()
        return round(x), round(y)

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


class Beside:
    """Content of the right half of two side by side."""

    def __init__(self, view: CalibrationView) -> None:
        self.view = view
        self._pool = ThreadPoolExecutor(1, "anchors")
        self._job: Future[Solution] | None = None
        view.solve = self.start
        view.finish = self.wait

    @property
    def busy(self) -> bool:
        """Whether something is being solved."""
        return self._job is not None

    def start(self) -> None:
        """Begin with the anchors there are, unless it is at work: it looks again when done."""
        session = self.view.session
        if self._job is None:
            job = session.task(), session.anchors
            self._job = self._pool.submit(solve, *job)
            session.message = "solving; go on"

    def look(self, timeout: float | None = 0.0) -> bool:
        """Take over what is done; whether there was something. Waits up to `timeout` seconds."""
        if self._job is None:
            return False
        if timeout == 0.0 and not self._job.done():
            return False
        solution, self._job = self._job.result(timeout), None
        session = self.view.session
        first = session.found is None
        session.accept(solution)
        if session.ready:
            self.start()
        self.view.show_solution(first)
        return True

    def wait(self) -> None:
        """Until all is solved: what is saved must not be solved twice at once."""
        while self.busy:
            self.look(None)

    def close(self) -> None:
        """Wait for what is being solved: a thread that outlives the program would crash it."""
        self._pool.shutdown(wait=True, cancel_futures=True)


def run(view: CalibrationView) -> None:
    """Show a view made with `off_screen=False` until the user closes it."""
    plotter: Any = view.plotter
    plotter.subplot(0, 0)
    plotter.show(interactive_update=True, auto_close=False, title="Skinmap: anchors")
    interactor = plotter.iren.interactor
    Mouse(view, interactor)
    beside = Beside(view)
    if view.session.ready:
        beside.start()
        view.refresh()
    try:
        while not view.closed:
            interactor.ProcessEvents()
            if interactor.GetDone():
                break
            beside.look()
            view.window.Render()
            time.sleep(IDLE)
    finally:
        beside.close()
        view.shut()

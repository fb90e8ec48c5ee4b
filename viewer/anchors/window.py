"""The calibration view in a window: mouse, keys, and a solver that works beside the picture."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera

from calibration.commands.anchor_session import Solution, solve
from viewer.anchors.view import CalibrationView

STILL = 4  # a mouse that moved less than this between press and release has clicked [px]
IDLE = 0.02  # between two looks at mouse and keys [s]


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
    """Solves in another thread, so that the link can be turned meanwhile."""

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
            job = session.task(), session.anchors, session.seed
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

"""What the mouse does: it drags the time slider, draws lassos, points and chooses.

Pixels are those of the window, y upwards, as VTK counts them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from viewer.interaction.controls import Controls
import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite
from skinmap.surface.surface_mesh import SurfaceMesh

FIRST = 10.0  # priority: before the camera's style, which then does not hear what is not for it
CLICK = 4.0  # a press that moves less is a click [px]

Doing = Literal["nothing", "turning", "sliding", "panning", "lasso"]


class Mouse:
    """Follows one mouse with its left button."""

    def __init__(self, listener: Controls) -> None:
        self.listener = listener
        self.doing: Doing = "nothing"
        self._from, self._last = (0.0, 0.0), 0.0
        self._lasso: Lasso | None = None

    def press(self, x: float, y: float) -> bool:
        """The button goes down; True where the camera must not hear of it."""
        self._from = (x, y)
        if self.listener.over_slider(x, y):
            self.doing = "sliding"
            self.listener.slide(x)
        elif self.listener.over_lanes(x, y):
            self.doing, self._last = "panning", x
        elif self.listener.over_map(x, y):
            self.doing = "lasso"
            self._lasso = Lasso(x, y)
        else:
            self.doing = "turning"
        return self.doing != "turning"

    def move(self, x: float, y: float) -> bool:
        """The mouse moves; True where the camera must not hear of it."""
        if self.doing == "sliding":
            self.listener.slide(x)
        elif self.doing == "panning":
            self.listener.pan(x - self._last)
            self._last = x
        elif self._lasso is not None:
            if self._lasso.to(x, y):
                self.listener.trace(self._lasso)
        elif self.doing == "nothing":
            self.listener.point(x, y)
        return self.doing in ("sliding", "panning", "lasso")

    def release(self, x: float, y: float, *, shift: bool = False, control: bool = False) -> bool:
        """The button comes up: a click chooses a taxel, with shift its module, control its patch.

        Both together add to what is chosen already; so does shift for a lasso.
        """
        doing, self.doing = self.doing, "nothing"
        lasso, self._lasso = self._lasso, None
        self.listener.trace(None)
        still = math.dist(self._from, (x, y)) < CLICK
        if doing == "panning" and still:
            self.listener.slide(x)
        elif lasso is not None and lasso.drawn and not still:
            self.listener.enclose(lasso, add=shift)
        elif doing in ("turning", "lasso") and still:
            reach: Reach = "module" if shift else "patch" if control else "taxel"
            self.listener.click(x, y, reach, add=shift and control)
        return doing in ("sliding", "panning", "lasso")


class Pace:
    """Rate limit that keeps the last of what it held back.

    Parameters
    ----------
    period : float
        [s].
    clock : callable
        Seconds that only rise.
    """

    def __init__(self, period: float, clock: Callable[[], float]) -> None:
        self.period, self.clock = period, clock
        self._next = -math.inf

    def reset(self) -> None:
        """Let it happen at once."""
        self._next = -math.inf

    def due(self) -> bool:
        """Whether it may happen now; if so, the next time is a period later."""
        now = self.clock()
        if now < self._next:
            return False
        self._next = now + self.period
        return True


class Events:
    """Observers of one interactor."""

    def __init__(self, interactor: Any, controls: Controls) -> None:
        self.interactor, self.controls = interactor, controls
        self._tags: list[tuple[Any, int]] = []
        # Other keys of VTK's would end the program (e) or draw a wireframe (w) behind our back.
        interactor.RemoveObservers("CharEvent")
        interactor.RemoveObservers("KeyPressEvent")
        mouse = controls.mouse
        self._on("KeyPressEvent", lambda: controls.press(interactor.GetKeySym()) and False)
        self._on("LeftButtonPressEvent", lambda: mouse.press(*self._place()))
        # A style that turns the camera keeps these for itself, but for who only listens.
        self._on("MouseMoveEvent", lambda: mouse.move(*self._place()), passive=True)
        self._on("LeftButtonReleaseEvent", self._release, passive=True)
        self._on("LeaveEvent", controls.leave)
        self._on("ExitEvent", controls.close)
        for name, factor in (("MouseWheelForwardEvent", 0.8), ("MouseWheelBackwardEvent", 1.25)):
            self._on(name, partial(self._wheel, factor))
        for name in ("RightButtonPressEvent", "MiddleButtonPressEvent"):
            self._on(name, lambda: controls.over_map(*self._place()))
        for name in ("ConfigureEvent", "ExposeEvent"):
            self._on(name, controls.redraw)
        style = interactor.GetInteractorStyle()
        if style is not None:
            self._on("InteractionEvent", controls.lead, style)

    def close(self) -> None:
        """Let go of the interactor."""
        for source, tag in self._tags:
            source.RemoveObserver(tag)
        self._tags.clear()

    def _on(
        self,
        name: str,
        action: Callable[[], bool | None],
        source: Any = None,
        *,
        passive: bool = False,
    ) -> None:
        """Do something at an event; where that returns true, other observers do not hear of it."""
        source = self.interactor if source is None else source
        tag: list[int] = []

        def happened(*_: object) -> None:
            consumed = action()
            command = source.GetCommand(tag[0])
            if command is not None:
                command.SetAbortFlag(1 if consumed else 0)

        tag.append(source.AddObserver(name, happened, FIRST))
        source.GetCommand(tag[0]).SetPassiveObserver(passive)
        self._tags.append((source, tag[0]))

    def _place(self) -> tuple[float, float]:
        x, y = self.interactor.GetEventPosition()
        return float(x), float(y)

    def _release(self) -> bool:
        shift, control = self.interactor.GetShiftKey(), self.interactor.GetControlKey()
        return self.controls.mouse.release(*self._place(), shift=bool(shift), control=bool(control))

    def _wheel(self, factor: float) -> bool:
        """The wheel zooms time line and plot, else the body's camera, never the flat map's."""
        if self.controls.zoom(*self._place(), factor) or self.controls.over_map(*self._place()):
            return True
        self.controls.lead()
        return False


# Chosen taxels: one by one, by module, by patch, or all within a lasso.

Reach = Literal["taxel", "module", "patch"]
NONE = np.zeros(0, np.int64)

STRIDE = 2.0  # shorter moves add no corner [px]
LEAST = 3  # corners that enclose anything


class Selection(dict[str, IntArray]):
    """Chosen taxels (k,) of each part, dense rows in rising order; parts without any are absent."""

    @property
    def count(self) -> int:
        """Taxels chosen on all parts."""
        return sum(len(taxels) for taxels in self.values())

    def taxels(self, part: str) -> IntArray:
        """(k,) chosen taxels of a part."""
        return self.get(part, NONE)

    def set(self, part: str, taxels: ArrayLike) -> None:
        """Choose these taxels of a part and no others of it."""
        rows = np.unique(np.asarray(taxels, np.int64))
        if len(rows):
            self[part] = rows
        else:
            self.pop(part, None)

    def replace(self, part: str, taxels: ArrayLike) -> None:
        """Choose these taxels of a part and nothing else at all."""
        self.clear()
        self.set(part, taxels)

    def toggle(self, part: str, taxels: ArrayLike) -> None:
        """Add taxels; where all of them are chosen already, let them go."""
        rows = np.asarray(taxels, np.int64)
        old = self.taxels(part)
        if np.isin(rows, old).all():
            self.set(part, np.setdiff1d(old, rows))
        else:
            self.set(part, np.concatenate([old, rows]))


def reached(mesh: SurfaceMesh, taxel: int, reach: Reach) -> IntArray:
    """(k,) what one click chooses: the taxel, its module or its patch.

    A taxel that no face uses is a patch alone.
    """
    groups = {"module": mesh.skin.modules, "patch": mesh.taxel_patches}
    if reach == "taxel" or groups[reach][taxel] < 0:
        return np.array([taxel])
    return np.flatnonzero(groups[reach] == groups[reach][taxel])


class Lasso:
    """Corners (k, 2) of a line that follows the mouse [px]."""

    def __init__(self, x: float, y: float) -> None:
        self._corners = [(float(x), float(y))]

    def to(self, x: float, y: float) -> bool:
        """Go on to a place; False where that is too near to the last corner to count."""
        if np.hypot(x - self._corners[-1][0], y - self._corners[-1][1]) < STRIDE:
            return False
        self._corners.append((float(x), float(y)))
        return True

    @property
    def corners(self) -> FloatArray:
        """(k, 2) [px]."""
        return np.array(self._corners)

    @property
    def drawn(self) -> bool:
        """Whether it encloses anything: a click does not."""
        return len(self._corners) >= LEAST

    def holds(self, points: ArrayLike) -> BoolArray:
        """(n,) which of the points (n, 2) [px] lie inside."""
        return inside(self.corners, points)


def inside(polygon: ArrayLike, points: ArrayLike) -> BoolArray:
    """Which points lie inside a closed polygon that may cross itself: the even-odd rule.

    Parameters
    ----------
    polygon : (k, 2) array-like of float
    points : (n, 2) array-like of float
        In the same unit.

    Returns
    -------
    (n,) array of bool
        NaN points lie outside.

    References
    ----------
    Shimrat, "Algorithm 112: Position of point relative to polygon", CACM 1962.
    """
    corners = check_finite(polygon, "polygon", (None, 2))
    x, y = np.asarray(points, np.float64).reshape(-1, 2).T
    odd = np.zeros(len(x), bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 != y1:
            odd ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return odd

"""What the mouse does: it drags the time slider, draws lassos, points and chooses.

Pixels are those of the window, y upwards, as VTK counts them. Nothing here knows VTK's events.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from viewer.interaction.selection import Lasso, Reach

if TYPE_CHECKING:
    from viewer.interaction.controls import Controls

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

    def cancel(self) -> None:
        """Let go of whatever is being done."""
        self.doing, self._lasso = "nothing", None
        self.listener.trace(None)


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

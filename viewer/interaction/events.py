"""VTK's events tied to the controls: keys, mouse, wheel, and the window's own close button."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from viewer.interaction.controls import Controls

FIRST = 10.0  # priority: before the camera's style, which then does not hear what is not for it


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
        self._on("LeaveEvent", self._leave)
        self._on("ExitEvent", lambda: controls.close())
        for name, factor in (("MouseWheelForwardEvent", 0.8), ("MouseWheelBackwardEvent", 1.25)):
            self._on(name, partial(self._wheel, factor))
        for name in ("RightButtonPressEvent", "MiddleButtonPressEvent"):
            self._on(name, lambda: controls.over_map(*self._place()))
        self._on("ConfigureEvent", self._redraw)
        self._on("ExposeEvent", self._redraw)
        style = interactor.GetInteractorStyle()
        if style is not None:
            self._on("InteractionEvent", lambda: controls.lead(), style)

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
        taken = self.controls.mouse.release(
            *self._place(), shift=bool(shift), control=bool(control)
        )
        return taken

    def _wheel(self, factor: float) -> bool:
        """The wheel zooms time line and plot, else the body's camera, never the flat map's."""
        if self.controls.zoom(*self._place(), factor):
            return True
        if self.controls.over_map(*self._place()):
            return True
        self.controls.lead()
        return False

    def _leave(self) -> None:
        self.controls.pointing.leave()
        self.controls.changed = True

    def _redraw(self) -> None:
        self.controls.changed = True

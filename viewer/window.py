"""The live window: samples come, the picture follows, keys work, closing it ends the loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from numpy.typing import ArrayLike

from skinmap.live.touches import NamedTouch
from viewer.colours import INK, PANEL, rgb
from viewer.overlays import Line
from viewer.scene import Scene

Moment = tuple[Mapping[str, ArrayLike], list[NamedTouch], str | None]
PERIOD = 1.0 / 50.0  # of the samples [s]
IDLE = 0.02  # between two looks at mouse and keys while nothing moves [s]
HELP = (
    "",
    "space   pause, go on",
    "a       camera turns to the touches by itself",
    "r       look from the front",
    "h       this help",
    "q       close",
    "",
    "drag    turn (left), move (middle)",
    "wheel   zoom",
    "",
)


class Controls:
    """What keys and mouse have asked for.

    Attributes
    ----------
    paused, closed : bool
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.paused, self.closed = False, False
        self._help = Line(scene.plotter.renderers[0], (0.14, 0.86), scene.font_px)
        style = self._help.actor.GetTextProperty()
        style.SetColor(*rgb(PANEL))
        style.SetBackgroundColor(*rgb(INK))
        style.SetBackgroundOpacity(0.93)
        style.SetFontFamilyToCourier()
        style.BoldOn()
        self._help.write("")

    @property
    def help_shown(self) -> bool:
        """Whether the list of keys is in the picture."""
        return bool(self._help.actor.GetVisibility())

    def pause(self) -> None:
        """Stop or go on."""
        self.paused = not self.paused

    def toggle_help(self) -> None:
        """Show or hide the list of keys."""
        self._help.write("" if self.help_shown else "\n".join(f" {line} " for line in HELP))
        self._help.to_front()

    def follow(self) -> None:
        """Let the camera turn to the touches by itself."""
        self.scene.framing.look(self.scene.framing.view, "auto")

    def front(self) -> None:
        """Look from the front, and stay there."""
        self.scene.framing.look(self.scene.front, "still")

    def lead(self) -> None:
        """The mouse takes the camera: it obeys nothing else until a key gives it back."""
        self.scene.framing.mode = "free"

    def close(self) -> None:
        """End the loop."""
        self.closed = True

    def press(self, key: str) -> None:
        """Do what a key stands for; other keys do nothing."""
        actions: dict[str, Callable[[], None]] = {
            "space": self.pause,
            "h": self.toggle_help,
            "a": self.follow,
            "r": self.front,
            "q": self.close,
            "Escape": self.close,
        }
        actions.get(key, lambda: None)()


def play(scene: Scene, moments: Iterable[Moment], *, period: float = PERIOD) -> int:
    """Show moments at their pace, until the window is closed.

    Keeps to the clock: where drawing is slower than the samples come, pictures are left out,
    samples never. The last moment stays until the user closes the window.

    Parameters
    ----------
    scene : Scene
        Made with `off_screen=False`.
    moments : iterable
        (pressures (n,) by part, touches, part whose flat map is shown or None) of each sample.
    period : float
        Time between two samples [s].

    Returns
    -------
    int
        Pictures drawn.
    """
    controls = Controls(scene)
    plotter: Any = scene.plotter
    scene.update(step=360.0)
    plotter.enable_terrain_style(mouse_wheel_zooms=True)  # the robot stays upright
    plotter.show(interactive_update=True, auto_close=False, title="Skinmap")
    watch(scene, controls)
    drawn, due = 0, time.perf_counter()
    for pressures, touches, part in moments:
        for name, values in pressures.items():
            scene.set_pressures(name, values)
        scene.set_touches(touches)
        if part is not None:
            scene.show_flat_map(part)
        due += period
        if time.perf_counter() < due or drawn == 0:
            drawn += _draw(scene, controls)
        else:
            _listen(scene, controls)
        while controls.paused and not controls.closed:
            due = time.perf_counter()
            drawn += _rest(scene, controls)
        if controls.closed:
            break
        time.sleep(max(0.0, due - time.perf_counter()))
        due = max(due, time.perf_counter() - 5 * period)  # after a halt, no rush to catch up
    while not controls.closed:
        drawn += _rest(scene, controls)
    scene.close()
    return drawn


def watch(scene: Scene, controls: Controls) -> None:
    """Tie keys, mouse and the window's own close button to the controls."""
    interactor = _interactor(scene)
    # Other keys of VTK's would end the program (e) or draw a wireframe (w) behind our back.
    interactor.RemoveObservers("CharEvent")
    interactor.RemoveObservers("KeyPressEvent")
    interactor.AddObserver("KeyPressEvent", lambda *_: controls.press(interactor.GetKeySym()))
    style = interactor.GetInteractorStyle()
    style.AddObserver("StartInteractionEvent", lambda *_: controls.lead())
    interactor.AddObserver("ExitEvent", lambda *_: controls.close())


def _interactor(scene: Scene) -> Any:
    plotter: Any = scene.plotter
    return plotter.iren.interactor


def _listen(scene: Scene, controls: Controls) -> None:
    """Let keys, mouse and the close button take effect."""
    interactor = _interactor(scene)
    interactor.ProcessEvents()
    if interactor.GetDone():
        controls.close()


def _draw(scene: Scene, controls: Controls) -> int:
    _listen(scene, controls)
    if controls.closed:
        return 0
    scene.update()
    window: Any = scene.plotter.render_window
    window.Render()
    return 1


def _rest(scene: Scene, controls: Controls) -> int:
    """One turn of the loop while nothing comes: the mouse still moves the camera."""
    time.sleep(IDLE)
    return _draw(scene, controls)

"""The live window: samples come, the picture follows, keys and mouse work, closing it ends it."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from skinmap.live.contacts.named_touch import Moment
from viewer.interaction.controls import Controls
from viewer.interaction.mouse import Events, Pace
from viewer.layers import LEFT, RIGHT, Pair
from viewer.playing.overview import new_players
from viewer.playing.player import Player
from viewer.results import ViewWindow
from viewer.scene import Scene
from viewer.view_options import Look, Session, look_beside, new_scene

OLDEST = 0.1  # age of a sample up to which its picture counts as live [s]
MISSED = 2.5  # samples that may fail to come before an unchanged picture counts as late
PATIENCE = 2  # pictures held back one after the other before one is shown with a mark


SIZE = (1024, 768)
SHARE = 0.18  # of a core that drawing samples may take: a quick one draws each of them
LONGEST_REST = 0.08  # between two pictures of a live source [s]: none is older than a tenth
REST = 0.04  # longest wait for keys and mouse while nothing moves [s]
IDLE = 0.02  # longest wait for a sample before keys and mouse are looked at again [s]
TURN = 60.0  # of the camera by itself [deg/s]
LONGEST = 0.1  # between two pictures: after a rest the camera does not leap [s]
REFRESH = 0.2  # between two pictures while nothing moves: the age of the sample is told [s]


class Punctual:
    """Judges pictures that are drawn and not shown yet, one after the other.

    None may be shown as live whose sample is older than a tenth of a second. A picture that took
    too long is held back: the newest sample is drawn instead, at once. Where that comes too late
    again, drawing cannot keep up here: pictures are shown then, but say so.

    Attributes
    ----------
    age : float
        Of the last sample judged, when its picture was drawn [s].
    marked : bool
        Whether the next picture is to say that it is late.
    held : int
        Pictures held back so far.
    late : int
        Pictures shown so far that said that they were late.
    """

    def __init__(self) -> None:
        self.marked = False
        self.age = 0.0
        self.held = self.late = 0
        self._row = 0  # pictures held back since one was shown

    def shows(self, age: float, *, rate: float = float("nan"), news: bool = True) -> bool:
        """Whether the picture may be shown.

        Parameters
        ----------
        age : float
            Of its sample, now that it is drawn [s]; NaN where nothing is live.
        rate : float
            Samples a second that come; NaN where nobody knows.
        news : bool
            Whether it is the first picture of its sample. Later ones, drawn because the camera
            turned, are as old as the source is slow: that is not drawing's fault.
        """
        self.age, limit = age, OLDEST
        if not news:
            limit = max(limit, MISSED / rate) if rate > 0.0 else float("inf")
        if not age > limit:
            self.marked, self._row = False, 0
            return True
        if self.marked:
            self.late += 1
            self._row = 0
            return True
        self.held += 1
        self._row += 1
        self.marked = self._row >= PATIENCE
        return False


class Window:
    """One scene with its player and controls, turn by turn.

    Parameters
    ----------
    scene : Scene
        With a window or without: all but opening it is the same.
    player : Player
    folder, view_file : Path, optional
        As for `Controls`.
    """

    def __init__(
        self,
        scene: Scene,
        player: Player,
        *,
        folder: Path | None = None,
        view_file: Path | None = None,
    ) -> None:
        self.scene, self.player = scene, player
        scene.player = player
        self.drawn = 0
        self.punctual = Punctual()
        self._news = False  # whether a sample was taken that no picture on the screen shows
        plotter: Any = scene.plotter
        self.interactor = plotter.iren.interactor
        # The robot stays upright; shift is for choosing modules, not for moving the camera.
        plotter.enable_terrain_style(mouse_wheel_zooms=True, shift_pans=False)
        # The camera's style asks for pictures whenever the mouse moves: ours come once a turn.
        self.interactor.EnableRenderOff()
        self.controls = Controls(scene, player, folder=folder, view_file=view_file)
        self.events = Events(self.interactor, self.controls)
        self._calm = Pace(REFRESH, time.perf_counter)
        self._updated = time.perf_counter()
        self._number = -1
        self._rested = 0.0  # when the next sample may be drawn
        self._failed = False

    def open(self, title: str = "Skinmap", left: int | None = None) -> None:
        """Show the window, under a title, `left` [px] from the left of the screen."""
        plotter: Any = self.scene.plotter
        self.scene.update(step=360.0)
        if left is not None:
            plotter.render_window.SetPosition(left, 0)
        plotter.show(interactive_update=True, auto_close=False, title=title)

    def turn(self) -> bool:
        """Let keys and mouse act, show the newest moment, draw if anything changed.

        Returns
        -------
        bool
            Whether a picture was drawn.
        """
        controls, scene = self.controls, self.scene
        self.interactor.ProcessEvents()
        if self.interactor.GetDone():
            controls.close()
        if controls.closed:
            return False
        moment = self.player.take()
        if moment is not None:
            self._show(moment)
        if self.player.error is not None and not self._failed:
            self._failed = True
            controls.say(" ".join(str(self.player.error).split()))
            controls.notice.stay()
        self._news |= moment is not None
        halted = self.player.paused and not scene.moment.stale
        wanted = controls.tick() or self._turning or (not halted and self._calm.due())
        wanted |= self._news and time.perf_counter() >= self._rested
        if wanted or scene.canvas.cache.held or self.punctual.marked:
            self._draw()
        return bool(wanted)

    def _draw(self) -> None:
        """Draw, and show the picture unless its sample became too old meanwhile."""
        scene, player, cache = self.scene, self.player, self.scene.canvas.cache
        began, spent = time.perf_counter(), time.process_time()
        status = scene.canvas.status
        late = self.punctual.marked and not math.isnan(player.age)  # what is halted is not late
        status.mark(self.punctual.age if late else None)
        scene.update(self._stride())
        if not (cache.draw(hold=True) or cache.held):
            self._news = False  # it looks as before
            return
        if self.punctual.shows(player.age, rate=scene.moment.rate, news=self._news):
            cache.present()
            self.drawn += 1
            status.shown(player.age)
            self._news = False
        # Samples may take their share of a core; hands at mouse and keys are followed at once.
        rest = (time.process_time() - spent) / SHARE
        self._rested = began + min(rest, LONGEST_REST)

    @property
    def _turning(self) -> bool:
        framing = self.scene.framing
        return framing.mode != "free" and framing.view != framing.goal

    def _stride(self) -> float:
        """How far the camera may turn since the last picture [deg]: as quick at any rate."""
        now = time.perf_counter()
        past, self._updated = now - self._updated, now
        return TURN * min(past, LONGEST)

    def _show(self, moment: Moment) -> None:
        if self.controls.following:
            self.scene.follow(moment)
        else:
            self.scene.show_moment(moment)

    def wait(self) -> None:
        """Sleep until something new is to be shown, not for long."""
        self.player.wait(self._number, REST if self.player.paused else IDLE)
        self._number = self.player.number

    def close(self) -> None:
        """Let go of the events, close the window and the player."""
        self.events.close()
        self.controls.remove()
        self.player.close()
        self.scene.close()


def run(window: Window, *others: Window, seconds: float = math.inf) -> int:
    """Play until a window is closed, or for so many seconds; pictures drawn in the first one.

    Other windows stand beside it, one camera for all. The last moment of a source that ended or
    failed stays until the user closes the window.

    Raises
    ------
    SkinError
        What the source failed with, after the windows were closed.
    """
    end = time.monotonic() + seconds
    every = (window, *others)
    mirrors = [Mirror(window, other) for other in others]
    try:
        for one in every:
            one.player.start()
        while not any(one.controls.closed for one in every) and time.monotonic() < end:
            for one in every:
                one.turn()
            for mirror in mirrors:
                mirror.turn()
            window.wait()
    finally:
        for one in every:
            one.close()
    for one in every:
        if one.player.error is not None:
            raise one.player.error
    return window.drawn


class Mirror:
    """Brings two windows to the same camera, layer and style, whichever of them was changed.

    Parameters
    ----------
    left, right : Window
    """

    def __init__(self, left: Window, right: Window) -> None:
        self.scenes = left.scene, right.scene
        self._known = [None, *_shown(left.scene)[1:]]
        self._seen = [scene.data.moment for scene in self.scenes]

    def turn(self) -> None:
        """Bring the one to what the other was changed to; draw differences of new samples."""
        sides = self.scenes, self.scenes[::-1]
        same = self.scenes[0].robot.name == self.scenes[1].robot.name
        for k, follow in enumerate(ALIKE):
            for led, other in sides if same or k else ():
                if (now := _shown(led)[k]) != self._known[k]:
                    follow(led, other)
                    self._known[k] = now
                    break
        seen = [scene.data.moment for scene in self.scenes]
        for (_, other), moment, before in zip(sides, seen, self._seen, strict=True):
            if moment is not before and other.layer.name == "difference":
                other.set_layer("difference")
        self._seen = seen


def _shown(scene: Scene) -> tuple[Any, str, str]:
    """Camera, layer and style."""
    camera = scene.plotter.camera
    where = camera.position, camera.focal_point, camera.up, camera.view_angle
    return where, scene.layer.name, scene.style


def _look_alike(led: Scene, other: Scene) -> None:
    other.framing.look(led.framing.view, "free")
    other.plotter.camera.DeepCopy(led.plotter.camera)
    other.plotter.renderer.ResetCameraClippingRange()
    other.canvas.changed = True


ALIKE: tuple[Callable[[Scene, Scene], None], ...] = (
    _look_alike,
    lambda led, other: other.set_layer(led.layer.name),
    lambda led, other: other.set_style(led.style),
)  # how the other one follows: camera, layer, style


def play(scene: Scene, moments: Iterable[Moment], *, seconds: float = math.inf) -> int:
    """Show moments in a scene's window until it is closed; pictures drawn.

    Parameters
    ----------
    scene : Scene
        Made with `off_screen=False`.
    moments : TouchLoop or iterable of Moment
    seconds : float
        Close it by itself after so long.

    Returns
    -------
    int
        Pictures drawn.

    Examples
    --------
    >>> from viewer import Scene, play
    >>> scene = Scene.load("kaspar", ["torso"])  # off screen: off_screen=False opens a window
    >>> play(scene, [scene.moment], seconds=0.2) >= 0
    True
    """
    window = Window(scene, Player(moments))
    window.open()
    return run(window, seconds=seconds)


def open_window(
    session: Session,
    look: Look,
    *,
    seconds: float | None,
    view_file: Path | None,
    other: Session | None = None,
    later: float = 0.0,
) -> ViewWindow:
    """Play the source in a window until it is closed, and another one in a window beside it.

    Parameters
    ----------
    session : Session
    look : Look
        Of both.
    seconds : float or None
        Close them by themselves after so long.
    view_file : Path or None
    other : Session, optional
        What plays at the right, in step.
    later : float
        How much later that stands in its recording [s].
    """
    with contextlib.ExitStack() as ended:
        sessions, windows = [session] if other is None else [session, other], list[Window]()
        players = new_players(sessions, later)
        for one, player in zip(sessions, players, strict=True):
            ended.callback(player.close)
            mine = look_beside(look, session, one)
            scene = new_scene(one, mine, size=SIZE, off_screen=False)
            windows.append(Window(scene, player, view_file=view_file))
        if other is None:
            windows[0].open()
        else:
            Pair(*(window.scene.data for window in windows))
            for k, (window, one) in enumerate(zip(windows, sessions, strict=True)):
                window.scene.set_layer(window.scene.layer.name)  # on the scale of both
                window.open(f"Skinmap, {(LEFT, RIGHT)[k]}: {one.title}", k * SIZE[0])
        for player in players:  # a recording begins when its window is open
            player.start()
            player.play()
        drawn = run(*windows, seconds=math.inf if seconds is None else seconds)
    return ViewWindow(robot=session.robot.name, parts=list(session.parts), drawn=drawn)

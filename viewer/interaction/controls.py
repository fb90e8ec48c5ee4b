"""What keys and mouse ask of a scene and its player; no window and no VTK event in here."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

from skinmap.errors import SkinError
from viewer.drawing.frame.camera import focus, preset
from viewer.drawing.frame.canvas import FOOT
from viewer.drawing.touches.traces import PLOT_KINDS
from viewer.drawing.touches.traces import SPANS as SPANS_PLOTTED
from viewer.interaction.mouse import Lasso, Mouse, Pace, Reach
from viewer.interaction.overlays import Notice, Slider, Spans, TextBox
from viewer.interaction.pointing import Pointing, within
from viewer.interaction.view_file import apply_view, free_name, load_view, save_view, view_of
from viewer.playing.player import Player
from viewer.results import LAYERS
from viewer.scene import Scene

SPANS, MANY = 1.0, 300  # between two looks at the touches [s] where there are so many
SMALL = 0.85  # letters of the help beside those of the rest


@dataclass(frozen=True, slots=True)
class Key:
    """One line of the help.

    Attributes
    ----------
    shown : str
        Keys as people read them.
    text : str
        What they do.
    actions : dict of str to tuple
        By names of keys, as X11 and VTK have them ("space", "Right", "plus"): a method of
        `viewer.interaction.controls.Controls`, or of a part of it, and what it gets.
    """

    shown: str
    text: str
    actions: dict[str, tuple[Any, ...]]


QUICKER, SLOWER = ("change_speed", 2.0), ("change_speed", 0.5)
KEYS = (
    Key("space", "pause, go on", {"space": ("player.toggle",)}),
    Key("left right", "one sample back, on", {"Left": ("step", -1), "Right": ("step", 1)}),
    Key("down up", "one second back, on", {"Down": ("jump", -1.0), "Up": ("jump", 1.0)}),
    Key("home", "to the beginning", {"Home": ("jump", -1e9)}),
    Key(", .", "touch before, next", {"comma": ("next_touch", -1), "period": ("next_touch", 1)}),
    Key(
        "+ -",
        "quicker, slower",
        dict.fromkeys(("plus", "KP_Add", "equal"), QUICKER)
        | dict.fromkeys(("minus", "KP_Subtract"), SLOWER),
    ),
    Key("l", "loop", {"l": ("toggle_loop",)}),
    Key("0", "zero forces, untouched", {"0": ("zero",), "KP_0": ("zero",)}),
    Key(
        "1 to 9",
        ", ".join(LAYERS[:4]),
        {
            f"{pad}{k}": ("scene.set_layer", n)
            for k, n in enumerate(LAYERS[:9], 1)
            for pad in ("", "KP_")
        },
    ),
    Key("", ", ".join(LAYERS[4:]), {}),
    Key("d", "discs or surface", {"d": ("toggle_style",)}),
    Key("tab", "flat map of the next part", {"Tab": ("next_map",)}),
    Key("k", "plot taxels, or how touches went", {"k": ("next_plot",)}),
    Key("c", "choose nothing", {"c": ("pointing.clear",)}),
    Key("f b", "look from front, back", {"f": ("look", "front"), "b": ("look", "back")}),
    Key(
        "[ ] t",
        "left, right, top",
        {"bracketleft": ("look", "left"), "bracketright": ("look", "right"), "t": ("look", "top")},
    ),
    Key("g", "go to the touches", {"g": ("focus",)}),
    Key("r", "the whole robot again", {"r": ("whole",)}),
    Key("a", "follow touches, or rest", {"a": ("follow",)}),
    Key("v V", "save, load the view", {"v": ("save_view",), "V": ("load_view",)}),
    Key("s", "screenshot", {"s": ("screenshot",)}),
    Key("h", "this help", dict.fromkeys(("h", "question"), ("toggle_help",))),
    Key("esc", "close help and box", {"Escape": ("put_away",)}),
    Key("q", "close the window", {"q": ("close",)}),
)
MOUSE = (
    ("drag", "turn (left), move (middle)"),
    ("wheel", "zoom"),
    ("point", "what a taxel is"),
    ("click", "choose it, shift: its module"),
    ("", "ctrl: patch, both: add"),
    ("map", "drag draws a lasso, shift: add"),
    ("lanes", "wheel: zoom, drag: move"),
    ("plot", "wheel: zoom, point: values"),
)
WIDE = 11  # letters of the first column


def help_lines() -> tuple[str, ...]:
    """The help overlay."""
    rows = [(key.shown, key.text) for key in KEYS]
    return tuple(f"{shown:<{WIDE}}{text}" for shown, text in (*rows, ("", ""), *MOUSE))


class Controls:
    """What can be done with a scene.

    Parameters
    ----------
    scene : Scene
    player : Player
    folder : Path
        Where screenshots go.
    view_file : Path
        Where the view is saved and loaded.

    Attributes
    ----------
    closed : bool
        Whether the user wants to leave.
    folder, view_file : Path
        As given; the present folder, and a file in it.
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
        self.closed = False
        self.changed = True  # since the last picture
        self.following = True  # whether the flat map goes with the touches
        self.pointing = Pointing(scene)
        self.folder = Path() if folder is None else folder
        self.view_file = self.folder / "skinmap-view.json" if view_file is None else view_file
        self.mouse = Mouse(self)
        body = scene.plotter.renderers[0]
        self.slider = Slider(body, scene.font_px)
        self.notice = Notice(body, scene.font_px)
        self._help = TextBox(body, round(SMALL * scene.font_px), mono=True)
        self._told: tuple[int, int] = (-1, 0)
        self._asked_spans = Pace(SPANS, time.perf_counter)
        self._marks: Spans = ()
        self._size = (scene.font_px, *body.GetSize())
        scene.canvas.reserve(self.slider.room)

    # Keys.

    def press(self, name: str) -> bool:
        """Do what a key stands for; False for keys that stand for nothing."""
        action = next((key.actions[name] for key in KEYS if name in key.actions), None)
        if action is None:
            return False
        method, *arguments = action
        try:
            attrgetter(method)(self)(*arguments)
        except SkinError as error:  # a folder that cannot be written to ends no session
            self.say(str(error))
        self.changed = True
        return True

    @property
    def help_shown(self) -> bool:
        """Whether the list of keys is in the picture."""
        return self._help.shown

    def toggle_help(self) -> None:
        """Show or hide the list of keys."""
        if self._help.shown:
            self._help.hide()
        else:
            self._help.tell(("", *help_lines(), ""))

    def put_away(self) -> None:
        """Close what lies over the picture: the help, else the box at a taxel, else a notice."""
        if self._help.shown:
            self._help.hide()
        elif not self.pointing.put_away():
            self.notice.hide()

    def say(self, text: str) -> None:
        """Show a short line for some seconds."""
        self.notice.say(text)
        self.changed = True

    def close(self) -> None:
        """End the session."""
        self.closed = True

    # Time.

    def step(self, count: float) -> None:
        """Show another sample."""
        if not self.player.step(int(count)):
            self.say("no further sample that way")

    def jump(self, seconds: float) -> None:
        """Go so many seconds on."""
        if not self.player.seek(max(0.0, self.player.position + seconds)):
            self.say("nothing is remembered yet")

    def next_touch(self, way: int) -> None:
        """Go to the next touch, or to the one before."""
        if not self.player.next_touch(way):
            self.say("no touch is known that way")

    def change_speed(self, factor: float) -> None:
        """Play quicker or slower."""
        before = self.player.speed
        self.player.speed = before * factor
        told = f"speed {self.player.speed:g}" if self.player.speed != before else "no other speed"
        self.say(told)

    def toggle_loop(self) -> None:
        """Let a recording start again at its end, or not."""
        self.player.loop = not self.player.loop
        self.say("plays over and over" if self.player.loop else "plays once")

    def zero(self) -> None:
        """Take the zero of the forces anew."""
        age = self.player.zero_age
        self.player.zero()
        self.say("no load calibration" if age is None else f"zero anew; it was {age:.0f} s old")

    # What is shown.

    def toggle_style(self) -> None:
        """Discs or an interpolated surface."""
        self.scene.set_style("surface" if self.scene.style == "discs" else "discs")

    def next_map(self) -> None:
        """The flat map of the next part, and it stays."""
        if self.scene.panel is None:
            return
        parts = list(self.scene.panel.flat_maps)
        part = parts[(parts.index(self.scene.panel.part) + 1) % len(parts)]
        self.scene.show_flat_map(part)
        self.following = False

    def next_plot(self) -> None:
        """Plot the chosen taxels, or force, pressure, area, ... of the touches."""
        plot = PLOT_KINDS[(PLOT_KINDS.index(self.scene.plot) + 1) % len(PLOT_KINDS)]
        self.scene.set_plot(plot)
        self.say(f"plot: {plot if plot != 'taxels' else 'chosen taxels'}")

    # The camera.

    def look(self, name: str) -> None:
        """Look from a side, and stay there."""
        self.scene.framing.look(preset(name, self.scene.front), "still")

    def whole(self) -> None:
        """The whole robot from where most of its skin is seen."""
        self.scene.framing.look(self.scene.front, "still")

    def focus(self) -> None:
        """Bring what is touched close."""
        if not focus(self.scene.framing, self.scene.canvas.touch_view.targets):
            self.say("nothing is touched")

    def follow(self) -> None:
        """Let camera and flat map turn to the touches by themselves, or the camera rest again."""
        framing = self.scene.framing
        rests = framing.mode == "auto"
        framing.look(framing.view, "still" if rests else "auto")
        self.say("the camera rests" if rests else "camera and map follow the touches")
        self.following = True

    def lead(self) -> None:
        """The mouse takes the camera: it obeys nothing else until a key gives it back."""
        self.scene.framing.mode = "free"
        self.changed = True

    # Files.

    def save_view(self) -> None:
        """Write what is shown and from where."""
        save_view(view_of(self.scene, self.pointing.selection), self.view_file)
        self.say(f"view saved in {self.view_file.name}")

    def load_view(self) -> None:
        """Go back to a saved view."""
        apply_view(self.scene, load_view(self.view_file), self.pointing.selection)
        self.pointing.refresh()
        self.following = self.scene.framing.mode == "auto"
        self.say(f"view of {self.view_file.name}")

    def screenshot(self) -> None:
        """Write the picture."""
        path = self.scene.screenshot(free_name(self.folder, "skinmap", ".png"))
        self.say(f"wrote {path.name}")

    # The mouse: `viewer.interaction.mouse.Listener`.

    def over_slider(self, x: float, y: float) -> bool:
        """Whether a press there takes the time slider."""
        return self.slider.holds(x, y)

    def over_map(self, x: float, y: float) -> bool:
        """Whether the flat map's panel is there."""
        panel = self.scene.panel
        return panel is not None and within(panel.renderer, x, y)

    def over_lanes(self, x: float, y: float) -> bool:
        """Whether the lanes of the time line are there."""
        return self.slider.over_lanes(x, y)

    def pan(self, pixels: float) -> None:
        """Move what is seen of the time line."""
        self.slider.move(pixels)
        self.changed = True

    def zoom(self, x: float, y: float, factor: float) -> bool:
        """Zoom the time line or the plot there; False where neither is."""
        panel = self.scene.panel
        if self.slider.over_lanes(x, y) or self.slider.holds(x, y):
            self.slider.zoom(x, factor)
        elif panel is not None and panel.over_plot(x, y):
            here = SPANS_PLOTTED.index(self.scene.plot_seconds)
            place = min(max(here + (1 if factor > 1.0 else -1), 0), len(SPANS_PLOTTED) - 1)
            self.scene.plot_seconds = SPANS_PLOTTED[place]
            self.scene.canvas.changed = True
        else:
            return False
        self.changed = True
        return True

    def slide(self, x: float) -> None:
        """Lead the recording to where the slider was dragged."""
        self.player.seek(self.slider.seconds(x))
        self.changed = True

    def trace(self, lasso: Lasso | None) -> None:
        """Draw the lasso, or take it away."""
        self.pointing.trace(lasso)
        self.changed = True

    def enclose(self, lasso: Lasso, *, add: bool) -> None:
        """Choose what lies within the lasso."""
        self.pointing.enclose(lasso, add=add)
        self.changed = True

    def click(self, x: float, y: float, reach: Reach, *, add: bool) -> None:
        """Choose what is at a pixel."""
        self.pointing.click(x, y, reach, add=add)
        self.changed = True

    def point(self, x: float, y: float) -> None:
        """The mouse is somewhere."""
        self.pointing.point(x, y)
        self.slider.point(x, y)
        panel = self.scene.panel
        if panel is not None and panel.point(x, y):
            self.scene.canvas.changed = self.changed = True

    def leave(self) -> None:
        """The mouse has left the window: nothing is pointed at."""
        self.pointing.leave()
        self.changed = True

    def redraw(self) -> None:
        """The window has another size, or was covered."""
        self.changed = True

    def remove(self) -> None:
        """Take everything out of the scene that was put there."""
        self.pointing.remove()
        for thing in (self.slider, self.notice, self._help):
            thing.remove()
        self.scene.canvas.reserve(FOOT)

    # Each turn of the loop.

    def tick(self) -> bool:
        """Bring boxes, slider and notices up to date; whether a picture is to be drawn."""
        self._fit()
        self.changed |= self.pointing.tick(self.player.moment)
        self.changed |= self.notice.over()
        player = self.player
        plotting = self.scene.plot != "taxels" or bool(self.scene.selection)
        player.remember(self.scene.plot_seconds if plotting else 0.0)
        spans = self._spans()
        if player.moment is not None and not self.slider.lanes:
            # A lane for each part that comes.
            lanes = (part for part in self.scene.layers if part in player.moment.pressures)
            self.slider.lanes = tuple(lanes)
            self.scene.canvas.reserve(self.slider.room)
        self.slider.show(
            player.position, player.span, self.state(), spans, live=not player.seekable
        )
        changed, self.changed = self.changed, False
        return changed

    def _spans(self) -> Spans:
        """Touches on the lanes, asked for when there are others, not too often where many are."""
        version = (self.player.timeline.version, round(self.player.span[0]))
        many = len(self._marks) > MANY
        if version != self._told and (not many or self._asked_spans.due()):
            self._told = version
            self._marks = tuple(tuple(one) for one in self.player.spans())  # type: ignore[misc]
        return self._marks

    def _fit(self) -> None:
        """Follow a window of another size."""
        font = self.scene.font_px
        size = (font, *self.scene.plotter.renderers[0].GetSize())
        if size == self._size:
            return
        self._size = size
        self.slider.scale(font)
        self.scene.canvas.reserve(self.slider.room)
        self.notice.scale(font)
        self.pointing.scale(font)
        self._help.scale(round(SMALL * font))
        if self._help.shown:
            self._help.tell(help_lines())
        self.changed = True

    def state(self) -> str:
        """How it is played, in a few words."""
        player = self.player
        if player.error is not None:
            return "the source failed"
        words = []
        if player.paused:
            words.append("paused")
        elif player.ended:
            words.append("ended")
        if player.speed != 1.0:
            words.append(f"x{player.speed:g}")
        if player.loop:
            words.append("loop")
        if (count := self.pointing.selection.count) > 0:
            words.append(f"{count} taxels chosen" if count > 1 else "1 taxel chosen")
        if not math.isfinite(player.duration) and not player.seekable and not words:
            words.append("h: help")
        return ", ".join(words)

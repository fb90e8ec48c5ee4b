"""The keys of the window and what they do; the help overlay and the documents list them all."""

from __future__ import annotations

from dataclasses import dataclass

from viewer.layers import LAYERS


@dataclass(frozen=True, slots=True)
class Key:
    """One line of the help.

    Attributes
    ----------
    names : tuple of str
        As X11 and VTK name the keys ("space", "Right", "plus").
    shown : str
        As people read them.
    text : str
        What they do; empty where another line tells it.
    action : str
        Name of a method of `viewer.interaction.controls.Controls`, or of its `files`.
    argument : str or float, optional
        What the method gets.
    """

    names: tuple[str, ...]
    shown: str
    text: str
    action: str
    argument: str | float | None = None


KEYS = (
    Key(("space",), "space", "pause, go on", "toggle_pause"),
    Key(("Right",), "left right", "one sample back, on", "step", 1),
    Key(("Left",), "", "", "step", -1),
    Key(("Up",), "down up", "one second back, on", "jump", 1.0),
    Key(("Down",), "", "", "jump", -1.0),
    Key(("Home",), "home", "to the beginning", "jump", -1e9),
    Key(("plus", "KP_Add", "equal"), "+ -", "quicker, slower", "change_speed", 2.0),
    Key(("minus", "KP_Subtract"), "", "", "change_speed", 0.5),
    Key(("l",), "l", "loop", "toggle_loop"),
    Key(("1", "KP_1"), "1 to 8", ", ".join(LAYERS[:4]), "choose_layer", LAYERS[0]),
    *(
        Key((str(k + 1), f"KP_{k + 1}"), "", "", "choose_layer", name)
        for k, name in enumerate(LAYERS)
        if k
    ),
    Key((), "", ", ".join(LAYERS[4:]), ""),
    Key(("d",), "d", "discs or surface", "toggle_style"),
    Key(("Tab",), "tab", "flat map of the next part", "next_map"),
    Key(("k",), "k", "plot taxels, force, area, speed", "next_plot"),
    Key(("m",), "m p c", "choose module, patch; clear", "choose_module"),
    Key(("p",), "", "", "choose_patch"),
    Key(("c",), "", "", "clear"),
    Key(("f",), "f b", "look from front, back", "look", "front"),
    Key(("b",), "", "", "look", "back"),
    Key(("bracketleft",), "[ ] t", "left, right, top", "look", "left"),
    Key(("bracketright",), "", "", "look", "right"),
    Key(("t",), "", "", "look", "top"),
    Key(("g",), "g", "go to the touches", "focus"),
    Key(("r",), "r", "the whole robot again", "whole"),
    Key(("a",), "a", "camera and map follow touches", "follow"),
    Key(("v",), "v V", "save, load the view", "files.save_view"),
    Key(("V",), "", "", "load_view"),
    Key(("s",), "s", "screenshot", "files.screenshot"),
    Key(("o",), "o", "movie: start, end", "files.toggle_movie"),
    Key(("x",), "x e", "export glTF, HTML page", "files.export_gltf"),
    Key(("e",), "", "", "files.export_html"),
    Key(("h", "question"), "h", "this help", "toggle_help"),
    Key(("Escape",), "esc", "close help and box", "put_away"),
    Key(("q",), "q", "close the window", "close"),
)
MOUSE = (
    ("drag", "turn (left), move (middle)"),
    ("wheel", "zoom"),
    ("point", "what a taxel is"),
    ("click", "choose it, shift: its module"),
    ("", "ctrl: patch, both: add"),
    ("map", "drag draws a lasso, shift: add"),
)
WIDE = 11  # letters of the first column


def help_lines() -> tuple[str, ...]:
    """The help overlay."""
    rows = [(key.shown, key.text) for key in KEYS if key.text]
    return tuple(f"{shown:<{WIDE}}{text}" for shown, text in (*rows, ("", ""), *MOUSE))


def key_for(name: str) -> Key | None:
    """What a key does; None for others."""
    return next((key for key in KEYS if name in key.names), None)

"""Colours of the viewer, safe for colour-blind eyes: warm for pressure, cool for classes."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.touch.simulation.gestures import GESTURES, TIME

BACKGROUND = "#f7f8fa"
PANEL = "#ffffff"
INK = "#20262e"
FAINT = "#5f6772"  # 5.4:1 on the ground
WARNING = "#b42318"
BODY = "#a6b0bb"
SHEET = "#dde1e6"  # the skin under discs
RIM = "#6f7882"
DOT = "#59616b"

# Light to dark without a step back, so that it also reads in grey: rest is a very light neutral.
PRESSURE_STOPS = (
    (0.00, "#f4f2ec"),
    (0.08, "#fbe9c0"),
    (0.25, "#fdc370"),
    (0.45, "#f58b3a"),
    (0.65, "#dc4a26"),
    (0.82, "#a8182c"),
    (1.00, "#5c0a2e"),
)
# What is no pressure has another hue, so that no two layers are taken for each other. All are
# even in lightness: they read in grey, and to every eye.
RAW_STOPS = (
    (0.00, "#440154"), (0.20, "#414487"), (0.40, "#2a788e"), (0.60, "#22a884"),
    (0.80, "#7ad151"), (1.00, "#fde725"),
)  # fmt: skip  # values of viridis (Smith and van der Walt, 2015, CC0): dark is low
UNCERTAINTY_STOPS = (
    (0.00, "#eef4f1"), (0.20, "#c3dfe0"), (0.40, "#83bfcf"), (0.60, "#4592b8"),
    (0.80, "#1f5d9c"), (1.00, "#101a4d"),
)  # fmt: skip
DISTORTION_STOPS = (
    (0.00, "#f5f2f5"), (0.20, "#e2cfe6"), (0.40, "#c39dd0"), (0.60, "#9a68b3"),
    (0.80, "#6d3390"), (1.00, "#2b0a42"),
)  # fmt: skip
TOUCHED_STOPS = (
    (0.00, "#f3f5f1"), (0.05, "#d9ecd3"), (0.25, "#a3d5b0"), (0.50, "#56ad97"),
    (0.75, "#23757c"), (1.00, "#0b2f4a"),
)  # fmt: skip  # where skin was touched: green to blue, even in lightness
# Less is blue, more is orange, white is the same: apart for every eye.
DIFFERENCE_STOPS = (
    (0.00, "#08306b"), (0.25, "#4a90c8"), (0.50, "#f7f7f5"), (0.75, "#f19a3e"), (1.00, "#8c2d04"),
)  # fmt: skip
UNKNOWN = "#78818f"  # a taxel of which nothing is known
FADED = 0.6  # how far what is silent goes there
TOUCHED, UNTOUCHED = "#c2410c", "#f4f2ec"
# For things without an order: at least 0.37 apart in sRGB, from each other, from grey and from
# white, under red-green blindness of both kinds and under tritan vision (found by a search).
CATEGORIES = (
    "#0905ec", "#fcd168", "#a03e36", "#01c90b", "#6c559e", "#410100", "#d020ff", "#000066",
)  # fmt: skip
# Lines on white: dark enough to be seen, and apart for every eye.
TRACES = ("#0b3d91", "#d98200", "#2f9fe0", "#592424", "#6130f2", "#80734c")
RARER, NONE = "#a6b0bb", "#ffffff"
HEALTH = {
    "ok": "#8fd0b0",
    "never touched": "#e9eef6",
    "dead": "#15181d",
    "stuck": "#6a1fc2",
    "saturated": "#d55e00",
    "noisy": "#ffd60a",
    "unheard": "#f262fe",
    "stale": "#7a6f66",
}

# Cool or dark, so that none is taken for a pressure; of even strength, so that no name shouts, and
# each at least 2:1 against the ground. At least 0.3 apart in sRGB under red-green blindness of both
# kinds and under tritan vision (found by a search that kept blue, violet and near-black).
CLASS_COLOURS = (
    "#1f6fd0", "#5a961f", "#6a1b7a", "#101418", "#27c6a9", "#94bf57",
    "#ee8dfa", "#015f03", "#996882",
)  # fmt: skip
# Of touches that are told by their course: at least 0.17 from each other and from those above.
MOTION_COLOURS = (
    "#c982d4", "#465343", "#401d4c", "#4c40ae", "#50af7e", "#3d9151", "#040a6f", "#9485a8",
)  # fmt: skip
# Kinds of things that are named beside the first nine, so that no two kinds share a colour.
FURTHER_COLOURS = {
    "plate": "#3b3f8f", "ring": "#7fa3c7", "corner": "#4d6b57", "gripper": "#a08fd8",
    "shoulder": "#5c4630",
}  # fmt: skip
NAMELESS = "#66717d"
READABLE = 4.5  # contrast of letters (WCAG 2.1)
BLACK = "#000000"
NO_NAMES = ("touch", "unknown", "no_contact")  # as the loop and classifiers have them


@lru_cache(maxsize=256)
def rgb(colour: str) -> FloatArray:
    """(3,) red, green and blue from 0 to 1 of a colour written `#rrggbb`; not to be written to."""
    channels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    channels.flags.writeable = False
    return channels


def steps(colours: Iterable[str]) -> NDArray[np.uint8]:
    """(k, 4) table of some colours, one for each category."""
    table = [[*np.rint(rgb(colour) * 255), 255] for colour in colours]
    return np.array(table).reshape(-1, 4).astype(np.uint8)


def repeated(colours: Sequence[str], counts: Sequence[int]) -> NDArray[np.uint8]:
    """(sum of counts, 3) bytes: each colour as often as its count says."""
    return np.repeat(steps(colours)[:, :3], np.array(counts, np.int64), axis=0)


def ramp(stops: Sequence[tuple[float, str]], n: int = 256) -> NDArray[np.uint8]:
    """(n, 4) table of red, green, blue and opacity through stops (place, colour)."""
    places, wanted = [place for place, _ in stops], np.linspace(0.0, 1.0, n)
    channels = np.array([rgb(colour) for _, colour in stops]).T
    table = [*(np.interp(wanted, places, one) for one in channels), np.ones(n)]
    return np.rint(np.column_stack(table) * 255).astype(np.uint8)


def class_colour(label: str) -> str:
    """The colour of a class of touches: the same in every picture and every run.

    Each name of ours has its own; other names take one by their letters.
    """
    if label in NO_NAMES:
        return NAMELESS
    own = dict(zip(GESTURES, CLASS_COLOURS, strict=False))
    own |= dict(zip(TIME, MOTION_COLOURS, strict=False)) | FURTHER_COLOURS
    if label in own:
        return own[label]
    return CLASS_COLOURS[(len(own) + zlib.crc32(label.encode())) % len(CLASS_COLOURS)]


def touch_colour(touch: NamedTouch) -> str:
    """The colour of a touch: of its kind where a model answers that, else of its label.

    One without a name is grey, whatever kind is the likeliest.
    """
    if touch.kind is None or touch.label in NO_NAMES:
        return class_colour(touch.label)
    return class_colour(touch.kind.answer)


def hexed(channels: Iterable[float]) -> str:
    """`#rrggbb` of red, green and blue from 0 to 1."""
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in channels)


def mixed(colour: str, other: str, share: float) -> str:
    """A colour with so much of another one in it."""
    return hexed(((1.0 - share) * rgb(colour) + share * rgb(other)).tolist())


def faded(colour: str) -> str:
    """The colour of a thing of which nothing new is heard, on its way to the ground's."""
    return mixed(colour, BACKGROUND, FADED)


def luminance(colours: FloatArray) -> FloatArray:
    """(n,) relative luminance of colours (n, 3) from 0 to 1 (ITU-R BT.709, linear light)."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return np.asarray(linear @ np.array([0.2126, 0.7152, 0.0722]))


def contrast(colour: str, other: str) -> float:
    """1 to 21, of letters on their ground (WCAG 2.1)."""
    light = luminance(np.array([rgb(colour), rgb(other)])) + 0.05
    return float(light.max() / light.min())


@lru_cache(maxsize=256)
def ink_on(colour: str) -> str:
    """White, dark or black letters, the first that can be read on a colour."""
    return next(ink for ink in ("#ffffff", INK, BLACK) if contrast(ink, colour) >= READABLE)

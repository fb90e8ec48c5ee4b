"""Colours of the viewer, safe for colour-blind eyes: warm for pressure, cool for classes."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.touch.gestures import GESTURES

BACKGROUND = "#f7f8fa"
PANEL = "#ffffff"
INK = "#20262e"
FAINT = "#6b7480"
BODY = "#a6b0bb"
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
# Cool or dark, so that none is taken for a pressure, and each of another lightness.
CLASS_COLOURS = (
    "#1f6fd0", "#00966f", "#6a1b7a", "#101418", "#4fb0e8", "#5d6b00",
    "#c2f200", "#0002f2", "#94f291",
)  # fmt: skip


def rgb(colour: str) -> FloatArray:
    """(3,) red, green and blue from 0 to 1 of a colour written `#rrggbb`."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def pressure_colours(n: int = 256) -> NDArray[np.uint8]:
    """(n, 4) table of red, green, blue and opacity from rest to full scale, 0 to 255."""
    places = np.array([place for place, _ in PRESSURE_STOPS])
    stops = np.array([rgb(colour) for _, colour in PRESSURE_STOPS])
    wanted = np.linspace(0.0, 1.0, n)
    table = np.ones((n, 4))
    for column in range(3):
        table[:, column] = np.interp(wanted, places, stops[:, column])
    return np.rint(table * 255).astype(np.uint8)


def class_colour(label: str) -> str:
    """The colour of a class of touches: the same in every picture and every run."""
    names = list(GESTURES)
    number = names.index(label) if label in names else len(names) + zlib.crc32(label.encode())
    return CLASS_COLOURS[number % len(CLASS_COLOURS)]


def luminance(colours: FloatArray) -> FloatArray:
    """(n,) relative luminance of colours (n, 3) from 0 to 1 (ITU-R BT.709, linear light)."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return np.asarray(linear @ np.array([0.2126, 0.7152, 0.0722]))

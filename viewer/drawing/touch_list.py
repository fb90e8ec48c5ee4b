"""The list of touches beside the body: two lines each, and how many more there are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from vtkmodules.vtkRenderingCore import vtkRenderer

from skinmap.live.touches import NamedTouch
from viewer.colours import FAINT, INK, class_colour, ink_on
from viewer.drawing.overlays import Line

HEAD, ROW, SMALL = 1.9, 2.95, 0.82  # heights in font heights; size of the second line
LETTER, GAP = 0.46, "   "  # mean width of a letter in its height; between two words
MOST = 6  # touches listed
ROOM = 0.4  # of the panel's height at most


class TouchList:
    """Rows at the bottom of a panel, each written only when it changes."""

    def __init__(self, renderer: vtkRenderer) -> None:
        self.renderer = renderer
        self._head = Line(renderer, (0.0, 0.0), 12, bold=True)
        self._rows = [
            (Line(renderer, (0.0, 0.0), 12, bold=True), Line(renderer, (0.0, 0.0), 12))
            for _ in range(MOST)
        ]
        self._more = Line(renderer, (0.0, 0.0), 12)
        self.fits = MOST
        self._left, self._font_px = 0.0, 12

    @property
    def texts(self) -> tuple[str, ...]:
        """All that is written now, from the top."""
        lines = [self._head, *[line for row in self._rows for line in row], self._more]
        return tuple(line.text for line in lines if line.text)

    def height(self, font_px: int) -> float:
        """What it takes from the bottom of the panel [px]."""
        room = ROOM * float(self.renderer.GetSize()[1]) / font_px - HEAD
        self.fits = int(np.clip(room / ROW, 1, MOST))
        return (HEAD + ROW * self.fits + 1.0) * font_px

    def place(self, left: float, font_px: int) -> None:
        """Stand at the bottom, `left` [px] from the side."""
        self._left, self._font_px = left, font_px
        small = round(SMALL * font_px)
        top = self.height(font_px)
        self._head.style(font_px, bold=True)
        self._head.move(left, top)
        for row, (name, about) in enumerate(self._rows):
            y = top - (HEAD + ROW * row) * font_px
            name.style(font_px, bold=True)
            name.move(left, y)
            about.style(small)
            about.move(left, y - 1.4 * font_px)
        self._more.style(small)
        self._more.move(left, top - (HEAD + ROW * self.fits) * font_px + 0.2 * font_px)

    def show(self, touches: Sequence[NamedTouch], time: float) -> None:
        """List touches as they are at a time [s]."""
        count = len(touches)
        self._head.write("no touch" if not count else f"{count} touch{'es' * (count > 1)}")
        fits = min(self.fits, MOST)
        for row, (name, about) in enumerate(self._rows):
            if row < min(count, fits):
                colour = class_colour(touches[row].label)
                name.fill(colour)
                name.write(f" {caption(touches[row])} ", ink_on(colour))
                about.write(self._fitting(details(touches[row], time)), FAINT)
            else:
                name.write("")
                about.write("")
        self._more.write(f"+{count - fits} more" if count > fits else "", INK)

    def _fitting(self, words: Sequence[str]) -> str:
        """As many of the words as the panel is wide, the first ones first."""
        width = float(self.renderer.GetSize()[0]) - 2.0 * self._left
        room = int(width / (LETTER * SMALL * self._font_px))
        while len(words) > 1 and len(GAP.join(words)) > room:
            words = words[:-1]
        return GAP.join(words)


def caption(touch: NamedTouch) -> str:
    """A touch in words: its class, and how sure it is, where anybody says."""
    name = touch.label.replace("_", " ")
    return f"{name} {touch.confidence:.0%}".replace("%", " %") if known(touch.confidence) else name


def details(touch: NamedTouch, time: float) -> list[str]:
    """Where a touch is and how large, hard and long; what is not known is left out."""
    words = [touch.part.replace("_", " ")]
    if known(touch.area):
        words.append(f"{1e6 * touch.area:,.0f} mm\N{SUPERSCRIPT TWO}")
    if known(touch.peak):
        words.append(f"peak {touch.peak:.0f}")
    if known(touch.force):
        words.append(f"{touch.force:.1f} N")
    if known(time - touch.began):
        words.append(f"{max(time - touch.began, 0.0):.1f} s")
    return words


def known(number: float | None) -> bool:
    """Whether there is such a number."""
    return number is not None and bool(np.isfinite(number))

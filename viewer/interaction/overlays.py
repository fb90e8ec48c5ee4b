"""What lies over the picture: the box at a taxel, the help, short notices, the time slider."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from vtkmodules.vtkRenderingCore import vtkRenderer

from skinmap.arrays import FloatArray
from viewer.colours import FAINT, INK, PANEL, RIM, rgb
from viewer.drawing.words.shapes import Shape, Shapes, disc, rectangle, tint
from viewer.drawing.words.text_lines import Line

ASIDE = 1.1  # of the box from what it tells of, in letters
SECONDS = 4.0  # that a notice stays [s]
RING = 0.45  # radius of the mark on a taxel, in letters
CORNERS = 24
LEFT, RIGHT = 0.24, 0.97  # ends of the bar, in widths of the picture
RISE = 0.9  # of the bar above the lower edge, in letters
THICK = 0.32  # of the bar, in letters
HANDLE = 0.5  # radius, in letters
GRIP = 1.0  # how far beside the bar a press still counts, in letters
ROOM = 3.2  # what the slider needs at the foot of the picture, in letters
NOTE = 0.85  # height of its text, in letters
SPAN = 1.6  # of touches above the bar, in its heights
Spans = tuple[tuple[float, float, str], ...]  # from, to [s] and colour


class TextBox(Line):
    """Lines of text on a dark ground, whole inside its renderer wherever it is asked to stand."""

    def __init__(self, renderer: vtkRenderer, font_px: int, *, mono: bool = False) -> None:
        super().__init__(renderer, (0.0, 0.0), font_px)
        self.font_px = font_px
        self.actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
        style = self.actor.GetTextProperty()
        style.SetColor(*rgb(PANEL))
        style.SetBackgroundColor(*rgb(INK))
        style.SetBackgroundOpacity(0.93)
        style.SetVerticalJustificationToBottom()
        if mono:
            style.SetFontFamilyToCourier()
        self.write("")

    @property
    def shown(self) -> bool:
        """Whether it is in the picture."""
        return bool(self.actor.GetVisibility())

    def remove(self) -> None:
        """Take it out of the renderer."""
        self.renderer.RemoveViewProp(self.actor)

    def hide(self) -> None:
        """Take it out of the picture."""
        self.write("")

    def scale(self, font_px: int) -> None:
        """Write in letters of another height [px], from the next `tell` on at the right place."""
        self.font_px = font_px
        self.style(font_px)

    def tell(self, lines: Sequence[str], x: float | None = None, y: float | None = None) -> None:
        """Show lines beside a pixel (x, y) of the renderer; in its middle where none is given."""
        self.write("\n".join(f" {line} " for line in lines))
        size = [0.0, 0.0]
        self.actor.GetSize(self.renderer, size)
        width, height = self.renderer.GetSize()
        if x is None or y is None:
            left, bottom = (width - size[0]) / 2, (height - size[1]) / 2
        else:
            aside = ASIDE * self.font_px
            left, bottom = x + aside, y + aside
            if left + size[0] > width:
                left = x - aside - size[0]
            if bottom + size[1] > height:
                bottom = y - aside - size[1]
        left = min(max(left, 0.0), max(width - size[0], 0.0))
        bottom = min(max(bottom, 0.0), max(height - size[1], 0.0))
        self.actor.SetPosition(left, bottom)
        self.to_front()


class Notice(TextBox):
    """One line at the head of the picture that goes away by itself."""

    def __init__(self, renderer: vtkRenderer, font_px: int) -> None:
        super().__init__(renderer, font_px)
        self._until = 0.0

    def say(self, text: str, *, seconds: float = SECONDS) -> None:
        """Show a line for so long."""
        self._until = time.perf_counter() + seconds
        width, height = self.renderer.GetSize()
        self.tell([text], 0.24 * width, 0.885 * height)

    def stay(self) -> None:
        """Keep the line until another takes its place."""
        self._until = float("inf")

    def over(self) -> bool:
        """Take the line away when its time is up; whether that happened just now."""
        if not self.shown or time.perf_counter() < self._until:
            return False
        self.hide()
        return True


class Trace2D(Shapes):
    """A closed line in front of the picture: a lasso, or a ring at a taxel."""

    def __init__(self, renderer: vtkRenderer) -> None:
        super().__init__(renderer, 2.0)
        self.hide()

    @property
    def shown(self) -> bool:
        """Whether it is in the picture."""
        return bool(self.actor.GetVisibility())

    def hide(self) -> None:
        """Take it out of the picture."""
        self.actor.SetVisibility(False)

    def trace(self, corners: FloatArray) -> None:
        """Show a closed line through corners (k, 2) [px]."""
        self.draw([(np.vstack([corners, corners[:1]]), tint(INK))])
        self.actor.SetVisibility(True)

    def ring(self, x: float, y: float, radius: float) -> None:
        """Show a circle [px]."""
        self.trace(disc(x, y, radius, CORNERS))


class Slider:
    """A bar from 0 to a duration, drawn in front of a renderer's picture.

    Parameters
    ----------
    renderer : vtkRenderer
    font_px : int
        Height of the letters [px].
    """

    def __init__(self, renderer: vtkRenderer, font_px: int) -> None:
        self.renderer, self.font_px = renderer, font_px
        self.position, self.span = 0.0, (0.0, math.nan)
        self._touches: Spans = ()
        self._drawn: tuple[object, ...] = ()
        self._shapes = Shapes(renderer)
        self.actor = self._shapes.actor
        self.actor.SetVisibility(False)
        self._text = Line(renderer, (LEFT, 0.0), round(NOTE * font_px), colour=INK)
        self._text.write("")

    def scale(self, font_px: int) -> None:
        """Follow letters of another height [px]."""
        self.font_px = font_px
        self._text.style(round(NOTE * font_px))
        self._drawn = ()

    def remove(self) -> None:
        """Take it out of the renderer."""
        self._shapes.remove()
        self.renderer.RemoveViewProp(self._text.actor)

    @property
    def shown(self) -> bool:
        """Whether there is anything to slide through."""
        low, high = self.span
        return math.isfinite(high) and high > low

    @property
    def bar(self) -> tuple[float, float, float]:
        """Left end, right end and height of the bar's middle in the window [px]."""
        x, y = self.renderer.GetOrigin()
        width = self.renderer.GetSize()[0]
        return x + LEFT * width, x + RIGHT * width, y + RISE * self.font_px

    def holds(self, x: float, y: float) -> bool:
        """Whether a press at a pixel of the window takes the handle."""
        left, right, middle = self.bar
        grip = GRIP * self.font_px
        return self.shown and left - grip <= x <= right + grip and abs(y - middle) <= grip

    def seconds(self, x: float) -> float:
        """The time that a pixel of the window stands for [s], within the recording."""
        left, right, _ = self.bar
        share = min(max((x - left) / (right - left), 0.0), 1.0)
        low, high = self.span
        return low + share * (high - low) if self.shown else 0.0

    def place(self, seconds: float) -> tuple[float, float]:
        """Pixel of the window where the handle stands at a time [s]."""
        left, right, middle = self.bar
        low, high = self.span
        share = min(max((seconds - low) / (high - low), 0.0), 1.0) if self.shown else 0.0
        return left + share * (right - left), middle

    def show(
        self,
        position: float,
        span: tuple[float, float],
        note: str,
        touches: Spans = (),
        *,
        live: bool = False,
    ) -> None:
        """Draw the bar from one time to another [s], its handle, touches on it, and a note above.

        Of what is live, the time is told from its newest sample backwards.
        """
        self.position, self.span, self._touches = position, span, touches
        if live:  # the bar moves on with each sample: no picture is drawn for that alone
            clock = "" if note == "" else f"{position - span[1]:.1f} s"
            ends = (float(round(span[0])), float(round(span[1])))
        else:
            clock, ends = f"{position:.2f} / {span[1]:.2f} s", span
        state = (round(position, 1 if live else 3), ends, note, touches, self.renderer.GetSize())
        if state == self._drawn:
            return
        self._drawn = state
        self.actor.SetVisibility(self.shown)
        rise = (2.6 if self.shown else 1.6) * self.font_px
        self._text.actor.SetPosition(LEFT, rise / self.renderer.GetSize()[1])
        told = (clock if self.shown else "", note)
        self._text.write("   ".join(text for text in told if text))
        if self.shown:
            self._shapes.draw(polygons=self._picture())

    def _picture(self) -> list[Shape]:
        x0, y0 = self.renderer.GetOrigin()
        left, right, middle = self.bar
        left, right, middle = left - x0, right - x0, middle - y0
        x = self.place(self.position)[0] - x0
        thick = THICK * self.font_px

        def bar(start: float, end: float, rise: float, colour: str) -> Shape:
            bottom = middle + (rise - 0.5) * thick
            return rectangle(start, bottom, end - start, thick), tint(colour)

        shapes = [bar(left, right, 0.0, RIM), bar(left, x, 0.0, FAINT)]
        for began, ended, colour in self._touches:
            a, b = (self.place(time)[0] - x0 for time in (began, ended))
            shapes.append(bar(a, max(b, a + 2.0), SPAN, colour))
        handle = disc(x, middle, HANDLE * self.font_px, CORNERS)
        return [*shapes, (handle, tint(INK))]

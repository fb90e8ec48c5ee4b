"""What lies over the picture: the box at a taxel, the help, short notices, the time slider."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer

from skinmap.arrays import FloatArray
from viewer.colours import BACKGROUND, FAINT, INK, PANEL, RIM, rgb
from viewer.drawing.words.shapes import Line, Shape, Shapes, disc, rectangle, small_font, tint

ASIDE = 1.1  # of the box from what it tells of, in letters
SECONDS = 4.0  # that a notice stays [s]
LEAST = 6  # height of letters that can be read at all [px]
HEAD = 5.7  # of a notice's lower edge below the picture's upper end, in letters: under the status
RING = 0.45  # radius of the mark on a taxel, in letters
CORNERS = 24
LEFT, RIGHT = 0.24, 0.97  # ends of the bar, in widths of the picture
RISE = 0.9  # of the bar above the lower edge, in letters
THICK = 0.32  # of the bar, in letters
HANDLE = 0.5  # radius, in letters
GRIP = 1.0  # how far beside the bar a press still counts, in letters
ROOM = 3.2  # what the bar needs at the foot of the picture, in letters
NOTE = 0.85  # height of its text, in letters
ABOVE = 0.75  # from the bar's middle to the lanes, in letters
LANE, HIGHEST = 1.5, 6.0  # height of a lane, and of all at most, in letters
TICKS = 0.9  # height of the ruler's times, in letters
LANES = "#e9ebee"  # the ground of a lane
SHORTEST = 0.5  # that the lanes can be zoomed to [s]
MOST_TICKS = 8
STEPS = (
    *(0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0),
    *(3600.0, 7200.0, 10800.0, 14400.0, 21600.0, 43200.0, 86400.0, 172800.0, 604800.0),
)
# From, to [s], colour, words, part (every one of a gap) and whether it is a mark.
Spans = tuple[tuple[float, float, str, str, str, bool], ...]


class TextBox(Line):
    """Lines of text on a dark ground, whole inside its renderer wherever it is asked to stand."""

    def __init__(self, renderer: vtkRenderer, font_px: int, *, mono: bool = False) -> None:
        super().__init__(renderer, (0.0, 0.0), font_px)
        self.font_px = font_px
        self.actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
        style = self.actor.GetTextProperty()
        style.SetColor(*rgb(PANEL))
        style.SetVerticalJustificationToBottom()
        self.back(INK, 0.93)
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
        fits = min(width / max(size[0], 1.0), height / max(size[1], 1.0))
        if fits < 1.0:  # smaller letters, rather than lines that are cut
            self.style(max(math.floor(fits * self.font_px), LEAST))
            self.actor.GetSize(self.renderer, size)
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

    def say(self, text: str) -> None:
        """Show a line for so long."""
        self._until = time.perf_counter() + SECONDS
        width, height = self.renderer.GetSize()
        aside = ASIDE * self.font_px
        self.tell([text], 0.02 * width - aside, height - HEAD * self.font_px - aside)

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
    """A bar from 0 to a duration and a lane for each part above it, in front of a picture.

    Parameters
    ----------
    renderer : vtkRenderer
    font_px : int
        Height of the letters [px].

    Attributes
    ----------
    lanes : tuple of str
        Parts, the first one on top.
    """

    def __init__(self, renderer: vtkRenderer, font_px: int) -> None:
        self.renderer, self.font_px = renderer, font_px
        self.lanes: tuple[str, ...] = ()
        self.position, self.span = 0.0, (0.0, math.nan)
        self.zoomed: tuple[float, float] | None = None  # what is seen of it [s]
        self._touches: Spans = ()
        self._drawn: tuple[object, ...] = ()
        self._laid: tuple[object, ...] = ()
        self._told = ""
        self._lanes, self._shapes = Shapes(renderer), Shapes(renderer)
        self.actors = (self._lanes.actor, self._shapes.actor)
        for actor in self.actors:
            actor.SetVisibility(False)
        self._text = Line(renderer, (LEFT, 0.0), round(NOTE * font_px), colour=INK)
        self._ticks = [Line(renderer, (0.0, 0.0), font_px, colour=FAINT) for _ in range(MOST_TICKS)]
        for tick in self._ticks:
            tick.actor.GetTextProperty().SetJustificationToCentered()
        self._text.write("")
        self.scale(font_px)

    def scale(self, font_px: int) -> None:
        """Follow letters of another height [px]."""
        self.font_px = font_px
        self._text.style(round(NOTE * font_px))
        for tick in self._ticks:
            tick.style(small_font(font_px))
        self._drawn = self._laid = ()

    def remove(self) -> None:
        """Take it out of the renderer."""
        for shapes in (self._lanes, self._shapes):
            shapes.remove()
        for line in (self._text, *self._ticks):
            self.renderer.RemoveViewProp(line.actor)

    @property
    def room(self) -> float:
        """What it needs at the foot of the picture, in letters."""
        return ROOM + (self.high + TICKS if self.lanes else 0.0)

    @property
    def high(self) -> float:
        """Height of all lanes, in letters."""
        return min(len(self.lanes) * LANE, HIGHEST)

    @property
    def shown(self) -> bool:
        """Whether there is anything to slide through."""
        low, high = self.span
        return math.isfinite(high) and high > low

    @property
    def view(self) -> tuple[float, float]:
        """From when to when the bar reaches [s]."""
        return self.span if self.zoomed is None else self.zoomed

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

    def over_lanes(self, x: float, y: float) -> bool:
        """Whether a pixel of the window is on the lanes."""
        left, right, middle = self.bar
        low = middle + ABOVE * self.font_px
        return self.shown and left <= x <= right and low <= y <= low + self.high * self.font_px

    def seconds(self, x: float) -> float:
        """The time that a pixel of the window stands for [s], within what is seen."""
        left, right, _ = self.bar
        share = min(max((x - left) / (right - left), 0.0), 1.0)
        low, high = self.view
        return low + share * (high - low) if self.shown else 0.0

    def place(self, seconds: float) -> tuple[float, float]:
        """Pixel of the window where the handle stands at a time [s]."""
        left, right, middle = self.bar
        low, high = self.view
        share = min(max((seconds - low) / (high - low), 0.0), 1.0) if self.shown else 0.0
        return left + share * (right - left), middle

    def zoom(self, x: float, factor: float) -> None:
        """See a shorter or longer time around a pixel of the window."""
        if not self.shown:
            return
        low, high = self.view
        about, length = self.seconds(x), max((high - low) * factor, SHORTEST)
        share = (about - low) / (high - low)
        self._see(about - share * length, length)

    def move(self, pixels: float) -> None:
        """See what comes before or after, by so many pixels of the window."""
        left, right, _ = self.bar
        low, high = self.view
        self._see(low - pixels / (right - left) * (high - low), high - low)

    def _see(self, low: float, length: float) -> None:
        first, last = self.span
        if length >= last - first:
            self.zoomed = None
            return
        low = min(max(low, first), last - length)
        self.zoomed = (low, low + length)

    def point(self, x: float, y: float) -> None:
        """Tell of the touch at a pixel of the window, or of its lane."""
        self._told = ""
        if not self.over_lanes(x, y) or not self.lanes:
            return
        _, _, middle = self.bar
        rise = (y - middle) / self.font_px - ABOVE
        part = self.lanes[
            len(self.lanes) - 1 - min(int(rise / self.high * len(self.lanes)), len(self.lanes) - 1)
        ]
        time = self.seconds(x)
        low, high = self.view
        near = 2.0 * (high - low) / max(self.bar[1] - self.bar[0], 1.0)
        here = [
            one for one in self._touches
            if one[4] in (part, "") and one[0] - near <= time <= one[1] + near
        ]  # fmt: skip
        words = here[-1][3] if here else part.replace("_", " ")
        self._told = f"{clock(time, high - low)}  {words}"

    def show(
        self,
        position: float,
        span: tuple[float, float],
        note: str,
        touches: Spans = (),
        *,
        live: bool = False,
    ) -> None:
        """Draw the bar from one time to another [s], its handle, touches on lanes, a note above.

        Of what is live, the time is told from its newest sample backwards.
        """
        if position != self.position and self.zoomed is not None:
            low, high = self.zoomed
            if not low <= position <= high:  # it is played, or led, out of what is seen
                self._see(position - 0.1 * (high - low), high - low)
        self.position, self.span, self._touches = position, span, touches
        if live:  # the bar moves on with each sample: no picture is drawn for that alone
            self.zoomed = None
            told = "" if note == "" else f"{position - span[1]:.1f} s"
            ends = (float(round(span[0])), float(round(span[1])))
        else:
            told, ends = f"{position:.2f} / {span[1]:.2f} s", span
        laid = (ends, self.zoomed, id(touches), self.renderer.GetSize())
        state = (round(position, 1 if live else 3), note, self._told, *laid)
        if state == self._drawn:
            return
        self._drawn = state
        for actor in self.actors:
            actor.SetVisibility(self.shown)
        rise = (2.6 if self.shown else 1.6) * self.font_px
        rise += (self.high + TICKS) * self.font_px if self.shown and self.lanes else 0.0
        self._text.actor.SetPosition(LEFT, rise / self.renderer.GetSize()[1])
        words = (told if self.shown else "", note, self._told)
        self._text.write("   ".join(text for text in words if text))
        if not self.shown:
            for tick in self._ticks:
                tick.write("")
            return
        if laid != self._laid:
            self._laid = laid
            self._lay(live)
        self._shapes.draw(polygons=self._picture())

    def _lay(self, live: bool) -> None:
        """Draw lanes, touches and ruler: only where they changed."""
        x0, y0 = self.renderer.GetOrigin()
        left, right, middle = self.bar
        left, right, bottom = left - x0, right - x0, middle - y0 + ABOVE * self.font_px
        low, high = self.view
        thick = self.high * self.font_px / max(len(self.lanes), 1)
        ends = left - 0.7 * self.font_px, right + 0.7 * self.font_px
        ground = rectangle(ends[0], 0.0, ends[1] - ends[0], self.room * self.font_px)
        shapes: list[Shape] = [(ground, tint(BACKGROUND))] if self.lanes else []
        for number in range(len(self.lanes)):
            ground = rectangle(left, bottom + number * thick, right - left, max(thick - 1.0, 1.0))
            shapes.append((ground, tint(LANES)))
        wide = max(round(right - left), 1)
        for part, rise, share, columns in lane_columns(
            self._touches, self.lanes, (low, high), wide
        ):
            number = len(self.lanes) - 1 - self.lanes.index(part)
            height = max((thick - 1.0) * share, 1.0)
            for begin, end, colour in columns:
                place = bottom + number * thick + rise * (thick - 1.0)
                shapes.append((rectangle(left + begin, place, end - begin, height), tint(colour)))
        top = bottom + self.high * self.font_px
        most = MOST_TICKS - 1
        step = next((one for one in STEPS if (high - low) / one <= most), STEPS[-1])
        times = np.arange(math.ceil(low / step), math.floor(high / step) + 1) * step
        for k, tick in enumerate(self._ticks):
            if live or k >= len(times) or not self.lanes:
                tick.write("")
                continue
            x = left + (times[k] - low) / (high - low) * (right - left)
            shapes.append((rectangle(x, bottom, 1.0, top - bottom + 2.0), tint(RIM)))
            tick.write(clock(float(times[k]), high - low))
            tick.move(float(x), top + 1.05 * small_font(self.font_px))
        self._lanes.draw(polygons=shapes)

    def _picture(self) -> list[Shape]:
        x0, y0 = self.renderer.GetOrigin()
        left, right, middle = self.bar
        left, right, middle = left - x0, right - x0, middle - y0
        x = self.place(self.position)[0] - x0
        thick = THICK * self.font_px

        def bar(start: float, end: float, colour: str) -> Shape:
            return rectangle(start, middle - 0.5 * thick, end - start, thick), tint(colour)

        shapes = [bar(left, right, RIM), bar(left, x, FAINT)]
        if self.lanes:
            top = (ABOVE + self.high) * self.font_px
            shapes.append((rectangle(x - 0.5, middle, 1.5, top), tint(INK)))
        return [*shapes, (disc(x, middle, HANDLE * self.font_px, CORNERS), tint(INK))]


def lane_columns(
    touches: Spans, lanes: Sequence[str], view: tuple[float, float], wide: int
) -> Iterator[tuple[str, float, float, list[tuple[int, int, str]]]]:
    """What to draw on each lane of so many pixels, however many touches there are.

    Yields
    ------
    (str, float, float, list of (int, int, str))
        Part, foot and height in shares of the lane, and runs of pixels with their colour: touches
        on the whole lane, on its upper half where the recording has marks, which stand below.
    """
    low, high = view
    scale = wide / (high - low)
    tints: dict[str, int] = {}
    rows: dict[tuple[str, bool], NDArray[np.int64]] = {}
    for began, ended, colour, _, part, mark in touches:
        if ended < low or began > high:
            continue
        begin = min(max(int((began - low) * scale), 0), wide - 1)
        end = min(max(int((ended - low) * scale) + 1, begin + 2), wide)
        number = tints.setdefault(colour, len(tints) + 1)
        for lane in [part] if part else lanes:
            if (lane, mark) not in rows:
                rows[lane, mark] = np.zeros(wide, np.int64)
            rows[lane, mark][begin:end] = number
    names, marked = ["", *tints], any(mark for _, mark in rows)
    for (lane, mark), pixels in rows.items():
        if lane in lanes:
            edges = np.flatnonzero(np.diff(pixels, prepend=0, append=0)).tolist()
            runs = [(a, b, names[pixels[a]]) for a, b in pairwise(edges) if pixels[a]]
            yield lane, *((0.0, 0.4) if mark else (0.45, 0.55) if marked else (0.0, 1.0)), runs


def clock(seconds: float, length: float) -> str:
    """A time of a recording, as exact as what is seen is long [s]."""
    if length < 120.0:
        return f"{seconds:.{1 if length < 20.0 else 0}f} s"
    whole = round(seconds)
    hours, minutes = divmod(whole // 60, 60)
    if length < 3600.0 and not hours:
        return f"{minutes}:{whole % 60:02d}"
    return f"{hours}:{minutes:02d}" + (f":{whole % 60:02d}" if length < 3600.0 else "")

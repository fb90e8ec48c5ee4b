"""What is said of the stream: its rate, how late it is shown, and that it has fallen silent."""

from __future__ import annotations

import time

from vtkmodules.vtkRenderingCore import vtkRenderer, vtkTextActor

from skinmap.live.moment import Moment
from viewer.colours import FAINT, WARNING, rgb
from viewer.drawing.panel.touch_list import known
from viewer.drawing.words.text_lines import Line, small_font

TOLD = 0.5  # between two figures of how old the pictures are [s]
UP = 3.4  # of the line below the picture's upper end [font heights]


class Status:
    """A line below the heading, and a warning where nothing comes any more.

    Parameters
    ----------
    renderer : vtkRenderer
    """

    def __init__(self, renderer: vtkRenderer) -> None:
        self.renderer, self.clock = renderer, time.perf_counter
        self._fresh = self.clock()
        self.stale = False
        self._line = Line(renderer, (0.0, 0.0), 12, colour=FAINT)
        self._warning = Line(renderer, (0.0, 0.0), 12, bold=True)
        self._line.back()
        style = self._warning.actor.GetTextProperty()
        style.SetBackgroundColor(*rgb(WARNING))
        style.SetBackgroundOpacity(1.0)
        self._moment = Moment(0.0, {})
        self._worst, self._since, self._told = 0.0, self._fresh, float("nan")
        self._late = ""

    @property
    def silent(self) -> float:
        """How long nothing has come [s]."""
        return self.clock() - self._fresh

    @property
    def actors(self) -> tuple[vtkTextActor, vtkTextActor]:
        """What it draws with."""
        return self._line.actor, self._warning.actor

    @property
    def texts(self) -> tuple[str, ...]:
        """What is written now."""
        return tuple(line.text for line in (self._line, self._warning) if line.text)

    def take(self, moment: Moment) -> None:
        """Remember what a moment says of its stream."""
        self.stale = moment.stale
        if not moment.stale:
            self._fresh = self.clock()
        self._moment = moment

    def shown(self, age: float) -> None:
        """A picture is on the screen whose sample is so old [s]: NaN where nothing is live."""
        if not known(age):
            self._worst, self._told = 0.0, float("nan")
            return
        self._worst = max(self._worst, age)
        now = self.clock()
        # The worst of a while: it says more than the last, and can be read.
        if now - self._since >= TOLD or not known(self._told):
            self._told, self._worst, self._since = self._worst, 0.0, now

    def mark(self, age: float | None) -> None:
        """Say in the next picture that it comes late, its sample so old [s]; None: it does not."""
        self._late = "" if age is None else f" late: shown after {1e3 * age:.0f} ms "

    @property
    def _about(self) -> str:
        """What is said of the stream."""
        moment, words = self._moment, []
        latency = self._told if known(self._told) else moment.latency
        if known(moment.rate):
            words.append(f"{moment.rate:.0f} samples/s")
        if known(latency):
            words.append(f"shown after {1e3 * latency:.0f} ms")
        if moment.dropped:
            words.append(f"{moment.dropped:,} left out")
        return ",  ".join(words)

    def write(self, left: float, font_px: int) -> None:
        """Bring both lines up to date."""
        height = float(self.renderer.GetSize()[1])
        small = small_font(font_px)
        for line, size in ((self._line, small), (self._warning, font_px)):
            line.style(size, bold=line is self._warning)
            line.move(left, height - UP * font_px)
        self._line.write("" if self.stale or self._late else self._about)
        warning = f" no data for {self.silent:.1f} s " if self.stale else self._late
        self._warning.write(warning, "#ffffff")

"""How taxels and contacts went over the last seconds: numbers out of moments, drawn as lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer

from skinmap.arrays import FloatArray, IntArray
from skinmap.live.moment import Moment
from viewer.colours import FAINT, INK, TRACES
from viewer.drawing.words.labels import Box
from viewer.drawing.words.shapes import Shape, Shapes, tint
from viewer.drawing.words.text_lines import Line, small_font

Course = Literal["force", "area", "speed"]
COURSES: tuple[Course, ...] = get_args(Course)
UNITS = {"force": "N", "area": "mm2", "speed": "mm/s"}
SECONDS, SAMPLES = 10.0, 500  # that are plotted: 50 a second
PAST = 0.1  # a speed is taken over so long [s]: centres jump from taxel to taxel
TOP = 255.0  # counts at the upper end of the axis


def traces(moments: Sequence[Moment], part: str, taxels: IntArray) -> tuple[FloatArray, FloatArray]:
    """(t,) times [s] and (t, k) pressures [counts] of some taxels; NaN where none came."""
    silent = np.full(len(taxels), np.nan)
    rows = [m.pressures[part][taxels] if part in m.pressures else silent for m in moments]
    values = np.array(rows, np.float64).reshape(len(moments), len(taxels))
    return np.array([moment.time for moment in moments]), values


def courses(
    moments: Sequence[Moment], course: Course, most: int
) -> tuple[FloatArray, FloatArray, list[str], str]:
    """Times (t,) [s], values (t, k), names of the k contacts felt last, and the unit.

    Where no force is known, the largest pressure stands in its place.
    """
    rows = [{(touch.part, touch.identity): touch for touch in m.touches} for m in moments]
    seen = dict.fromkeys(key for row in reversed(rows) for key in row)
    keys = list(seen)[:most]
    times = np.array([moment.time for moment in moments])
    table = np.full((len(times), len(keys), 6), np.nan)
    for k, row in enumerate(rows):
        for column, key in enumerate(keys):
            if (touch := row.get(key)) is not None:
                force = np.nan if touch.force is None else touch.force
                table[k, column] = force, touch.peak, 1e6 * touch.area, *touch.centre
    names = [part.replace("_", " ") for part, _ in keys]
    if course == "area":
        return times, table[..., 2], names, UNITS["area"]
    if course == "speed":
        return times, speeds(times, table[..., 3:]), names, UNITS["speed"]
    if np.isfinite(table[..., 0]).any():
        return times, table[..., 0], names, UNITS["force"]
    return times, table[..., 1], names, "counts"


def speeds(times: FloatArray, centres: FloatArray) -> FloatArray:
    """(t, k) speeds [mm/s] of centres (t, k, 3) [m] at times (t,) [s]; NaN where none is known."""
    if not len(times):
        return np.zeros(centres.shape[:2])
    before = np.maximum(np.searchsorted(times, times - PAST - 1e-9), 0)
    gap = times - times[before]
    way = np.linalg.norm(centres - centres[before], axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(1e3 * way / np.where(gap > 0, gap, np.nan)[:, None])


class TracePlot:
    """Traces in a box of a renderer's picture: counts over the last seconds."""

    def __init__(self, renderer: vtkRenderer) -> None:
        self.renderer = renderer
        self.box: Box = (0.0, 0.0, 1.0, 1.0)
        self._shapes = Shapes(renderer, 1.6)
        self.actor = self._shapes.actor
        self._ticks = [Line(renderer, (0.0, 0.0), 12, colour=FAINT) for _ in range(4)]
        self._names = [Line(renderer, (0.0, 0.0), 12, bold=True) for _ in range(len(TRACES) + 1)]
        self._font_px = 12

    @property
    def texts(self) -> tuple[str, ...]:
        """What is written now."""
        return tuple(line.text for line in (*self._names, *self._ticks) if line.text)

    def place(self, box: Box, font_px: int) -> None:
        """Fill a box [px], names above the axes and times below them."""
        small = small_font(font_px)
        self._font_px = font_px
        left, bottom, right, top = box
        self.box = (left + 2.3 * font_px, bottom + 1.5 * font_px, right, top - 3.2 * font_px)
        x0, y0, x1, y1 = self.box
        for line in (*self._ticks, *self._names):
            line.style(small, bold=line in self._names)
        places = ((left, y0 + 0.5 * small), (left, y1 + 0.5 * small))
        for line, place in zip(self._ticks, (*places, (x0, y0 - 4), (x1, y0 - 4)), strict=True):
            line.move(*place)
        self._ticks[3].actor.GetTextProperty().SetJustificationToRight()

    def hide(self) -> None:
        """Show nothing."""
        if self.actor.GetVisibility():
            self.actor.VisibilityOff()
            for line in (*self._ticks, *self._names):
                line.write("")

    def show(
        self,
        times: FloatArray,
        values: FloatArray,
        names: Sequence[str],
        title: str,
        *,
        top: float = TOP,
    ) -> None:
        """Draw traces (t, k) over times (t,) [s], the newest at the right, up to a value."""
        self.actor.VisibilityOn()
        for line, text in zip(
            self._ticks, ("0", f"{top:g}", f"-{SECONDS:g} s", "now"), strict=True
        ):
            line.write(text)
        x0, _, _, y1 = self.box
        self._names[0].write(title, INK)
        self._names[0].move(x0 - 2.3 * self._font_px, y1 + 3.2 * self._font_px)
        x = x0 - 2.3 * self._font_px
        for line, name, colour in zip(self._names[1:], names, TRACES, strict=False):
            line.write(name, colour)
            line.move(x, y1 + 1.9 * self._font_px)
            x += line.width() + 0.8 * self._font_px
        for line in self._names[1 + len(names) :]:
            line.write("")
        self._draw(times, values / top)

    def _draw(self, times: FloatArray, shares: FloatArray) -> None:
        x0, y0, x1, y1 = self.box
        paths: list[Shape] = [(np.array([[x0, y1], [x0, y0], [x1, y0]]), tint(FAINT))]
        if len(times):
            x = x1 + (times - times[-1]) / SECONDS * (x1 - x0)
            y = y0 + np.clip(shares, 0.0, 1.0) * (y1 - y0)
            for column, colour in zip(y.T, TRACES, strict=False):
                for run in _runs(np.isfinite(column) & (x >= x0)):
                    paths.append((np.column_stack([x[run], column[run]]), tint(colour)))
        self._shapes.draw(paths)


def round_up(value: float) -> float:
    """A round number, at least so large: 1, 2 or 5 times a power of ten."""
    if not value > 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * 0.999))


def _runs(known: NDArray[np.bool_]) -> list[slice]:
    """Stretches without a gap, of two samples at least."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
    return [slice(a, b) for a, b in zip(edge[::2], edge[1::2], strict=True) if b - a > 1]

"""How taxels and contacts went over the last seconds: numbers out of moments, drawn as lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer

from skinmap.arrays import FloatArray, IntArray
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from viewer.colours import FAINT, INK, TRACES
from viewer.drawing.words.labels import Box
from viewer.drawing.words.shapes import Line, Shape, Shapes, small_font, tint

Course = Literal["force", "pressure", "area", "probability", "speed"]
COURSES: tuple[Course, ...] = get_args(Course)
PLOT_KINDS = ("taxels", *COURSES)
UNITS = {"force": "N", "pressure": "counts", "area": "mm²", "probability": "%", "speed": "mm/s"}
COLUMNS = {"force": 0, "pressure": 1, "area": 2, "probability": 3}  # of what is measured
SECONDS, SAMPLES = 10.0, 500  # that are plotted: 50 a second
SPANS = (1.0, 2.0, 5.0, 10.0, 20.0, 60.0)  # that a plot can have [s]
ACROSS = ("baseline", "threshold")  # levels that are drawn as lines
PAST = 0.1  # a speed is taken over so long [s]: centres jump from taxel to taxel
TOP = 255.0  # counts at the upper end of the axis


def traces(moments: Sequence[Moment], part: str, taxels: IntArray) -> tuple[FloatArray, FloatArray]:
    """(t,) times [s] and (t, k) pressures [counts] of some taxels; NaN where none came."""
    silent = np.full(len(taxels), np.nan)
    rows = [m.pressures[part][taxels] if part in m.pressures else silent for m in moments]
    values = np.array(rows, np.float64).reshape(len(moments), len(taxels))
    return np.array([moment.time for moment in moments]), values


def courses(
    moments: Sequence[Moment],
    course: Course,
    most: int,
    chosen: Mapping[str, IntArray] | None = None,
) -> tuple[FloatArray, FloatArray, list[str], str]:
    """Times (t,), values (t, k), names of the k touches felt last, and the unit.

    Of the touch that `chosen` taxels are part of alone, where there is one. Where no force is
    known, the largest pressure stands in its place.
    """
    rows = [{(touch.part, touch.identity): touch for touch in m.touches} for m in moments]
    seen = {key: touch for row in rows for key, touch in row.items()}
    last = dict.fromkeys(key for row in reversed(rows) for key in row)
    own = [
        key
        for key in last
        if np.isin(seen[key].taxels, (chosen or {}).get(key[0], ())).any()
    ]  # fmt: skip
    keys = own[:1] or list(last)[:most]
    times = np.array([moment.time for moment in moments])
    table = np.full((len(times), len(keys), 7), np.nan)
    for k, row in enumerate(rows):
        for column, key in enumerate(keys):
            if (touch := row.get(key)) is not None:
                values = touch_force(touch), touch.peak, 1e6 * touch.area, 100 * touch.confidence
                table[k, column] = *values, *touch.centre
    several = len({part for part, _ in keys}) > 1
    names = [
        seen[key].label.replace("_", " ") + (f", {key[0].replace('_', ' ')}" if several else "")
        for key in keys
    ]
    if course == "speed":
        return times, speeds(times, table[..., 4:]), names, UNITS["speed"]
    if course != "force" or np.isfinite(table[..., 0]).any():
        return times, table[..., COLUMNS[course]], names, UNITS[course]
    return times, table[..., 1], names, "counts"


def touch_force(touch: NamedTouch) -> float:
    """[N], by the load calibration of its part; NaN without."""
    if touch.load is not None and not touch.load.refused:
        return float(touch.load.force.value)
    return math.nan


@dataclass(frozen=True, eq=False, slots=True)
class Plot:
    """Lines over the seconds up to what is shown, for the window and for pages.

    Attributes
    ----------
    title : str
    times : (t,) float
        Before what is shown [s]: 0 and less.
    values : (t, k) float
        NaN where nothing is known.
    names : list of str
    top : float
        Upper end of the axis; the lower one is 0.
    span : float
        Of the axis of time [s].
    levels : mapping of str to float
        Lines across: baseline and threshold.
    note : str
        What is known beside.
    """

    title: str
    times: FloatArray
    values: FloatArray
    names: list[str]
    top: float
    span: float
    levels: Mapping[str, float] = field(default_factory=dict)
    note: str = ""

    def to_json(self, most: int) -> dict[str, Any]:
        """For a page, of at most so many times."""
        step = max(1, -(-len(self.times) // most))
        # From the newest backwards: what is shown is always there.
        rows = slice(len(self.times) - 1 if len(self.times) else None, None, -step)
        values = self.values[rows][::-1].round(4)
        return {
            "title": self.title,
            "times": self.times[rows][::-1].round(3).tolist(),
            "lines": [
                [None if one != one else one for one in line] for line in values.T.tolist()
            ],
            "names": self.names,
            "top": self.top,
            "span": self.span,
            "levels": dict(self.levels),
            "note": self.note,
        }  # fmt: skip


def plot_touches(
    moments: Sequence[Moment], now: float, span: float, course: Course,
    chosen: Mapping[str, IntArray] | None = None,
) -> Plot:  # fmt: skip
    """How touches went over `span` seconds up to a time [s]."""
    times, values, names, unit = courses(thinned(moments), course, len(TRACES), chosen)
    known = np.isfinite(values).any(axis=0)  # touches that are over may have no probability
    names, values = [names[k] for k in np.flatnonzero(known)], values[:, known]
    largest = float(values[np.isfinite(values)].max(initial=0.0))
    top = 100.0 if course == "probability" else round_up(largest)
    title = "largest pressure" if unit == "counts" else course
    return Plot(f"touches: {title}, {unit}", times - now, values, names, top, span)


def plot_taxels(
    moments: Sequence[Moment], now: float, span: float, part: str, taxels: IntArray,
    channels: IntArray, *, unfit: NDArray[np.bool_], levels: Mapping[str, float],
) -> Plot:  # fmt: skip
    """How hard taxels of a part were pressed over `span` seconds up to a time [s].

    Of many their mean and their largest; `unfit` ones, whose values mean nothing, have no line.
    One taxel alone has its `levels`.
    """
    times, values = traces(thinned(moments), part, taxels)
    values[:, unfit[taxels]] = np.nan
    title = f"{part.replace('_', ' ')}, counts"
    if len(taxels) <= len(TRACES):
        names = [f"{channel}" for channel in channels[taxels].tolist()]
        lines = {name: one for name, one in levels.items() if name in ACROSS}
        note = ", ".join(f"{name} {one:.3g}" for name, one in levels.items())
        title += " by channel"
        return Plot(title, times - now, values, names, TOP, span, lines, note)
    known = np.isfinite(values)
    count = known.sum(axis=1)
    mean = np.where(count, np.where(known, values, 0).sum(axis=1) / np.maximum(count, 1), np.nan)
    most = np.where(count, np.where(known, values, -1).max(axis=1), np.nan)
    both = np.column_stack([mean, most])
    names = ["mean", f"largest of {len(taxels)} taxels"]
    return Plot(title, times - now, both, names, TOP, span)


def thinned(moments: Sequence[Moment]) -> Sequence[Moment]:
    """At most about `SAMPLES` of them, the newest always there."""
    step = max(1, len(moments) // SAMPLES)
    return moments[::-1][::step][::-1]


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
    """A `Plot` in a box of a renderer's picture, what is shown now at the right."""

    def __init__(self, renderer: vtkRenderer) -> None:
        self.renderer = renderer
        self.outer: Box = (0.0, 0.0, 1.0, 1.0)
        self.box: Box = (0.0, 0.0, 1.0, 1.0)
        self.plot: Plot | None = None
        self._cursor: float | None = None  # where values are told, in shares of the box
        self._shapes = Shapes(renderer, 1.6)
        self.actor = self._shapes.actor
        self._ticks = [Line(renderer, (0.0, 0.0), 12, colour=FAINT) for _ in range(4)]
        self._names = [Line(renderer, (0.0, 0.0), 12, bold=True) for _ in range(len(TRACES) + 2)]
        self._font_px = 12

    @property
    def texts(self) -> tuple[str, ...]:
        """What is written now."""
        return tuple(line.text for line in (*self._names, *self._ticks) if line.text)

    def place(self, box: Box, font_px: int) -> None:
        """Fill a box [px], names above the axes and times below them."""
        self._font_px, self.outer = font_px, box
        for line in (*self._ticks, *self._names):
            line.style(small_font(font_px), bold=line in self._names)
        self._ticks[3].actor.GetTextProperty().SetJustificationToRight()

    def hide(self) -> None:
        """Show nothing."""
        self.plot = None
        if self.actor.GetVisibility():
            self.actor.VisibilityOff()
            for line in (*self._ticks, *self._names):
                line.write("")

    def point(self, x: float, y: float) -> bool:
        """Tell the values at a pixel; whether that changes what is drawn."""
        x0, y0, x1, y1 = self.box
        inside = self.plot is not None and x0 <= x <= x1 and y0 <= y <= y1
        cursor = (x - x0) / (x1 - x0) if inside else None
        changed, self._cursor = cursor != self._cursor, cursor
        return changed

    def show(self, plot: Plot) -> None:
        """Draw a plot."""
        self.plot = plot
        self.actor.VisibilityOn()
        left, bottom, right, top = self.outer
        font, small = self._font_px, small_font(self._font_px)
        names, at = plot.names, None
        if self._cursor is not None and len(plot.times):
            wanted = (self._cursor - 1.0) * plot.span
            at = int(np.abs(plot.times - wanted).argmin())
            told = [f"{one:.3g}" if one == one else "-" for one in plot.values[at].tolist()]
            names = [f"{name}: {one}" for name, one in zip(names, told, strict=True)]
        self._names[0].write(plot.title, INK)
        self._names[0].move(left, top)
        x, y = left, top - 1.3 * font
        tints = [*TRACES[: len(names)], FAINT]
        for line, name, colour in zip(self._names[1:], [*names, plot.note], tints, strict=False):
            line.write(name, colour)
            width = line.width()
            if x > left and x + width > right:  # a name is never cut: it begins a line
                x, y = left, y - 1.2 * small
            line.move(x, y)
            x += width + 0.8 * font
        for line in self._names[len(names) + 2 :]:
            line.write("")
        self.box = (left + 2.3 * font, bottom + 1.5 * font, right, y - 1.9 * small)
        x0, y0, x1, y1 = self.box
        seconds = "now" if at is None else f"{plot.times[at]:.2f} s"
        for line, text, place in zip(
            self._ticks,
            ("0", f"{plot.top:g}", f"-{plot.span:g} s", seconds),
            ((left, y0 + 0.5 * small), (left, y1 + 0.5 * small), (x0, y0 - 4), (x1, y0 - 4)),
            strict=True,
        ):
            line.write(text)
            line.move(*place)
        self._draw(plot, at)

    def _draw(self, plot: Plot, at: int | None) -> None:
        x0, y0, x1, y1 = self.box
        paths: list[Shape] = [(np.array([[x0, y1], [x0, y0], [x1, y0]]), tint(FAINT))]

        def height(values: FloatArray) -> FloatArray:
            return np.asarray(y0 + np.clip(values / plot.top, 0.0, 1.0) * (y1 - y0))

        for level in plot.levels.values():
            rise = float(height(np.array(level)))
            paths.append((np.array([[x0, rise], [x1, rise]]), tint(FAINT)))
        x = x1 + plot.times / plot.span * (x1 - x0)
        for column, colour in zip(height(plot.values).T, TRACES, strict=False):
            for run in _runs(np.isfinite(column) & (x >= x0 - 1.0)):
                paths.append((np.column_stack([x[run], column[run]]), tint(colour)))
        if at is not None:
            paths.append((np.array([[x[at], y0], [x[at], y1]]), tint(INK)))
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

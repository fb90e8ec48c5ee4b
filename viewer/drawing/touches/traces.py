"""Pressures of the last seconds: kept in a fixed room, drawn for the selected taxels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkCellArray
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkRenderer

from skinmap.arrays import FloatArray, IntArray
from viewer.colours import FAINT, INK, TRACES, rgb
from viewer.drawing.words.label_places import Box
from viewer.drawing.words.text_lines import Line, small_font

SECONDS = 10.0  # that are kept
SAMPLES = 500  # of each taxel: 50 a second
ROOM = 8_000_000  # values kept at most, 2 bytes each: larger skins are sampled more rarely
TOP = 255.0  # counts at the upper end of the axis


class History:
    """Pressures of all taxels over the last seconds; never grows.

    Parameters
    ----------
    sizes : mapping of str to int
        Taxels of each part.
    seconds : float
        How far it reaches back.
    """

    def __init__(self, sizes: Mapping[str, int], *, seconds: float = SECONDS) -> None:
        count = max(sum(sizes.values()), 1)
        self.samples = int(np.clip(ROOM // count, 2, SAMPLES))
        self.step = seconds / self.samples
        self._times = np.full(self.samples, np.nan)
        # Half floats hold whole counts exactly.
        self._values = {p: np.full((self.samples, n), np.nan, np.float16) for p, n in sizes.items()}
        self._next = 0
        self._last = float("nan")

    def add(self, time: float, pressures: Mapping[str, NDArray[Any]]) -> None:
        """Keep a sample, unless the last one kept is too young."""
        if not np.isfinite(time) or 0.0 <= time - self._last < 0.9 * self.step:
            return
        if time < self._last:  # a recording that was led back: what came later is not true yet
            self._times[:] = np.nan
        row = self._next
        self._next, self._last = (row + 1) % self.samples, time
        self._times[row] = time
        for part, kept in self._values.items():
            values = pressures.get(part)
            kept[row] = np.nan if values is None else values

    def traces(self, part: str, taxels: IntArray) -> tuple[FloatArray, FloatArray]:
        """(t,) times [s] and (t, k) pressures [counts] of some taxels, oldest first."""
        order = np.roll(np.arange(self.samples), -self._next)
        order = order[np.isfinite(self._times[order])]
        return self._times[order], self._values[part][np.ix_(order, taxels)].astype(np.float64)


class TracePlot:
    """Traces in a box of a renderer's picture: counts over the last seconds."""

    def __init__(self, renderer: vtkRenderer) -> None:
        self.renderer = renderer
        self.box: Box = (0.0, 0.0, 1.0, 1.0)
        self._shapes = pv.PolyData()
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._shapes)
        mapper.SetScalarModeToUseCellData()
        self.actor = vtkActor2D()
        self.actor.SetMapper(mapper)
        self.actor.GetProperty().SetLineWidth(1.6)
        self.actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
        renderer.AddViewProp(self.actor)
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
        paths = [np.array([[x0, y1], [x0, y0], [x1, y0]])]
        tints = [rgb(FAINT)]
        if len(times):
            x = x1 + (times - times[-1]) / SECONDS * (x1 - x0)
            y = y0 + np.clip(shares, 0.0, 1.0) * (y1 - y0)
            for column, colour in zip(y.T, TRACES, strict=False):
                for run in _runs(np.isfinite(column) & (x >= x0)):
                    paths.append(np.column_stack([x[run], column[run]]))
                    tints.append(rgb(colour))
        flat = np.concatenate(paths)
        self._shapes.Initialize()
        self._shapes.points = np.column_stack([flat, np.zeros(len(flat))]).astype(np.float32)
        cells, start = vtkCellArray(), 0
        for path in paths:
            cells.InsertNextCell(len(path), range(start, start + len(path)))
            start += len(path)
        self._shapes.SetLines(cells)
        colours = np.rint(np.array(tints) * 255).astype(np.uint8)
        self._shapes.GetCellData().SetScalars(numpy_to_vtk(colours, deep=True))
        self._shapes.Modified()


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

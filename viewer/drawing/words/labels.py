"""Boxed labels in front of the picture, each tied by a line to what it names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkTextActor

from skinmap.arrays import BoolArray, FloatArray
from viewer.colours import ink_on, rgb
from viewer.drawing.words.shapes import Shape, Shapes, disc

Box = tuple[float, float, float, float]  # left, bottom, right, top [px], y upwards

ANGLES = np.radians([0, 180, 30, 150, -30, 210, 60, 120, -60, 240, 90, 270])
REACHES = (0.05, 0.09, 0.13, 0.17, 0.21, 0.26, 0.32)  # from anchor to box, in frame heights
# What a box pays, in [px] of distance to its anchor:
COVERED = 1.2  # frame heights, where it lies wholly on the body
AVOIDED = 2.0  # times that for title and colour bar
SHARED = 4.0  # times that for another box
CROSSED = 1.0  # frame heights, where its line runs wholly under other boxes
THROUGH = 4.0  # and where the line of a hidden touch runs wholly over the body
MOVED = 1.0  # per pixel away from its last place, up to MOST of the frame's height
MOST = 0.2
STEPS = 24  # points of a line that are looked at


CORNER = np.radians(np.linspace(0, 90, 5))
WHITE = np.full(3, 255.0)


class Coverage:
    """How much of any box is covered by points of a picture, on a coarse grid.

    Parameters
    ----------
    points : (n, 2) float
        Where something is drawn [px].
    size : (int, int)
        Width and height of the picture [px].
    cell : int
        Side of the grid's cells [px]: a cell with a point in it counts as covered.
    """

    def __init__(self, points: FloatArray, size: tuple[int, int], cell: int = 12) -> None:
        self.cell, self.size = cell, size
        columns, rows = (-(-side // cell) for side in size)
        place = np.floor(points / cell).astype(np.int64)
        inside = ((place >= 0) & (place < [columns, rows])).all(axis=1)
        taken = np.zeros((columns + 1, rows + 1))
        taken[place[inside, 0] + 1, place[inside, 1] + 1] = 1.0
        self._sums = taken.cumsum(axis=0).cumsum(axis=1)
        self._taken = taken[1:, 1:] > 0.0
        self._free: FloatArray | None = None

    def outline(
        self, point: tuple[float, float], covers: Callable[[FloatArray], bool] | None = None
    ) -> tuple[float, float]:
        """Where the outline of what is drawn lies nearest to a point of it [px].

        Cells between the points of a surface are not free: those beside a covered one count as
        covered. `covers` knows of a place (2,) whether something is drawn there, to the pixel.
        """
        if self._free is None:
            padded = np.pad(self._taken, 1)  # scipy.ndimage takes 0.1 s to import
            wide = padded[:-2] | padded[1:-1] | padded[2:]
            open_cells = np.argwhere(~(wide[:, :-2] | wide[:, 1:-1] | wide[:, 2:]))
            self._free = np.asarray((open_cells + 0.5) * self.cell, np.float64)
        free = self._free
        if len(free) == 0:
            return point
        best = free[np.argmin(((free - point) ** 2).sum(axis=1))]
        way = best + np.linspace(0.0, 1.0, STEPS)[:, None] * (np.array(point) - best)
        if covers is None:
            first = int(np.argmax(self.on(way)))
            return float(way[first, 0]), float(way[first, 1])
        first = next((k for k in range(STEPS) if covers(way[k])), STEPS - 1)
        out, into = way[max(first - 1, 0)], way[first]
        while np.linalg.norm(into - out) > 1.0:
            middle = (out + into) / 2
            out, into = (out, middle) if covers(middle) else (middle, into)
        return float(into[0]), float(into[1])

    def on(self, points: FloatArray) -> BoolArray:
        """(...) whether something is drawn at points (..., 2) [px]."""
        limit = np.array(self._taken.shape) - 1
        column, row = np.moveaxis(np.clip((points / self.cell).astype(int), 0, limit), -1, 0)
        return np.asarray(self._taken[column, row])

    def under(self, boxes: FloatArray) -> FloatArray:
        """(n,) covered area under boxes (n, 4) [px2]."""
        limit = np.array(self._sums.shape) - 1
        low = np.clip(np.floor(boxes[:, :2] / self.cell).astype(np.int64), 0, limit)
        high = np.clip(np.ceil(boxes[:, 2:] / self.cell).astype(np.int64), 0, limit)
        (x0, y0), (x1, y1), sums = low.T, high.T, self._sums
        cells = sums[x1, y1] - sums[x0, y1] - sums[x1, y0] + sums[x0, y0]
        return np.asarray(cells * self.cell**2)


def overlaps(boxes: FloatArray, others: FloatArray) -> FloatArray:
    """(n,) area that each of boxes (n, 4) shares with all of others (m, 4) together [px2]."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    return np.asarray(np.clip(high - low, 0.0, None).prod(axis=2).sum(axis=1))


def place_boxes(
    anchors: FloatArray,
    sizes: FloatArray,
    frame: Box,
    avoid: Sequence[Box] = (),
    before: Sequence[Box | None] = (),
    busy: Coverage | None = None,
    hidden: Sequence[bool] = (),
) -> list[Box]:
    """A box for each anchor, one after the other, where it costs least.

    Parameters
    ----------
    anchors : (n, 2) float
        What the boxes belong to [px].
    sizes : (n, 2) float
        Width and height of each box [px].
    frame : Box
        Boxes stay inside.
    avoid : sequence of Box
        What is better not covered: the title, the colour bar.
    before : sequence of Box or None
        Where each box was in the last picture: it stays there while that is good enough.
    busy : Coverage, optional
        What the picture shows under the boxes: boxes go where there is little of it.
    hidden : sequence of bool
        Whose lines must not cross what the picture shows.
    """
    height = frame[3] - frame[1]
    avoided = np.array(avoid).reshape(-1, 4)
    placed = np.zeros((0, 4))
    for i, (anchor, size) in enumerate(zip(anchors, sizes, strict=True)):
        boxes = candidates(anchor, size, frame)
        middle = (boxes[:, :2] + boxes[:, 2:]) / 2
        area = SHARED * overlaps(boxes, placed) + AVOIDED * overlaps(boxes, avoided)
        if busy is not None:
            area += busy.under(boxes)
        cost = COVERED * height * area / size.prod() + np.linalg.norm(middle - anchor, axis=1)
        lines = leaders(anchor, boxes)
        cost += CROSSED * height * inside(lines, placed)
        if busy is not None and i < len(hidden) and hidden[i]:
            cost += THROUGH * height * busy.on(lines).mean(axis=1)
        last = before[i] if i < len(before) else None
        if last is not None:
            was = np.array([last[0] + last[2], last[1] + last[3]]) / 2
            moved = np.linalg.norm(middle - was, axis=1)
            cost += MOVED * np.minimum(moved, MOST * height)
        placed = np.vstack([placed, boxes[np.argmin(cost)]])
    return [(left, bottom, right, top) for left, bottom, right, top in placed.tolist()]


def leaders(anchor: FloatArray, boxes: FloatArray) -> FloatArray:
    """(n, k, 2) points of the lines from an anchor to the nearest place of boxes (n, 4) [px]."""
    ends = np.clip(anchor, boxes[:, :2], boxes[:, 2:])
    share = np.linspace(0.0, 1.0, STEPS)[:, None]
    return np.asarray(anchor + share * (ends[:, None] - anchor))


def inside(lines: FloatArray, boxes: FloatArray) -> FloatArray:
    """(n,) share of the points of lines (n, k, 2) that lie in any of boxes (m, 4)."""
    at = lines[:, :, None]
    within = np.logical_and(at >= boxes[:, :2], at <= boxes[:, 2:]).all(axis=3)
    return np.asarray(np.any(within, axis=2).mean(axis=1))


def candidates(anchor: FloatArray, size: FloatArray, frame: Box) -> FloatArray:
    """(c, 4) boxes around an anchor, each pushed into the frame [px]."""
    way = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
    side = np.sign(np.round(way, 6)) * size / 2
    reach = np.array(REACHES)[:, None, None] * (frame[3] - frame[1])
    middle = (anchor + way * reach + side).reshape(-1, 2)
    low = np.array(frame[:2]) + size / 2
    high = np.maximum(np.array(frame[2:]) - size / 2, low)
    middle = np.clip(middle, low, high)
    return np.hstack([middle - size / 2, middle + size / 2])


@dataclass(frozen=True, slots=True)
class Label:
    """A text in a box of one colour, tied to a place in the picture.

    Attributes
    ----------
    key : str
        What it stays tied to while its text changes.
    text, colour : str
    anchor : (float, float)
        [px], y upwards.
    hidden : bool
        Whether something stands before what it names.
    inward : (float, float) or None
        From the anchor, on the outline of what stands there, to what it names [px]: half a ring is
        drawn that points there.
    """

    key: str
    text: str
    colour: str
    anchor: tuple[float, float]
    hidden: bool = False
    inward: tuple[float, float] | None = None


class LabelLayer:
    """All boxed labels of one renderer: one actor for boxes and lines, one per text, reused.

    Parameters
    ----------
    renderer : vtkRenderer
        Where they appear, in front of everything.
    font_px : int
        Height of the letters [px].
    """

    def __init__(self, renderer: vtkRenderer, font_px: int) -> None:
        self.renderer = renderer
        self.font_px = font_px
        self.boxes: list[Box] = []
        self.floor = 0.0  # below which no box stands [px]
        self._labels: tuple[Label, ...] = ()
        self._texts: list[vtkTextActor] = []
        self._wanted: tuple[object, ...] = ()
        self._shapes = Shapes(renderer, 2.0)

    @property
    def texts(self) -> tuple[str, ...]:
        """What is written now."""
        return tuple(text.GetInput() for text in self._texts if text.GetVisibility())

    def set_font(self, font_px: int) -> None:
        """Letters of another height [px]."""
        self.font_px = font_px
        for text in self._texts:
            text.GetTextProperty().SetFontSize(font_px)

    def show(
        self,
        labels: Sequence[Label],
        avoid: Sequence[Box] = (),
        busy: Coverage | None = None,
    ) -> None:
        """Replace the labels; those whose text stayed keep their place where they can."""
        width, height = self.renderer.GetSize()
        wanted = (tuple(labels), tuple(avoid), busy, (width, height), self.font_px, self.floor)
        if wanted == self._wanted:  # rebuilt, they would be drawn anew in each picture
            return
        self._wanted = wanted
        edge = 0.012 * height
        frame = (edge, max(edge, self.floor), width - edge, height - edge)
        sizes = np.array([self._write(i, label) for i, label in enumerate(labels)]).reshape(-1, 2)
        for text in self._texts[len(labels) :]:
            text.VisibilityOff()
        anchors = np.array([label.anchor for label in labels]).reshape(-1, 2)
        known = {label.key: box for label, box in zip(self._labels, self.boxes, strict=True)}
        before = [known.get(label.key) for label in labels]
        hidden = [label.hidden for label in labels]
        self.boxes = place_boxes(anchors, sizes, frame, avoid, before, busy, hidden)
        self._labels = tuple(labels)
        left, bottom = self.renderer.GetOrigin()
        for text, box in zip(self._texts, self.boxes, strict=False):
            text.SetDisplayPosition(
                round(left + (box[0] + box[2]) / 2), round(bottom + (box[1] + box[3]) / 2)
            )
        self._draw(labels)

    def forget(self) -> None:
        """Place all labels anew at the next call: the picture is another one."""
        self._labels, self.boxes, self._wanted = (), [], ()

    def _write(self, number: int, label: Label) -> tuple[float, float]:
        """Set a text and measure its box [px]."""
        if number == len(self._texts):
            self._texts.append(self._new_text())
        text = self._texts[number]
        text.SetInput(label.text)
        text.GetTextProperty().SetColor(*rgb(ink_on(label.colour)))
        text.VisibilityOn()
        size = [0.0, 0.0]
        text.GetSize(self.renderer, size)
        return size[0] + 1.0 * self.font_px, 1.75 * self.font_px

    def _new_text(self) -> vtkTextActor:
        text = vtkTextActor()
        style = text.GetTextProperty()
        style.SetFontSize(self.font_px)
        style.BoldOn()
        style.SetJustificationToCentered()
        style.SetVerticalJustificationToCentered()
        self.renderer.AddViewProp(text)
        return text

    def _draw(self, labels: Sequence[Label]) -> None:
        """Rebuild boxes, lines and anchors as one small mesh in picture coordinates."""
        lines: list[Shape] = []
        shapes: list[Shape] = []
        corner = 0.42 * self.font_px
        for label, box in zip(labels, self.boxes, strict=True):
            colour, anchor = rgb(label.colour) * 255, np.array(label.anchor)
            lines.append((np.array([anchor, np.clip(anchor, box[:2], box[2:])]), colour))
            for radius, tint in ((0.27, WHITE), (0.20, colour), (0.11, WHITE)):
                if label.inward is not None:
                    half = 1.6 * radius * self.font_px
                    shapes.append((half_disc(anchor, half, np.array(label.inward)), tint))
                elif label.hidden or radius > 0.11:
                    shapes.append((disc(*label.anchor, radius * self.font_px), tint))
            grown = (box[0] - 1.5, box[1] - 1.5, box[2] + 1.5, box[3] + 1.5)
            shapes.append((_rounded(grown, corner + 1.5), WHITE))
            shapes.append((_rounded(box, corner), colour))
        self._shapes.draw(lines, shapes)


def half_disc(centre: FloatArray, radius: float, way: FloatArray) -> FloatArray:
    """Outline (k, 2) of the half of a disc that lies in a direction (2,) [px]."""
    angle = np.arctan2(way[1], way[0]) + np.linspace(-np.pi / 2, np.pi / 2, 12)
    return np.asarray(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def _rounded(box: Box, radius: float) -> FloatArray:
    """Outline (20, 2) of a box with round corners [px]."""
    left, bottom, right, top = box
    corners = [(right, top, 0), (left, top, 1), (left, bottom, 2), (right, bottom, 3)]
    arcs = []
    for x, y, quarter in corners:
        inward = np.array([-1 if x == right else 1, -1 if y == top else 1]) * radius
        angle = CORNER + quarter * np.pi / 2
        arc = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
        arcs.append(np.array([x, y]) + inward + arc)
    return np.concatenate(arcs)

"""Boxed labels in front of the picture, each tied by a line to what it names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyvista as pv
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkCellArray
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkRenderer, vtkTextActor

from skinmap.arrays import FloatArray
from viewer.colours import ink_on, rgb
from viewer.drawing.words.label_places import Box, Coverage, place_boxes

CORNER = np.radians(np.linspace(0, 90, 5))
WHITE = np.full(3, 255.0)


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
        Whether something stands before what it names: its anchor, beside it, is drawn hollow.
    """

    key: str
    text: str
    colour: str
    anchor: tuple[float, float]
    hidden: bool = False


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
        self._labels: tuple[Label, ...] = ()
        self._texts: list[vtkTextActor] = []
        self._wanted: tuple[object, ...] = ()
        self._shapes = pv.PolyData()
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._shapes)
        mapper.SetScalarModeToUseCellData()
        self._actor = vtkActor2D()
        self._actor.SetMapper(mapper)
        self._actor.GetProperty().SetLineWidth(2.0)
        self._actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
        renderer.AddViewProp(self._actor)

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
        wanted = (tuple(labels), tuple(avoid), busy, (width, height), self.font_px)
        if wanted == self._wanted:  # rebuilt, they would be drawn anew in each picture
            return
        self._wanted = wanted
        edge = 0.012 * height
        frame = (edge, edge, width - edge, height - edge)
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
        lines: list[tuple[FloatArray, FloatArray]] = []
        shapes: list[tuple[FloatArray, FloatArray]] = []
        corner = 0.42 * self.font_px
        for label, box in zip(labels, self.boxes, strict=True):
            colour, anchor = rgb(label.colour) * 255, np.array(label.anchor)
            lines.append((np.array([anchor, _nearest(box, anchor)]), colour))
            shapes.append((_disc(anchor, 0.27 * self.font_px), WHITE))
            shapes.append((_disc(anchor, 0.20 * self.font_px), colour))
            if label.hidden:
                shapes.append((_disc(anchor, 0.11 * self.font_px), WHITE))
            shapes.append((_rounded(_grown(box, 1.5), corner + 1.5), WHITE))
            shapes.append((_rounded(box, corner), colour))
        self._shapes.Initialize()
        if not labels:
            return
        outlines = [points for points, _ in lines + shapes]
        flat = np.concatenate(outlines)
        self._shapes.points = np.column_stack([flat, np.zeros(len(flat))])
        self._shapes.SetLines(_cells(outlines[: len(lines)], 0))
        self._shapes.SetPolys(_cells(outlines[len(lines) :], 2 * len(lines)))
        tints = np.array([colour for _, colour in lines + shapes]).astype(np.uint8)
        self._shapes.GetCellData().SetScalars(numpy_to_vtk(tints, deep=True))
        self._shapes.Modified()


def _cells(outlines: Sequence[FloatArray], start: int) -> vtkCellArray:
    """One cell for each outline, its points counted from `start`."""
    cells = vtkCellArray()
    for points in outlines:
        cells.InsertNextCell(len(points))
        for k in range(start, start + len(points)):
            cells.InsertCellPoint(k)
        start += len(points)
    return cells


def _nearest(box: Box, point: FloatArray) -> FloatArray:
    return np.clip(point, box[:2], box[2:])


def _grown(box: Box, by: float) -> Box:
    return box[0] - by, box[1] - by, box[2] + by, box[3] + by


def _disc(centre: FloatArray, radius: float) -> FloatArray:
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    return centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


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

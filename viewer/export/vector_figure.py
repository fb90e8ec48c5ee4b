"""The scene as a figure for a paper: lines, letters and the flat map are vectors.

All that VTK draws in two dimensions, and all that lies flat in the panel, is read back from its
actors, so that a figure shows what the window shows. Of the body a picture is taken; outlines of
touches on it are vectors too, where nothing stands before them.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkFloatArray, vtkUnsignedCharArray
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkActor2D, vtkTextActor

from skinmap.arrays import FloatArray
from skinmap.io.output import staged_file
from skinmap.report.vectors import (
    NOTHING,
    Drawing,
    Pieces,
    Raster,
    Shape,
    Words,
    drawing_svg,
    drawings_pdf,
)
from viewer.colours import hexed
from viewer.drawing.frame.camera import project, projection

if TYPE_CHECKING:
    from viewer.scene import Scene

SUFFIXES = (".svg", ".pdf")
WIDTH = 180.0  # of a figure over two columns [mm]
SAMPLES = 8  # per pixel of the body's picture
NEARER = 4e-3  # a line this far behind what is drawn there still lies on it [m]
HAIR = 0.03  # around triangles of one colour, or white shines between them [mm]
DESCENT = 0.21  # of letters below their base line, in their size
WHITE = (1.0, 1.0, 1.0)


def write_figure(scene: Scene, path: Path) -> Path:
    """Write what the scene shows as SVG or PDF, 180 mm wide.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    drawing = figure_of(scene)
    if path.suffix.lower() == ".svg":
        data = drawing_svg(drawing).encode()
    else:
        data = drawings_pdf([drawing])
    with staged_file(path) as stage:
        stage.write_bytes(data)
    return path


def figure_of(scene: Scene) -> Drawing:
    """What the scene shows, without heading and status."""
    canvas = scene.canvas
    shapes: list[Shape] = []
    canvas.draw(scene, 360.0, samples=SAMPLES)
    width, height = canvas.plotter.window_size
    unit = WIDTH / width  # millimetres of a pixel
    with _left_out(canvas.heading.actor, *canvas.status.actors):
        picture, depth = _body(scene)
        left, bottom = canvas.renderer.GetOrigin()
        w, h = canvas.renderer.GetSize()
        page = _Page(unit, float(height))
        shapes.append(
            Raster(left * unit, (height - bottom - h) * unit, w * unit, h * unit, _png(picture))
        )
        shapes += _outlines(scene, page, depth)
        for renderer in canvas.plotter.renderers:
            if renderer is not canvas.renderer:
                shapes += _flat(renderer, page)
            for prop in renderer.GetViewProps():
                if prop.GetVisibility():
                    shapes += _front(renderer, prop, page)
    return Drawing(WIDTH, height * unit, shapes)


class _Page:
    """Pixels of the window, y upwards, as millimetres of the page, y downwards."""

    def __init__(self, unit: float, height: float) -> None:
        self.unit, self.height = unit, height

    def __call__(self, points: FloatArray, origin: tuple[int, int] = (0, 0)) -> FloatArray:
        x, y = points[..., 0] + origin[0], points[..., 1] + origin[1]
        return self.unit * np.stack([x, self.height - y], axis=-1)


@contextmanager
def _left_out(*props: Any) -> Iterator[None]:
    """Some props hidden for a while."""
    hidden = [prop for prop in props if prop.GetVisibility()]
    for prop in hidden:
        prop.VisibilityOff()
    try:
        yield
    finally:
        for prop in hidden:
            prop.VisibilityOn()


def _body(scene: Scene) -> tuple[NDArray[np.uint8], FloatArray]:
    """Picture (h, w, 3) of the body on white without lines and letters, and its depth (h, w)."""
    canvas = scene.canvas
    renderer: Any = canvas.renderer
    window: Any = canvas.plotter.render_window
    flat = [prop for prop in renderer.GetViewProps() if isinstance(prop, vtkActor2D)]
    ground = renderer.GetBackground()
    left, bottom = renderer.GetOrigin()
    w, h = renderer.GetSize()
    box = (left, bottom, left + w - 1, bottom + h - 1)
    with _left_out(*flat, *canvas.touch_view.marks.outlines.actors):
        renderer.SetBackground(*WHITE)
        try:
            canvas.cache.draw_all()
            deep = vtkFloatArray()
            window.GetZbufferData(*box, deep)
            window.SetMultiSamples(SAMPLES)
            canvas.cache.draw_all()
            pixels = vtkUnsignedCharArray()
            window.GetPixelData(*box, 0, pixels, 0)
        finally:
            window.SetMultiSamples(0)
            renderer.SetBackground(*ground)
    picture = vtk_to_numpy(pixels).reshape(h, w, 3)[::-1]
    return np.ascontiguousarray(picture), vtk_to_numpy(deep).reshape(h, w)


def _png(picture: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return buffer.getvalue()


def _outlines(scene: Scene, page: _Page, depth: FloatArray) -> Iterator[Shape]:
    """Outlines of touches on the body, where nothing stands before them."""
    canvas = scene.canvas
    actors, renderer = canvas.touch_view.marks.outlines.actors, canvas.renderer
    points, lines, tints = _segments(canvas.touch_view.marks.outlines.lines)
    if not len(lines):
        return
    middle = points[lines].mean(axis=1)
    eye = np.array(renderer.GetActiveCamera().GetPosition())
    way = eye - middle
    middle += NEARER * way / np.linalg.norm(way, axis=1, keepdims=True)
    at = project(renderer, middle)
    h, w = depth.shape
    column, row = (np.clip(at[:, k].astype(int), 0, size - 1) for k, size in ((0, w), (1, h)))
    z, distance = projection(renderer, 0.0)[2:] @ np.column_stack([middle, np.ones(len(middle))]).T
    seen = z / distance <= depth[row, column]  # as the z-buffer has them
    placed = page(project(renderer, points), renderer.GetOrigin())[lines]
    for actor, halo in zip(actors, (True, False), strict=True):
        width = actor.prop.line_width * page.unit
        yield from _by_colour(placed[seen], tints[seen], width, white=halo, layer="outlines")


def _segments(mesh: Any) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.uint8]]:
    """Points (n, 3), ends of lines (k, 2) and their colours (k, 3)."""
    if not mesh.n_cells:
        return np.zeros((0, 3)), np.zeros((0, 2), np.int64), np.zeros((0, 3), np.uint8)
    ends = vtk_to_numpy(mesh.GetLines().GetConnectivityArray()).reshape(-1, 2)
    tints = vtk_to_numpy(mesh.GetCellData().GetScalars())[:, :3]
    return np.asarray(mesh.points, np.float64), ends, tints


def _by_colour(
    pieces: FloatArray, tints: NDArray[np.uint8], width: float, *, white: bool, layer: str
) -> Iterator[Shape]:
    """Lines (k, 2, 2) or polygons, neighbours of one colour together; `width` 0 fills them."""
    if not len(pieces):
        return
    tints = np.full_like(tints, 255) if white else tints
    turns = np.flatnonzero((tints[1:] != tints[:-1]).any(axis=1)) + 1
    for own, shade in zip(np.split(pieces, turns), np.split(tints, turns), strict=True):
        name = hexed((shade[0] / 255.0).tolist())
        if width:
            yield Pieces(own, name, NOTHING, width, layer)
        else:
            yield Pieces(own, name, name, HAIR, layer)


def _flat(renderer: Any, page: _Page) -> Iterator[Shape]:
    """All that lies flat in the panel, the lowest first."""
    actors = [
        prop
        for prop in renderer.GetViewProps()
        if isinstance(prop, vtkActor) and prop.GetVisibility() and prop.GetMapper().GetInput()
    ]
    for actor in sorted(actors, key=lambda one: one.GetBounds()[5]):
        mesh = actor.GetMapper().GetInput()
        if not mesh.GetNumberOfCells():
            continue
        points = vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64)
        placed = page(project(renderer, points), renderer.GetOrigin())
        width = actor.GetProperty().GetLineWidth() * page.unit
        yield from _cells(actor, mesh, placed, width, "map")


def _cells(prop: Any, mesh: Any, placed: FloatArray, width: float, layer: str) -> Iterator[Shape]:
    """Lines and polygons of a mesh in their colours, at places (n, 2) [mm]."""
    plain = np.rint(255 * np.array(prop.GetProperty().GetColor())).astype(np.uint8)
    tints, lying, first = *_tints(prop.GetMapper(), mesh), 0
    for cells, filled in ((mesh.GetLines(), False), (mesh.GetPolys(), True)):
        count = cells.GetNumberOfCells()
        offsets = vtk_to_numpy(cells.GetOffsetsArray()) if count else np.zeros(1, np.int64)
        ends = vtk_to_numpy(cells.GetConnectivityArray()) if count else offsets
        sizes = np.diff(offsets)
        for size in np.unique(sizes):
            rows = np.flatnonzero(sizes == size)
            corners = ends[offsets[rows][:, None] + np.arange(size)]
            if tints is None:
                own = np.tile(plain, (len(rows), 1))
            elif lying:
                own = tints[first + rows]
            else:
                own = tints[corners].mean(axis=1).round().astype(np.uint8)
                order = np.lexsort(own.T)  # beside each other, none covers another
                corners, own = corners[order], own[order]
            thick = 0.0 if filled else max(width, HAIR)
            yield from _by_colour(placed[corners], own, thick, white=False, layer=layer)
        first += count


def _tints(mapper: Any, mesh: Any) -> tuple[NDArray[np.uint8] | None, bool]:
    """Colours (k, 3) of the points or cells of a mesh, and whether of cells; None for one only."""
    if not mapper.GetScalarVisibility():
        return None, False
    cells = mesh.GetCellData().GetScalars()
    values = mesh.GetPointData().GetScalars() if cells is None else cells
    if values is None:
        return None, False
    if not isinstance(values, vtkUnsignedCharArray):
        values = mapper.GetLookupTable().MapScalars(values, 0, -1)
    return vtk_to_numpy(values)[:, :3], cells is not None


def _front(renderer: Any, prop: Any, page: _Page) -> Iterator[Shape]:
    """A text or a flat shape in front of a renderer's picture."""
    if isinstance(prop, vtkTextActor):
        if prop.GetInput():
            yield from _text(renderer, prop, page)
    elif isinstance(prop, vtkActor2D) and prop.GetMapper() is not None:
        mapper: Any = prop.GetMapper()
        mesh = mapper.GetInput()  # an image (of the pressed part) has no cells in colours
        if isinstance(mesh, vtkPolyData) and mesh.GetNumberOfCells():
            points = vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64)
            placed = page(points[:, :2], renderer.GetOrigin())
            width = prop.GetProperty().GetLineWidth() * page.unit
            yield from _cells(prop, mesh, placed, width, "front")


def _text(renderer: Any, prop: Any, page: _Page) -> Iterator[Shape]:
    """Words, with their ground where they have one."""
    style, box = prop.GetTextProperty(), [0.0] * 4
    prop.GetBoundingBox(renderer, box)
    place = prop.GetActualPositionCoordinate().GetComputedDisplayValue(renderer)
    corners = np.array([[box[0], box[2]], [box[1], box[2]], [box[1], box[3]], [box[0], box[3]]])
    if style.GetBackgroundOpacity() > 0.0:  # what shines through in the window is white on paper
        ground = page(corners[None], place)
        solid = style.GetBackgroundOpacity() == 1.0
        fill = hexed(style.GetBackgroundColor() if solid else WHITE)
        yield Pieces(ground, fill, fill, HAIR, layer="front")
    text = prop.GetInput()
    size = float(style.GetFontSize())
    base = 0.5 * (box[2] + box[3]) - (0.5 - DESCENT) * size * 0.95
    x, y = page(np.array([box[0], base]), place)
    shown = text.strip()
    blank = (len(text) - len(text.lstrip())) * 0.28 * size * page.unit
    width = (box[1] - box[0]) * page.unit - 0.28 * size * page.unit * (len(text) - len(shown))
    yield Words(
        float(x) + blank, float(y), shown, size * page.unit, layer="words",
        colour=hexed(style.GetColor()), bold=bool(style.GetBold()), width=max(width, 0.1),
    )  # fmt: skip

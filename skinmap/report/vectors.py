"""Drawings of lines, circles, words and pictures in millimetres, as SVG and as PDF.

SVG is written here, as nothing else keeps a viewBox in millimetres; PDF by matplotlib, which
embeds the font that the words are set in.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray

FONT = "Arial, Helvetica, DejaVu Sans, sans-serif"
INCH = 25.4  # [mm]
POINTS = 72.0 / INCH  # in a millimetre
ANCHORS = {"start": "left", "middle": "center", "end": "right"}
NOTHING = "none"


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """A line or a filled polygon.

    Attributes
    ----------
    points : (k, 2) array of float
        From the upper left corner [mm].
    colour, fill : str
        As SVG writes them; "none" for nothing.
    width : float
        Of the line [mm].
    closed : bool
        Whether the last point is joined to the first.
    layer : str
        Name of what this is.
    """

    points: FloatArray
    colour: str = "#000000"
    fill: str = NOTHING
    width: float = 0.2
    closed: bool = False
    layer: str = "lines"


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Many polygons or lines (k, corners, 2) of one colour [mm]; `fill` none draws lines."""

    points: FloatArray
    colour: str = NOTHING
    fill: str = NOTHING
    width: float = 0.0
    layer: str = "pieces"


@dataclass(frozen=True, slots=True)
class Mark:
    """A circle; lengths [mm]."""

    x: float
    y: float
    radius: float
    colour: str = "#000000"
    fill: str = NOTHING
    width: float = 0.15
    layer: str = "marks"


@dataclass(frozen=True, slots=True)
class Words:
    """A line of text: the place on its base line and the size of its letters [mm].

    `width`, where given, is how wide it is drawn [mm], whatever the font.
    """

    x: float
    y: float
    text: str
    size: float
    anchor: str = "start"
    colour: str = "#000000"
    layer: str = "words"
    bold: bool = False
    width: float | None = None


@dataclass(frozen=True, slots=True)
class Raster:
    """A PNG in a rectangle [mm]."""

    x: float
    y: float
    width: float
    height: float
    png: bytes
    layer: str = "pictures"


Shape = Stroke | Pieces | Mark | Words | Raster


@dataclass(frozen=True, slots=True)
class Drawing:
    """Shapes on a page, the first at the back.

    Attributes
    ----------
    width, height : float
        Of the page [mm].
    shapes : sequence of Shape
    """

    width: float
    height: float
    shapes: Sequence[Shape]


def drawing_svg(drawing: Drawing) -> str:
    """A drawing as SVG: a unit of its viewBox is a millimetre."""
    size = f"{_short(drawing.width)} {_short(drawing.height)}"
    width, height = size.split()
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {size}" font-family="{FONT}">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        *map(_element, drawing.shapes),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _element(shape: Shape) -> str:
    """A shape as an element of SVG."""
    layer = f'class="{escape(shape.layer)}"'
    if isinstance(shape, Raster):
        data = base64.b64encode(shape.png).decode()
        return (
            f'<image {layer} x="{_short(shape.x)}" y="{_short(shape.y)}" '
            f'width="{_short(shape.width)}" height="{_short(shape.height)}" '
            f'preserveAspectRatio="none" href="data:image/png;base64,{data}"/>'
        )
    if isinstance(shape, Words):
        more = ' font-weight="bold"' if shape.bold else ""
        more += ' xml:space="preserve"' if "  " in shape.text else ""
        if shape.width is not None:
            more += f' textLength="{_short(shape.width)}" lengthAdjust="spacingAndGlyphs"'
        return (
            f'<text {layer} x="{_short(shape.x)}" y="{_short(shape.y)}" '
            f'font-size="{_short(shape.size)}" text-anchor="{shape.anchor}"{more} '
            f'fill="{shape.colour}">{escape(_printable(shape.text))}</text>'
        )
    paint = f'fill="{shape.fill}" stroke="{shape.colour}" stroke-width="{_short(shape.width)}"'
    if isinstance(shape, Mark):
        place = f'cx="{_short(shape.x)}" cy="{_short(shape.y)}" r="{_short(shape.radius)}"'
        return f"<circle {layer} {place} {paint}/>"
    if isinstance(shape, Pieces):
        end = "" if shape.fill == NOTHING else "z"
        path = "".join(
            "M" + "L".join(f"{_short(x)} {_short(y)}" for x, y in piece) + end
            for piece in shape.points.tolist()
        )
        return f'<path {layer} d="{path}" {paint} stroke-linejoin="round"/>'
    points = " ".join(f"{_short(x)},{_short(y)}" for x, y in shape.points)
    name = "polygon" if shape.closed else "polyline"
    return f'<{name} {layer} points="{points}" {paint} stroke-linejoin="round"/>'


def _printable(text: str) -> str:
    """Without the signs that XML has no way to write."""
    return "".join(one for one in text if one.isprintable())


def _short(number: float) -> str:
    """To a tenth of a micrometre."""
    return f"{number:.4f}".rstrip("0").rstrip(".")


def drawings_pdf(drawings: Sequence[Drawing]) -> bytes:
    """Drawings as the pages of a PDF, words as words in an embedded font."""
    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    buffer = io.BytesIO()
    plain: Any = {"pdf.fonttype": 42, "font.family": ["DejaVu Sans"], "text.parse_math": False}
    with mpl.rc_context(plain), PdfPages(buffer, metadata={"CreationDate": None}) as pages:
        for drawing in drawings:
            figure = Figure(figsize=(drawing.width / INCH, drawing.height / INCH))
            axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
            axis.axis("off")
            for order, shape in enumerate(drawing.shapes):
                _draw(axis, shape, order)
            axis.set(xlim=(0.0, drawing.width), ylim=(drawing.height, 0.0), aspect="auto")
            pages.savefig(figure)
    return buffer.getvalue()


def _draw(on: Any, shape: Shape, order: int) -> None:
    """A shape on an axis of matplotlib whose unit is a millimetre."""
    from matplotlib.patches import Circle, Polygon

    if isinstance(shape, Raster):
        from matplotlib.image import imread

        x, y, right, low = shape.x, shape.y, shape.x + shape.width, shape.y + shape.height
        picture = imread(io.BytesIO(shape.png), format="png")
        on.imshow(picture, extent=(x, right, low, y), interpolation="none", zorder=order)
        return
    if isinstance(shape, Words):
        weight = "bold" if shape.bold else "normal"
        on.text(
            shape.x, shape.y, _printable(shape.text), fontsize=_fitting(shape), fontweight=weight,
            ha=ANCHORS[shape.anchor], va="baseline", color=shape.colour, zorder=order,
        )  # fmt: skip
        return
    paint = {
        "facecolor": shape.fill, "edgecolor": shape.colour, "linewidth": shape.width * POINTS,
        "joinstyle": "round", "zorder": order,
    }  # fmt: skip
    if isinstance(shape, Pieces):
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        pieces, (count, corners) = shape.points, shape.points.shape[:2]
        codes = np.full((count, corners + 1), Path.LINETO)
        codes[:, 0], codes[:, -1] = Path.MOVETO, Path.CLOSEPOLY
        closed = np.concatenate([pieces, pieces[:, :1]], axis=1)
        if shape.fill == NOTHING:
            closed, codes = pieces, codes[:, :-1]
        on.add_patch(PathPatch(Path(closed.reshape(-1, 2), codes.ravel()), **paint))
    elif isinstance(shape, Mark):
        on.add_patch(Circle((shape.x, shape.y), shape.radius, **paint))
    else:
        on.add_patch(Polygon(np.asarray(shape.points), closed=shape.closed, **paint))


def _fitting(shape: Words) -> float:
    """Size of letters [pt] at which a text is as wide as it should be."""
    size = shape.size * POINTS
    if shape.width is None or not shape.text.strip():
        return size
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    font = FontProperties(weight="bold" if shape.bold else "normal")
    drawn = TextPath((0.0, 0.0), shape.text, size=size, prop=font).get_extents().width
    return size * min(1.0, shape.width * POINTS / drawn) if drawn > 0.0 else size

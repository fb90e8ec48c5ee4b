"""The flat map of a skin at its true size, on sheets to print, cut and wire by.

Drawings as DXF of release 2000 in millimetres, which programs for CAD and cutters open.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from itertools import count
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from shapely import MultiLineString, MultiPoint, box, line_merge
from shapely.geometry.base import BaseGeometry

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.flat.flat_map import Chart, FlatMap
from skinmap.report.page import MM
from skinmap.report.vectors import Drawing, Mark, Shape, Stroke, Words
from skinmap.summary import first_few

CENTRED = {"start": 0, "middle": 1, "end": 2}
FREE = 0x100  # the first handle that the tables and blocks of sheet.dxf do not use


def drawing_dxf(drawing: Drawing) -> str:
    """Outlines as LWPOLYLINE, marks as CIRCLE and words as TEXT; y points up."""
    templates = resources.files("skinmap.report").joinpath("sheet.dxf").read_text("ascii")
    around, layer, *entities = templates.split("---\n")
    names = dict.fromkeys(["0", *(shape.layer for shape in drawing.shapes)])
    handles = (f"{number:X}" for number in count(FREE))
    layers = "".join(layer.format(handle=next(handles), layer=_ascii(name)) for name in names)
    shapes = (
        _entity(shape, entities, drawing.height, handle=next(handles), layer=_ascii(shape.layer))
        for shape in drawing.shapes
    )
    return around.format(
        width=drawing.width, height=drawing.height, count=len(names), layers=layers,
        entities="".join(shapes),
    )  # fmt: skip


def _entity(shape: Shape, templates: Sequence[str], height: float, **common: str) -> str:
    """A shape as an entity; pictures and pieces have none."""
    line, corner, circle, text = templates
    if isinstance(shape, Stroke):
        corners = "".join(corner.format(x=x, y=height - y) for x, y in shape.points.tolist())
        number, closed = len(shape.points), int(shape.closed)
        return line.format(count=number, closed=closed, corners=corners, **common)
    if isinstance(shape, Mark):
        return circle.format(x=shape.x, y=height - shape.y, radius=shape.radius, **common)
    if isinstance(shape, Words):
        words, anchor = _ascii(shape.text), CENTRED[shape.anchor]
        x, y, size = shape.x, height - shape.y, 0.7 * shape.size
        return text.format(x=x, y=y, size=size, text=words, anchor=anchor, **common)
    return ""


def _ascii(words: str) -> str:
    """Other letters than ASCII as release 2000 writes them, line ends not at all."""
    text = "".join(one for one in words if one.isprintable())
    return "".join(one if one.isascii() else f"\\U+{ord(one):04X}" for one in text)


PAPER = (210.0, 297.0)  # A4 [mm]
MARGIN = 10.0  # that printers leave white at most [mm]
HEAD, FOOT = 9.0, 14.0  # room for the title and the scale bar [mm]
GAP = 6.0  # between charts [mm]
BAR = 100.0  # length of the scale bar [mm]
MOST_PAGES = 400
STRETCHED = 0.05  # error of a length between neighbours from which a sheet states the errors
LONE = 4.0  # as pitch of a taxel that has no neighbour [mm]


@dataclass(frozen=True, slots=True, eq=False)
class Cutout:
    """A chart as it is drawn: places of taxels and outlines from its lower left corner [mm]."""

    names: Sequence[str]  # channels, of taxels at one place with commas between
    places: FloatArray
    outlines: Sequence[FloatArray]
    size: tuple[float, float]
    pitch: float


def sheets(name: str, maps: Mapping[str, FlatMap]) -> list[Drawing]:
    """Pages of A4 with every taxel of every part once, at its true size.

    Parameters
    ----------
    name : str
        Of the robot, for the title.
    maps : mapping of str to FlatMap
        By part. Charts that fit share a page, larger ones go over several.

    Returns
    -------
    list of Drawing
        Taxels as circles with their channels, outlines of modules, a scale bar.

    Raises
    ------
    InvalidArrayError
        More than 400 pages.
    """
    width, height = PAPER[0] - 2 * MARGIN, PAPER[1] - 2 * MARGIN - HEAD - FOOT
    pages: list[tuple[str, list[Shape]]] = []
    for part, flat in maps.items():
        cutouts = [_upright(_cutout(flat, chart), width, height) for chart in flat.charts]
        tiles = sum(_tiles(one.size, width, height) for one in cutouts)
        if len(pages) + tiles > MOST_PAGES:
            raise InvalidArrayError(
                f"a sheet of {part!r} takes {tiles:,} pages of A4, more than {MOST_PAGES}: "
                "is its unit metres?"
            )
        lost = flat.mesh.skin.channels[~np.isfinite(flat.uv[:, 0])]
        title = f"{name}, {part}" if part != name else name
        if len(lost):
            title += f" (without a place: {first_few(lost.tolist())})"
        errors = list(_errors(flat))
        pages += [(title, errors + shapes) for shapes in _part_pages(cutouts, width, height)]
    return [
        Drawing(*PAPER, [*_frame(title, number, len(pages)), *shapes])
        for number, (title, shapes) in enumerate(pages, 1)
    ]


def _errors(flat: FlatMap) -> Iterator[Words]:
    """A line below the title of a map that lengths cannot be taken from."""
    off = np.abs(np.concatenate([chart.distortion.edge_strain for chart in flat.charts]))
    if off.max() > STRETCHED:
        middle, worst = 100.0 * np.median(off), 100.0 * off.max()
        words = f"lengths between neighbours: {middle:.1f} % off (median), {worst:.0f} % at worst"
        yield Words(MARGIN, MARGIN + 7.6, words, 2.6, layer="title")


def _cutout(flat: FlatMap, chart: Chart) -> Cutout:
    """What is drawn of a chart."""
    uv = MM * np.asarray(chart.uv)
    own = np.flatnonzero((MM * flat.uv[chart.taxels] == uv).all(axis=1))
    own = own[np.unique(chart.taxels[own], return_index=True)[1]]  # a taxel on a seam once
    channels, stands_for = flat.mesh.skin.channels, flat.mesh.representative
    pitch = _pitch(uv[own])
    outlines = [_outline(uv[rows], 0.45 * pitch) for rows in _boards(flat, chart, own)]
    low = np.min([line.min(axis=0) for line in outlines], axis=0)
    high = np.max([line.max(axis=0) for line in outlines], axis=0)
    return Cutout(
        names=[
            ", ".join(map(str, channels[stands_for == taxel].tolist()))
            for taxel in chart.taxels[own]
        ],
        places=uv[own] - low,
        outlines=[line - low for line in outlines],
        size=(float(high[0] - low[0]), float(high[1] - low[1])),
        pitch=pitch,
    )


def _boards(flat: FlatMap, chart: Chart, own: IntArray) -> Iterator[IntArray]:
    """Vertices of a chart by module, in pieces where a seam divides one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    module = np.asarray(flat.mesh.skin.modules)[chart.taxels]
    a, b = chart.faces.ravel(), np.roll(chart.faces, 1, axis=1).ravel()
    inside = module[a] == module[b]
    links = coo_array((np.ones(inside.sum()), (a[inside], b[inside])), shape=(len(module),) * 2)
    piece = connected_components(links, directed=False)[1]
    for number in np.unique(piece[own]):
        yield own[piece[own] == number]


def _outline(places: FloatArray, reach: float) -> FloatArray:
    """The hull of taxels (k, 2) with a rim around it."""
    hull = MultiPoint(places).convex_hull.buffer(reach, quad_segs=6)
    return np.asarray(hull.exterior.coords)[:-1]


def _pitch(places: FloatArray) -> float:
    """Median distance of the nearest neighbour at another place [mm]."""
    apart = np.unique(places.round(3), axis=0)
    if len(apart) < 2:
        return LONE
    return float(np.median(cKDTree(apart).query(apart, k=2)[0][:, 1]))


def _tiles(size: tuple[float, float], width: float, height: float) -> int:
    return math.ceil(size[0] / width) * math.ceil(size[1] / height)


def _upright(one: Cutout, width: float, height: float) -> Cutout:
    """The chart, turned by 90 degrees where it takes fewer pages so."""
    w, h = one.size
    if _tiles((h, w), width, height) >= _tiles((w, h), width, height):
        return one

    def turned(points: FloatArray) -> FloatArray:
        return np.column_stack([h - points[:, 1], points[:, 0]])

    outlines = [turned(line) for line in one.outlines]
    return Cutout(one.names, turned(one.places), outlines, (h, w), one.pitch)


def _part_pages(cutouts: Sequence[Cutout], width: float, height: float) -> Iterator[list[Shape]]:
    """Charts side by side while they fit, else a page for each tile of one."""
    shapes: list[Shape] = []
    left, top, row = 0.0, 0.0, 0.0  # of the next chart, and the height of its row
    for one in cutouts:
        w, h = one.size
        if w > width or h > height:
            if shapes:
                yield shapes
            yield from _tile_pages(one, width, height)
            shapes, left, top, row = [], 0.0, 0.0, 0.0
            continue
        if left + w > width:
            left, top, row = 0.0, top + row + GAP, 0.0
        if top + h > height:
            yield shapes
            shapes, left, top, row = [], 0.0, 0.0, 0.0
        shapes += _drawn(one, (left, h + top), box(0.0, 0.0, w, h))
        left, row = left + w + GAP, max(row, h)
    if shapes:
        yield shapes


def _tile_pages(one: Cutout, width: float, height: float) -> Iterator[list[Shape]]:
    across, down = (math.ceil(one.size[k] / (width, height)[k]) for k in (0, 1))
    for row in range(down):
        for column in range(across):
            x, y = column * width, one.size[1] - (row + 1) * height
            tile = box(x, y, x + width, y + height)
            place = f"column {column + 1} of {across}, row {row + 1} of {down}"
            shapes = _drawn(one, (-x, y + height), tile)
            if not shapes:
                continue
            corners = _on_page(np.asarray(tile.exterior.coords)[:-1], (-x, y + height))
            cut = Stroke(corners, colour="#999999", width=0.1, closed=True, layer="cut")
            words = f"{place}; cut along the grey frame"
            yield [cut, *shapes, Words(MARGIN, PAPER[1] - MARGIN - 9.5, words, 2.6)]


def _on_page(points: FloatArray, shift: tuple[float, float]) -> FloatArray:
    """Places of a chart, whose y points up, on the page, whose y points down."""
    x, y = shift
    return np.column_stack([MARGIN + x + points[:, 0], MARGIN + HEAD + y - points[:, 1]])


def _drawn(one: Cutout, shift: tuple[float, float], tile: BaseGeometry) -> list[Shape]:
    """What lies in a tile of a chart: on the edge between two, in the left or lower one."""
    x0, y0, x1, y1 = tile.bounds
    shapes: list[Shape] = [
        Stroke(_on_page(points, shift), "#666666", closed=closed, layer="modules")
        for line in one.outlines
        for points, closed in _clipped(line, tile)
    ]
    x, y = one.places.T
    inside = np.flatnonzero((x > x0) & (x <= x1) & (y > y0) & (y <= y1))
    radius = min(max(0.12 * one.pitch, 0.25), 1.0)
    size = min(max(0.3 * one.pitch, 0.7), 2.6)
    at = _on_page(one.places[inside], shift)
    for taxel, (u, v) in zip(inside.tolist(), at.tolist(), strict=True):
        shapes.append(Mark(u, v, radius, layer="taxels"))
        below = v + radius + 0.85 * size
        shapes.append(Words(u, below, one.names[taxel], size, "middle", layer="channels"))
    return shapes


def _clipped(line: FloatArray, tile: BaseGeometry) -> Iterator[tuple[FloatArray, bool]]:
    """An outline inside a tile: whole, or the pieces that are left of it."""
    ring = np.vstack([line, line[:1]])
    x0, y0, x1, y1 = tile.buffer(1e-6).bounds
    if (line >= (x0, y0)).all() and (line <= (x1, y1)).all():
        yield line, True
        return
    rest = MultiLineString([ring]).intersection(tile)
    merged = line_merge(rest) if rest.geom_type == "MultiLineString" else rest
    for piece in getattr(merged, "geoms", [merged]):
        if piece.geom_type == "LineString" and not piece.is_empty:
            yield np.asarray(piece.coords), False


def _frame(title: str, number: int, count: int) -> Iterator[Shape]:
    """Title and scale bar of a page."""
    words = f"{title}, 1 : 1" + (f", page {number} of {count}" if count > 1 else "")
    yield Words(MARGIN, MARGIN + 4.0, words, 3.5, layer="title")
    y = PAPER[1] - MARGIN - 3.0
    comb = [(MARGIN, y - 4.0), (MARGIN, y)]
    for step in range(1, 10):
        x = MARGIN + step * BAR / 10.0
        comb += [(x, y), (x, y - (3.0 if step == 5 else 2.0)), (x, y)]
    comb += [(MARGIN + BAR, y), (MARGIN + BAR, y - 4.0)]
    yield Stroke(np.array(comb), width=0.25, layer="scale")
    yield Words(MARGIN + BAR + 2.0, y, "100 mm: check your printer", 2.6, layer="scale")


def write_sheets(
    path: Path, drawings: Sequence[Drawing], check: Callable[[Path], None]
) -> list[Path]:
    """Write pages as one PDF, or as an SVG or DXF for each (sheet-1.svg, ...).

    Parameters
    ----------
    path : Path
        Its suffix is the format: .pdf, .svg or .dxf.
    drawings : sequence of Drawing
    check : callable
        Called with each file before any is written; raises for one that must stay.

    Returns
    -------
    list of Path
        What was written.
    """
    from skinmap.io.output import staged_folder
    from skinmap.report.vectors import drawing_svg, drawings_pdf

    suffix, many = path.suffix.lower(), len(drawings) > 1
    if suffix == ".pdf":
        content = {path: drawings_pdf(drawings)}
    else:
        written = drawing_svg if suffix == ".svg" else drawing_dxf
        numbers = range(1, len(drawings) + 1)
        files = [path.with_name(f"{path.stem}-{k}{path.suffix}") for k in numbers]
        texts = [written(drawing).encode() for drawing in drawings]
        content = dict(zip(files if many else [path], texts, strict=False))
    for file in content:
        check(file)
    with staged_folder(path.parent) as stage:
        for file, data in content.items():
            (stage / file.name).write_bytes(data)
    return list(content)

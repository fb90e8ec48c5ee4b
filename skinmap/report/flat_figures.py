"""Pictures of flat maps: map and patch on the body side by side, and maps compared.

A checkerboard on the map is carried to the body: its squares there show the distortion. Surfaces
are drawn without OpenGL, by a parallel projection from back to front.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.flat.atlas import limb_frame
from skinmap.flat.costs import METRICS, DrawnChart, FaceMetric, seam_edges
from skinmap.flat.flat_map import Chart, FlatMap
from skinmap.geometry.triangles import face_areas, face_normals
from skinmap.report.page import picture_bytes, plain_figure
from skinmap.surface.surface_mesh import SurfaceMesh

LIGHT = np.array([-0.35, 0.55, 0.76])  # over the left shoulder: right, up, towards the viewer
AMBIENT = 0.55  # share of the light that comes from everywhere
SEEN = 0.3  # cosine: flatter triangles are seen as slivers, another view has to show them
ENOUGH = 0.92  # share of the area that the views of one picture show together
MAX_VIEWS = 3


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """Where one looks from.

    Attributes
    ----------
    name : str
    out : (3,) float
        Unit, from the surface towards the viewer.
    up : (3,) float
        Unit, square to it.
    """

    name: str
    out: FloatArray
    up: FloatArray

    def project(self, points: FloatArray) -> FloatArray:
        """(..., 3) right, up and towards the viewer, of points (..., 3)."""
        return np.asarray(points @ np.stack([np.cross(self.up, self.out), self.up, self.out]).T)


def choose_views(vertices: FloatArray, faces: IntArray, frame: FloatArray) -> list[View]:
    """As few views as show nearly all of a surface, the one with most first.

    Parameters
    ----------
    vertices : (n, 3) array of float
    faces : (m, 3) array of int
    frame : (3, 3) array of float
        Rows: up, the way that the surface looks, and the third direction.
    """
    up, front, side = frame
    turns = np.radians(np.arange(0, 360, 45))
    candidates = [
        View(_turned(turn), np.cos(turn) * front + np.sin(turn) * side, up) for turn in turns
    ]
    candidates += [View("from above", up, -front), View("from below", -up, front)]
    normals, area = face_normals(vertices, faces), face_areas(vertices, faces)
    shown = np.zeros(len(faces), bool)
    views: list[View] = []
    while len(views) < MAX_VIEWS and area[shown].sum() < ENOUGH * area.sum():
        facing = [np.where(shown, 0.0, np.maximum(normals @ view.out, 0.0)) for view in candidates]
        gains = np.array([area @ cosine for cosine in facing]) / area.sum()
        best = candidates.pop(int(np.argmax(np.round(gains, 6))))
        shown |= normals @ best.out > SEEN
        views.append(best)
    return views


def mesh_views(mesh: SurfaceMesh) -> list[View]:
    """The views that show a part, seen as its limb stands."""
    frame = limb_frame(mesh.vertices, mesh.faces, mesh.skin.up)
    return choose_views(mesh.vertices, mesh.faces, frame)


def _turned(turn: float) -> str:
    return "front" if turn == 0 else f"turned by {np.degrees(turn):.0f}\N{DEGREE SIGN}"


def draw_surface(
    axis: Any,
    view: View,
    polygons: Sequence[FloatArray] | FloatArray,
    normals: FloatArray,
    colours: FloatArray,
) -> None:
    """Draw flat polygons, those behind first, darker where they look aside.

    Parameters
    ----------
    axis : matplotlib axes
    view : View
    polygons : sequence of (k, 3) array of float
    normals : (m, 3) array of float
        Unit; polygons that look away are left out.
    colours : (m, 4) array of float
    """
    seen = np.flatnonzero(normals @ view.out > 0.0)
    chosen = [polygons[k] for k in seen.tolist()]
    sizes = np.array([len(polygon) for polygon in chosen], np.int64)
    ends = np.cumsum(sizes)
    places = view.project(np.concatenate([np.zeros((0, 3)), *chosen]))
    depth = np.bincount(np.repeat(np.arange(len(chosen)), sizes), places[:, 2]) / sizes
    order = np.argsort(depth, kind="stable")
    paint = shaded(colours[seen], view.project(normals[seen]))
    ordered = [places[ends[k] - sizes[k] : ends[k], :2] for k in order]
    _add_polygons(axis, ordered, facecolors=paint[order], edgecolors="face", linewidths=0.2)


def _add_polygons(axis: Any, polygons: Sequence[FloatArray] | FloatArray, **style: Any) -> None:
    from matplotlib.collections import PolyCollection

    axis.add_collection(PolyCollection(list(polygons), **style))


def shaded(colours: FloatArray, normals: FloatArray) -> FloatArray:
    """Colours (m, 4) under Lambert's law for normals (m, 3) as the viewer sees them."""
    light = np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    dark = np.array(colours)
    dark[:, :3] *= (AMBIENT + (1.0 - AMBIENT) * light)[:, None]
    return dark


def visible(view: View, vertices: FloatArray, faces: IntArray, count: int) -> BoolArray:
    """(count,) whether each vertex belongs to a face that looks towards the viewer."""
    seen = np.zeros(count, bool)
    seen[faces[face_normals(vertices, faces) @ view.out > 0.0].ravel()] = True
    return seen


SEAM = "#d3202f"
EDGED = 6_000  # triangles: finer ones are drawn without their edges
MAX_DRAWN = 120_000  # faces: of larger meshes each pixel would hold many, some are left out
HEIGHT = 3.9  # inches of a row of panels
DRAWN_LIMIT = 20.0  # per cent: end of the colour scale of drawings, several times ours
STRETCHED = 98.0  # percentile that the colour scale reaches
FAINTEST = 0.02  # of the usual range: what is less is rounding, and stays in one colour
BOARD = np.array([[0.93, 0.94, 0.95, 1.0], [0.30, 0.44, 0.62, 1.0]])  # squares: light, dark
SQUARES = 14  # across a map, about
MAX_CUT = 8_000  # triangles: finer ones take the colour under their middle


def part_figure(flat: FlatMap, metric: FaceMetric = METRICS["edge_strain"]) -> Any:
    """Flat map and body side by side: coloured by a metric above, a checkerboard below."""
    if len(flat.mesh.faces) == 0:
        return _disc_figure(flat.mesh, flat.uv, title(flat))
    views = mesh_views(flat.mesh)
    unit, factor = length_unit(flat)
    figure = plain_figure((HEIGHT * (1.35 + 0.9 * len(views)), 2 * HEIGHT + 1.0))
    axes = figure.subplots(
        2, 1 + len(views), squeeze=False, width_ratios=[1.35] + [0.9] * len(views)
    )
    values = np.concatenate([metric.of(chart) for chart in flat.charts])
    paint = _scale(metric, values)
    colours = paint.to_rgba(np.nan_to_num(values, posinf=1e300))
    keep = kept_faces(len(values))
    corners = np.concatenate([chart.uv[chart.faces] for chart in flat.charts])
    body = np.concatenate([flat.mesh.vertices[c.taxels[c.faces]] for c in flat.charts])
    side = square_side(corners.reshape(-1, 2) * factor)
    corners, body, colours = corners[keep] * factor, body[keep] * factor, colours[keep]
    normals = face_normals(body.reshape(-1, 3), np.arange(body[..., 0].size).reshape(-1, 3))
    pieces, source, shade = checkerboard(corners, body, side)
    draw_flat(axes[0, 0], corners, colours, edged=len(corners) < EDGED)
    draw_flat(axes[1, 0], [piece[:, :2] for piece in pieces], BOARD[shade], edged=False)
    for axis in axes[:, 0]:
        _draw_flat_seams(axis, flat.charts, factor)
        _frame_flat(axis, unit)
    for place, view in enumerate(views):
        draw_surface(axes[0, 1 + place], view, body, normals, colours)
        bent = [piece[:, 2:] for piece in pieces]
        draw_surface(axes[1, 1 + place], view, bent, normals[source], BOARD[shade])
        axes[0, 1 + place].set_title(f"on the body, {view.name}", fontsize=9, y=1.0)
        for axis in axes[:, 1 + place]:
            _draw_body_seams(axis, flat, view, factor)
            _frame_body(axis)
    axes[0, 0].set_title("flat map", fontsize=9, y=1.0)
    axes[1, 0].set_title(f"squares of {side:g} {unit} on the map", fontsize=9, y=1.0)
    # Beside both rows, so that it takes as much room of each: columns stay below one another.
    bar = figure.colorbar(paint, ax=axes, shrink=0.42, anchor=(0.0, 0.93), extend="both", pad=0.01)
    bar.set_label(metric.label)
    seams = any(len(seam_edges(chart)) for chart in flat.charts if not chart.periodic)
    rolls = any(chart.periodic for chart in flat.charts)
    words = ", seams red" if seams else ""
    words += ", dashed: where it repeats itself" if rolls else ""
    figure.suptitle(title(flat) + words, fontsize=11)
    return figure


def mesh_figure(mesh: SurfaceMesh) -> Any:
    """A surface mesh from one or two sides."""
    if len(mesh.faces) == 0:
        places = np.linalg.norm(mesh.vertices - mesh.vertices[0], axis=1)
        words = f"{mesh.skin.part}: {len(mesh.skin)} taxels, no triangle"
        return _disc_figure(mesh, np.column_stack([places, 0.0 * places]), words)
    views = mesh_views(mesh)
    figure = plain_figure((HEIGHT * len(views), HEIGHT + 0.5))
    body = mesh.vertices[mesh.faces[kept_faces(len(mesh.faces))]]
    normals = face_normals(body.reshape(-1, 3), np.arange(body[..., 0].size).reshape(-1, 3))
    colours = np.tile(BOARD[0], (len(body), 1))
    for axis, view in zip(figure.subplots(1, len(views), squeeze=False)[0], views, strict=True):
        draw_surface(axis, view, body, normals, colours)
        if len(body) < EDGED:  # a flat skin is one shade: edges and taxels show the mesh
            seen = visible(view, mesh.vertices, mesh.faces, len(mesh.vertices))
            inner = body[normals @ view.out > 0.0]
            style = {"facecolors": "none", "edgecolors": "#8a929b", "linewidths": 0.3}
            _add_polygons(axis, view.project(inner)[..., :2], **style)
            x, y = view.project(mesh.vertices[seen])[:, :2].T
            axis.plot(x, y, ".", color=BOARD[1], markersize=2.5)
        _frame_body(axis)
        axis.set_title(view.name, fontsize=9, y=1.0)
    figure.suptitle(f"{mesh.skin.part}: {len(mesh.skin):,} taxels, {len(mesh.faces):,} triangles",
                    fontsize=11)  # fmt: skip
    return figure


def _disc_figure(mesh: SurfaceMesh, places: FloatArray, words: str) -> Any:
    """One or two taxels, which have no surface: each a disc [mm]."""
    from matplotlib.patches import Circle

    figure = plain_figure((HEIGHT, HEIGHT))
    axis = figure.subplots()
    for place in 1e3 * places:
        axis.add_patch(Circle(tuple(place), 500.0 * mesh.skin.spacing, color=BOARD[1]))
    _frame_flat(axis, "mm")
    figure.suptitle(words, fontsize=9)
    return figure


def comparison_figure(
    maps: Sequence[tuple[str, FlatMap]],
    drawn: Mapping[str, Sequence[DrawnChart]],
    metric: FaceMetric,
) -> bytes:
    """PNG: maps of one part by several methods in one colour scale, drawings laid over the first.

    Triangles that the drawing turns over are black.
    """
    first_map = maps[0][1]
    if len(first_map.mesh.faces) == 0:
        return picture_bytes(_disc_figure(first_map.mesh, first_map.uv, title(first_map)))
    unit, factor = length_unit(first_map)
    panels = len(maps) + len(drawn)
    extent = np.ptp(np.concatenate([chart.uv for chart in maps[0][1].charts]), axis=0)
    tall = float(np.clip(3.1 * extent[1] / max(extent[0], 1e-300), 1.2, 3.6))
    figure = plain_figure((1.0 + 3.7 * panels, 1.3 + tall))
    axes = figure.subplots(1, panels, squeeze=False)[0]
    first = np.concatenate([metric.of(chart) for chart in maps[0][1].charts])
    paint = _scale(metric, first)
    for axis, (name, flat) in zip(axes, maps, strict=False):
        values = np.concatenate([metric.of(chart) for chart in flat.charts])
        keep = kept_faces(len(values))
        corners = np.concatenate([chart.uv[chart.faces] for chart in flat.charts]) * factor
        colours = paint.to_rgba(np.nan_to_num(values, posinf=1e300))
        draw_flat(axis, corners[keep], colours[keep], edged=keep.sum() < EDGED)
        _draw_flat_seams(axis, flat.charts, factor)
        _frame_flat(axis, unit)
        rms = max(100.0 * chart.distortion.edge_rms for chart in flat.charts)
        axis.set_title(f"{name}: {flat.flips} flips, edge rms {rms:.2f} %", fontsize=9, y=1.0)
    for axis, (name, charts) in zip(axes[len(maps) :], drawn.items(), strict=True):
        _draw_drawing(axis, name, charts, factor)
        _frame_flat(axis, f"{unit}; here yellow is {DRAWN_LIMIT:g} % of edge strain")
    bar = figure.colorbar(paint, ax=axes, shrink=0.8, extend="both", pad=0.01)
    bar.set_label(metric.label)
    figure.suptitle(f"{maps[0][1].mesh.skin.part}: the same charts compared", fontsize=11)
    return picture_bytes(figure)


def title(flat: FlatMap) -> str:
    """One line on a part: vertices as the table counts them, patches, method, flips, edge error."""
    count = len(flat.charts)
    rms = [f"{100.0 * chart.distortion.edge_rms:.2f}" for chart in flat.charts[:6]]
    more = ", ..." if count > 6 else ""
    corners = sum(len(chart.taxels) for chart in flat.charts)
    return (
        f"{flat.mesh.skin.part}: {corners} vertices, "
        f"{count} {'patch' if count == 1 else 'patches'}, {flat.charts[0].method}, "
        f"{flat.flips} flips, edge rms {', '.join(rms)}{more} %"
    )


def length_unit(flat: FlatMap) -> tuple[str, float]:
    """A unit in which a part has readable lengths, and how many of it are a metre."""
    size = float(np.ptp(flat.mesh.vertices, axis=0).max())
    for unit, factor in (("mm", 1e3), ("m", 1.0), ("km", 1e-3)):
        if 1.0 <= size * factor < 2e3:
            return unit, factor
    power = int(np.floor(np.log10(size)))
    return f"1e{power} m", 10.0**-power


def kept_faces(count: int) -> BoolArray:
    """(count,) which faces are drawn: all of them up to `MAX_DRAWN`, then evenly some."""
    keep = np.zeros(count, bool)
    keep[:: -(-count // MAX_DRAWN)] = True
    return keep


def draw_flat(
    axis: Any, polygons: Sequence[FloatArray] | FloatArray, colours: FloatArray, *, edged: bool
) -> None:
    """Draw m polygons (k, 2) in colours (m, 4)."""
    edge = "white" if edged else "face"
    _add_polygons(axis, polygons, facecolors=colours, edgecolors=edge, linewidths=0.25)


def _draw_flat_seams(axis: Any, charts: Sequence[Chart], factor: float) -> None:
    from matplotlib.collections import LineCollection

    for chart in charts:
        lines = chart.uv[seam_edges(chart)] * factor
        axis.add_collection(LineCollection(list(lines), **_seam_style(chart)))


def _seam_style(chart: Chart) -> dict[str, Any]:
    if chart.periodic:
        return {"colors": "black", "linewidths": 1.2, "linestyles": "dashed"}
    return {"colors": SEAM, "linewidths": 1.4}


def _draw_body_seams(axis: Any, flat: FlatMap, view: View, factor: float) -> None:
    from matplotlib.collections import LineCollection

    seen = visible(view, flat.mesh.vertices, flat.mesh.faces, len(flat.mesh.vertices))
    for chart in flat.charts:
        ends = chart.taxels[seam_edges(chart)]
        ends = ends[seen[ends].any(axis=1)]
        lines = view.project(flat.mesh.vertices[ends])[:, :, :2] * factor
        axis.add_collection(LineCollection(list(lines), **_seam_style(chart)))


def _draw_drawing(axis: Any, name: str, drawn: Sequence[DrawnChart], factor: float) -> None:
    from matplotlib import colormaps

    strain, flips, taxels = [], 0, 0
    for chart in drawn:
        if chart.distortion is None:
            continue
        error = 100.0 * chart.distortion.face_edge_strain(chart.faces)
        colours = colormaps["viridis"](np.clip(error / DRAWN_LIMIT, 0.0, 1.0))
        colours[chart.distortion.area <= 0] = [0.0, 0.0, 0.0, 1.0]
        draw_flat(axis, chart.uv[chart.faces] * factor, colours, edged=True)
        strain.append(100.0 * chart.distortion.edge_rms)
        flips += chart.distortion.flips
        taxels += len(chart.vertices)
    worst = f"{max(strain):.1f}" if strain else "-"
    axis.set_title(f"{name}, {taxels} taxels: {flips} flips, edge rms {worst} %", fontsize=9, y=1.0)


def _scale(metric: FaceMetric, values: FloatArray) -> Any:
    """Colours over the map's own range."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    off = metric.badness(values)
    finite = off[np.isfinite(off)]
    usual = abs(metric.limit - metric.ideal)
    own = float(np.percentile(finite, STRETCHED)) if len(finite) else usual
    reach = max(FAINTEST * usual, own)
    low = metric.ideal - (reach if metric.signed else 0.0)
    colours = "PuOr" if metric.signed else "viridis"
    return ScalarMappable(Normalize(low, metric.ideal + reach), colours)


def _frame_flat(axis: Any, unit: str) -> None:
    _frame(axis)
    axis.set_xlabel(unit, fontsize=8)
    axis.tick_params(labelsize=8)


def _frame_body(axis: Any) -> None:
    _frame(axis)
    axis.set_axis_off()


def _frame(axis: Any) -> None:
    axis.set_aspect("equal")
    axis.autoscale_view()
    axis.margins(0.03)


def square_side(uv: FloatArray) -> float:
    """Side of the squares for a map (n, 2): the largest of 1, 2, 5 times a power of ten."""
    length = float(np.ptp(uv, axis=0).max()) / SQUARES
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= 1.000001 * length))


def checkerboard(
    uv: FloatArray, body: FloatArray, side: float
) -> tuple[list[FloatArray], IntArray, IntArray]:
    """Triangles cut along the lines of a board.

    Parameters
    ----------
    uv : (m, 3, 2) array of float
        Corners on the map.
    body : (m, 3, 3) array of float
        The same on the body.
    side : float
        Of the squares, in the unit of the map.

    Returns
    -------
    pieces : list of (k, 5) array of float
        Polygons: coordinates on the map, then on the body.
    triangle : (p,) array of int
        Where each piece comes from.
    colour : (p,) array of int
        0 or 1.
    """
    both = np.concatenate([uv, body], axis=2)
    if len(uv) > MAX_CUT:
        cell = np.floor(uv.mean(axis=1) / side).astype(np.int64)
        return list(both), np.arange(len(uv)), cell.sum(axis=1) % 2
    pieces, triangle, colour = [], [], []
    for number, corners in enumerate(both):
        for column, strip in _strips(corners, 0, side):
            for row, piece in _strips(strip, 1, side):
                pieces.append(piece)
                triangle.append(number)
                colour.append((column + row) % 2)
    return pieces, np.array(triangle, np.int64), np.array(colour, np.int64)


def _strips(polygon: FloatArray, axis: int, side: float) -> list[tuple[int, FloatArray]]:
    """A convex polygon (k, 5) cut along the lines x_axis = i side, each strip with its i."""
    low = int(np.floor(polygon[:, axis].min() / side))
    high = int(np.ceil(polygon[:, axis].max() / side))
    found = []
    rest = polygon
    for i in range(low, max(high - 1, low)):
        line = (i + 1) * side
        below = _half(rest, line - rest[:, axis])
        rest = _half(rest, rest[:, axis] - line)
        if len(below) >= 3:
            found.append((i, below))
    if len(rest) >= 3:
        found.append((max(high - 1, low), rest))
    return found


def _half(polygon: FloatArray, inside: FloatArray) -> FloatArray:
    """The part (k, 5) of a convex polygon where a linear function (k,) is not negative.

    Sutherland and Hodgman, Communications of the ACM 17(1), 1974.
    """
    kept = []
    for k in range(len(polygon)):
        a, b = inside[k - 1], inside[k]
        if (a < 0) != (b < 0):
            kept.append(polygon[k - 1] + a / (a - b) * (polygon[k] - polygon[k - 1]))
        if b >= 0:
            kept.append(polygon[k])
    return np.array(kept).reshape(-1, polygon.shape[1])

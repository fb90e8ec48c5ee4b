"""What is drawn of a touch: outline, its way, an arrow along its normal, one where it moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import tangent_frames, transform_directions, transform_points
from skinmap.geometry.topology import border_edges
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.touch.contacts.skin_geometry import ACTIVE
from viewer.colours import INK, TRACES, mixed, repeated, rgb, touch_colour
from viewer.colours import faded as pale
from viewer.drawing.frame.camera import Framing, Target, project
from viewer.drawing.frame.polydata import add_actor, make_lines, make_mesh, show_cells
from viewer.drawing.panel.touch_list import caption
from viewer.drawing.skin.skin_layer import HALF, LIFT, LINE_LIFT, Places, SkinLayer
from viewer.drawing.words.labels import Box, Coverage, Label, LabelLayer

SHORT, LONG = 0.03, 0.07  # of arrows, for the lightest and the hardest press [m]
SHAFT, HEAD, HEAD_LENGTH = 1.2e-3, 3.6e-3, 11e-3  # radii and length [m]
AHEAD = 0.3  # arrows of motion go as far as the touch does in this time [s], and
NEAREST, FARTHEST = 0.03, 0.09  # no less and no more [m]
ABOVE = 7e-3  # they lie so far above the skin [m]
SIDES = 8
MOTION_THICK = 1.5  # so much thicker are arrows of motion
PALE = 0.75  # how far the oldest end of a trail has gone to white
PIECES = 8  # shades of a trail
JUMP = 0.03  # [m]: on the flat map what is so near on the skin and so far there has a seam between
FINE = 16  # pieces that a step of a trail across a seam is cut into
TORN = 3.0  # how much longer than on the skin a piece must become to be the one across
CENTRE = 4e-3  # largest radius of the centre of pressure on the flat map [m]

RING_SIDES = 12
INNER, OUTER = 1.2, 1.65  # in radii of a disc
RING_HALO = 0.22  # white on both sides of the ring, in radii of a disc
RISE = 5e-4  # above the discs [m]


class Ground:
    """The surface that marks of one part lie on: the body's, or that of the flat map.

    Parameters
    ----------
    layer : SkinLayer
    places : Places
        Where the part lies on it.

    Attributes
    ----------
    border : (b, 2) int
        Border edges of its sheet.
    tree : cKDTree
        Of the fine surface's vertices, in the link's frame.
    point : (v,) int
        A point of `places` for each of those.
    """

    def __init__(self, layer: SkinLayer, places: Places) -> None:
        self.places, self.border = places, border_edges(places.faces)
        self.tree = cKDTree(layer.fine.positions)
        self.point = np.zeros(len(layer.fine.positions), np.int64)
        self.point[places.vertex] = np.arange(len(places.vertex))

    def carried(self, points: FloatArray, lift: float) -> FloatArray:
        """(p, 3) where points (p, 3) of the skin [m] lie on this surface, lifted above it."""
        distance, near = self.tree.query(points, k=min(3, len(self.point)))
        rows = self.point[near.reshape(len(points), -1)]
        weight = 1.0 / (distance.reshape(rows.shape) ** 2 + 1e-12)
        corners = self.places.points[rows]
        # Across a seam of the flat map the nearest vertices lie far apart: the nearest one it is.
        spread = np.linalg.norm(corners - corners[:, :1], axis=2)
        weight[spread > JUMP] = 0.0
        weight /= weight.sum(axis=1, keepdims=True)
        at = np.einsum("pk,pkd->pd", weight, corners)
        return np.asarray(at + lift * self.places.normals[rows[:, 0]])


class TouchMarks:
    """Marks of all touches in one renderer: a mesh of lines and a mesh of arrows.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Its active renderer shows them.
    """

    def __init__(self, plotter: pv.Plotter, *, lit: bool = True) -> None:
        self.outlines = OutlineLayer(plotter)
        self.solids = pv.PolyData()
        actor = add_actor(plotter, self.solids, lit=lit)
        actor.mapper.SetScalarVisibility(True)
        actor.prop.ambient, actor.prop.diffuse = 0.65, 0.4

    def show(
        self,
        lines: Sequence[tuple[FloatArray, str]],
        solids: Sequence[tuple[FloatArray, IntArray, str]],
        *,
        faded: bool = False,
    ) -> None:
        """Replace all marks.

        Parameters
        ----------
        lines : sequence of ((k, 2, 3) float, str)
            Segments [m] and their colour.
        solids : sequence of ((p, 3) float, (t, 3) int, str)
            Points [m], triangles and their colour.
        faded : bool
            Whether colours are paler: nothing new is heard.
        """
        tone = pale if faded else str
        self.outlines.show([(part, tone(colour)) for part, colour in lines])
        if not (solids or self.solids.GetNumberOfCells()):
            return
        starts = np.cumsum([0, *[len(points) for points, _, _ in solids]])
        faces = [faces + start for (_, faces, _), start in zip(solids, starts, strict=False)]
        mesh = make_mesh(
            np.concatenate([np.zeros((0, 3)), *(points for points, _, _ in solids)]),
            np.concatenate([np.zeros((0, 3), np.int64), *faces]),
        )
        tints = repeated([tone(colour) for _, _, colour in solids], [len(f) for f in faces])
        show_cells(self.solids, mesh, tints)


def trail_on(ground: Ground, touch: NamedTouch, lift: float) -> list[tuple[FloatArray, str]]:
    """Where the centre has been, paler the longer ago."""
    if touch.path is None or len(touch.path) < 2:
        return []
    segments = carried_steps(ground, touch.path, lift)
    pieces = np.array_split(segments, min(PIECES, max(len(segments), 1)))
    colour = touch_colour(touch)
    shades = np.linspace(PALE, 0.0, len(pieces))
    return [
        (piece, mixed(colour, "#ffffff", shade))
        for piece, shade in zip(pieces, shades, strict=True)
    ]


def carried_steps(ground: Ground, path: FloatArray, lift: float) -> FloatArray:
    """(s, 2, 3) steps of a path (p, 3) as they lie on a surface [m].

    A step across a seam of the flat map is cut into pieces: those on both sides are kept, and the
    one that would run across the map is left out.
    """
    points = ground.carried(path, lift)
    steps = np.stack([points[:-1], points[1:]], axis=1)
    on_skin = np.linalg.norm(np.diff(path, axis=0), axis=1)
    length = np.linalg.norm(steps[:, 1] - steps[:, 0], axis=1)
    torn = length > TORN * on_skin + CENTRE
    kept = [steps[~torn & (length > 0.0)]]
    share = np.linspace(0.0, 1.0, FINE + 1)[:, None]
    order = [np.flatnonzero(~torn & (length > 0.0)).astype(np.float64)]
    for row in np.flatnonzero(torn):
        fine = ground.carried((1 - share) * path[row] + share * path[row + 1], lift)
        pieces = np.stack([fine[:-1], fine[1:]], axis=1)
        reach = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1)
        whole = (reach > 0.0) & (reach <= TORN * on_skin[row] / FINE + CENTRE)
        kept.append(pieces[whole])
        order.append(row + np.flatnonzero(whole) / FINE)
    return np.concatenate(kept)[np.argsort(np.concatenate(order), kind="stable")]


def centre_on(ground: Ground, touch: NamedTouch) -> list[tuple[FloatArray, IntArray, str]]:
    """A disc with a white rim at the centre of pressure, for the flat map."""
    at = ground.carried(touch.centre[None], 0.0)[0]
    found, wide = [], min(CENTRE, 0.6 * ground.places.disc)  # less than a taxel
    for radius, rise, colour in (
        (wide, 4e-3, "#ffffff"),
        (0.72 * wide, 5e-3, touch_colour(touch)),
    ):
        angle = np.arange(16) * np.pi / 8
        ring = at + radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(16)])
        fan = np.stack([np.zeros(14), np.arange(1, 15), np.arange(2, 16)], axis=1)
        ring[:, 2] += rise
        found.append((ring, fan.astype(np.int64), colour))
    return found


def arrow(
    touch: NamedTouch, pose: FloatArray, scale: float = 1.0
) -> list[tuple[FloatArray, IntArray, str]]:
    """An arrow out of the skin, longer the harder the press; none where no normal is known."""
    if touch.normal is None or not np.isfinite(touch.normal).all():
        return []
    share = np.clip(touch.peak / 255.0, 0.0, 1.0) if np.isfinite(touch.peak) else 0.5
    length = SHORT + round(float(share), 2) * (LONG - SHORT)
    points, faces = solid_arrow(length)
    axes = np.vstack([tangent_frames(touch.normal), touch.normal])
    foot = touch.centre + (LIFT + LINE_LIFT) * scale * touch.normal
    start = transform_points(pose, foot[None])
    return [(start + transform_directions(pose, scale * points @ axes), faces, touch_colour(touch))]


def motion_arrow(
    touch: NamedTouch, pose: FloatArray, scale: float = 1.0
) -> list[tuple[FloatArray, IntArray, str]]:
    """An arrow over the skin where a touch moves, longer the faster; none of one that stays."""
    if touch.normal is None or (way := motion_way(touch, scale)) is None:
        return []
    ahead, reach = way
    points, faces = solid_arrow(round(reach / scale, 3))
    side = np.cross(ahead, touch.normal)
    axes = np.stack([MOTION_THICK * side, MOTION_THICK * np.cross(side, ahead), ahead])
    start = transform_points(pose, (touch.centre + ABOVE * scale * touch.normal)[None])
    return [(start + transform_directions(pose, scale * points @ axes), faces, touch_colour(touch))]


def motion_line(ground: Ground, touch: NamedTouch, lift: float) -> list[tuple[FloatArray, str]]:
    """The same as lines on the flat map."""
    if touch.normal is None or (way := motion_way(touch, ground.places.scale)) is None:
        return []
    ahead, reach = way
    side = np.cross(ahead, touch.normal)
    tip = touch.centre + reach * ahead
    barbs = [tip + 0.3 * reach * (sign * 0.5 * side - ahead) for sign in (-1.0, 1.0)]
    along = np.linspace(0.0, 1.0, 8)[:, None]
    colour = touch_colour(touch)
    ways = [touch.centre + along * (tip - touch.centre), *(np.stack([tip, one]) for one in barbs)]
    return [(carried_steps(ground, way, lift), colour) for way in ways]


def motion_way(touch: NamedTouch, scale: float = 1.0) -> tuple[FloatArray, float] | None:
    """Direction (3,) and length [m] of the arrow of a touch that moves; None of one that stays."""
    if touch.motion is None or touch.motion.heading == "still":
        return None
    speed = touch.motion.speed
    reach = np.clip(AHEAD * speed, NEAREST * scale, FARTHEST * scale)
    return touch.motion.velocity / speed, float(reach)


@lru_cache(maxsize=64)
def solid_arrow(length: float) -> tuple[FloatArray, IntArray]:
    """Points (4 s + 1, 3) and triangles of an arrow from the origin along z [m]."""
    angle = np.arange(SIDES) * 2 * np.pi / SIDES
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)])
    neck = np.array([0.0, 0.0, length - HEAD_LENGTH])
    rings = [SHAFT * circle, SHAFT * circle + neck, HEAD * circle + neck]
    points = np.vstack([*rings, [[0.0, 0.0, length]]])
    k = np.arange(SIDES)
    n = (k + 1) % SIDES
    faces = [np.stack([k, n, n + SIDES], 1), np.stack([k, n + SIDES, k + SIDES], 1)]
    faces += [np.stack([k + SIDES, n + 2 * SIDES, n + SIDES], 1)]
    faces += [np.stack([k + SIDES, k + 2 * SIDES, n + 2 * SIDES], 1)]
    faces += [np.stack([k + 2 * SIDES, n + 2 * SIDES, np.full(SIDES, 3 * SIDES)], 1)]
    return points, np.concatenate(faces)


class KeptContours:
    """Fields of the touches shown, from which body and flat map take their contours.

    They are found once for both: a contour takes a sparse product over its part, whatever surface
    it is drawn on.
    """

    def __init__(self) -> None:
        self._fields: dict[int, tuple[FloatArray, float]] = {}

    def forget(self) -> None:
        """Turn to the touches of another moment."""
        self._fields.clear()

    def of(
        self,
        ground: Ground,
        layer: SkinLayer,
        touch: NamedTouch,
        touches: Sequence[NamedTouch],
        lift: float,
    ) -> FloatArray:
        """(k, 2, 3) contour of one of the touches on a surface, in its frame [m]."""
        row = next(k for k, one in enumerate(touches) if one is touch)
        if row not in self._fields:
            self._fields[row] = touch_field(layer, touch, touches)
        (values, level), places = self._fields[row], ground.places
        line = outline(places.faces, ground.border, values[places.vertex], level)
        return line.points(places.points + lift * places.normals)


class Rings:
    """All rings of one renderer: one mesh."""

    def __init__(self, plotter: pv.Plotter) -> None:
        self.mesh = pv.PolyData()
        add_actor(plotter, self.mesh).mapper.SetScalarVisibility(True)

    def show(self, parts: Sequence[tuple[Places, IntArray, FloatArray]]) -> None:
        """Ring taxels (k,) of parts placed by poses (4, 4), and no others."""
        if not (parts or self.mesh.n_cells):
            return
        points, colours = [np.zeros((0, 4, 3))], [np.zeros((0, 3))]
        for places, taxels, pose in parts:
            rows = np.flatnonzero(np.isin(places.taxels, taxels))
            order = np.searchsorted(taxels, places.taxels[rows])
            for inner, outer, rise, white in (
                (INNER - RING_HALO, OUTER + RING_HALO, RISE, True),
                (INNER, OUTER, 2 * RISE, False),
            ):
                lift = rise * (places.scale if places.lit else 1.0)
                centres = places.centres[rows] + lift * places.facing[rows]
                quads = ring_quads(
                    centres, places.facing[rows], inner * places.disc, outer * places.disc
                )
                turned = transform_points(pose, quads.reshape(-1, 3))
                points.append(turned.reshape(-1, 4, 3))
                tint = np.full((len(rows), 3), 1.0) if white else trace_colours(order, len(taxels))
                colours.append(np.repeat(tint, RING_SIDES, axis=0))
        corners = np.concatenate(points)
        mesh = make_mesh(corners.reshape(-1, 3), np.arange(4 * len(corners)).reshape(-1, 4))
        tints: NDArray[np.uint8] = np.rint(np.concatenate(colours) * 255).astype(np.uint8)
        show_cells(self.mesh, mesh, tints)


def trace_colours(order: IntArray, count: int) -> FloatArray:
    """(k, 3) the colour of each selected taxel's trace; ink where there are too many of them."""
    if count > len(TRACES):
        return np.tile(rgb(INK), (len(order), 1))
    return np.array([rgb(TRACES[k]) for k in order.tolist()]).reshape(-1, 3)


def ring_quads(centres: FloatArray, normals: FloatArray, inner: float, outer: float) -> FloatArray:
    """(k RING_SIDES, 4, 3) quadrilaterals of rings around centres (k, 3) [m]."""
    angle = np.arange(RING_SIDES + 1) * 2 * np.pi / RING_SIDES
    way = np.column_stack([np.cos(angle), np.sin(angle)]) @ tangent_frames(normals)
    near, far = centres[:, None] + inner * way, centres[:, None] + outer * way
    quads = np.stack([near[:, :-1], far[:, :-1], far[:, 1:], near[:, 1:]], axis=2)
    return quads.reshape(-1, 4, 3)


# Outlines of touches: on the body and on the flat map, coloured by class.

PEAK_SHARE = 0.25  # of a touch's largest pressure: where its outline runs, if above the noise
WIDTH = 3.0  # [px]
HALO = 6.0  # white under the line, so that it shows on any pressure [px]


@dataclass(frozen=True, eq=False, slots=True)
class Outline:
    """k segments; each end lies on an edge between two vertices.

    Attributes
    ----------
    first, second : (k, 2) int
        Vertices of the edge on which each end lies.
    share : (k, 2) float
        Where on it, 0 at the first vertex, 1 at the second.
    """

    first: IntArray
    second: IntArray
    share: FloatArray

    def points(self, coordinates: FloatArray) -> FloatArray:
        """(k, 2, d) ends of the segments for coordinates (v, d) of the vertices."""
        share = self.share[:, :, None]
        return np.asarray(coordinates[self.first] * (1 - share) + coordinates[self.second] * share)


def outline(faces: IntArray, border: IntArray, values: FloatArray, level: float) -> Outline:
    """Closed outline of the region where `values` exceed `level`.

    Parameters
    ----------
    faces : (m, 3) int
        Triangles.
    border : (b, 2) int
        Edges of the mesh's border: the outline runs along them where the region reaches them.
    values : (v,) float
        Field at the vertices.
    level : float
        Same unit as `values`.
    """
    above = values > level
    inside = above[faces].sum(axis=1)
    crossed = faces[(inside == 1) | (inside == 2)]
    one = above[crossed].sum(axis=1) == 1
    # The corner that is alone on its side of the level; both crossed edges start there.
    lone = np.argmax(above[crossed] == one[:, None], axis=1)
    row = np.arange(len(crossed))
    apex = np.repeat(crossed[row, lone][:, None], 2, axis=1)
    others = np.stack([crossed[row, (lone + 1) % 3], crossed[row, (lone + 2) % 3]], axis=1)
    edge = border[above[border].any(axis=1)]
    start = np.where(above[edge], edge, edge[:, ::-1])  # an end outside moves to the crossing
    first = np.concatenate([apex, start])
    second = np.concatenate([others, edge])
    return Outline(first, second, _crossing(values[first], values[second], level))


def _crossing(a: FloatArray, b: FloatArray, level: float) -> FloatArray:
    """Where between a and b the level lies; 0 where the two are on one side of it."""
    crosses = (a > level) != (b > level)
    span = np.where(crosses, b - a, 1.0)
    return np.where(crosses, np.clip((level - a) / span, 0.0, 1.0), 0.0)


def touch_field(
    layer: SkinLayer, touch: NamedTouch, others: Sequence[NamedTouch] = ()
) -> tuple[FloatArray, float]:
    """(v,) pressures that one touch is outlined by, and their level.

    Only its own taxels and those beside them count, without those of other touches: whatever else
    the part feels is not this touch. A taxel of which nothing is known is left out like a hole.
    """
    known = np.isfinite(layer.pressures)
    own = np.zeros(len(known))
    own[touch.taxels] = 1.0
    near = (layer.beside @ own) > 0.0
    for other in others:
        if other is not touch and other.part == touch.part:
            near[np.setdiff1d(other.taxels, touch.taxels)] = False
    values = layer.soft @ np.where(near & known, layer.pressures, 0.0)
    if not known.all():
        values[layer.fine.linear @ known.astype(np.float64) < HALF] = 0.0
    peak = float(values[layer.fine.linear @ own > 0.0].max(initial=0.0))
    return values, max(ACTIVE, PEAK_SHARE * peak)


def outline_touch(
    layer: SkinLayer, touch: NamedTouch, others: Sequence[NamedTouch] = ()
) -> Outline:
    """Outline of one touch on its part, without the pressures of other touches on it."""
    values, level = touch_field(layer, touch, others)
    return outline(layer.fine.faces, layer.border, values, level)


class OutlineLayer:
    """All outlines of one renderer: one mesh, drawn as coloured lines with a white halo."""

    def __init__(self, plotter: pv.Plotter) -> None:
        self.lines = pv.PolyData()
        self.actors = []
        # Both lie on the sheet: the halo is pushed back, the line pulled forward.
        for width, coloured, offset in ((HALO, False, 0.0), (WIDTH, True, -20.0)):
            actor = add_actor(plotter, self.lines, width=width)
            actor.mapper.SetScalarVisibility(coloured)
            actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, offset)
            self.actors.append(actor)

    def show(self, lines: Sequence[tuple[FloatArray, str]]) -> None:
        """Draw segments (k, 2, 3) [m], each some in their colour; replaces what was there."""
        if not (lines or self.lines.GetNumberOfCells()):
            return
        ends = np.concatenate([np.zeros((0, 2, 3)), *(part for part, _ in lines)])
        mesh = make_lines(ends.reshape(-1, 3), np.arange(2 * len(ends)).reshape(-1, 2))
        tints = repeated([colour for _, colour in lines], [len(part) for part, _ in lines])
        show_cells(self.lines, mesh, tints)


LABELS = 8  # at most, of the largest touches: more cannot be read at one look


class TouchView:
    """Marks and labels of touches in the body's renderer.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Its active renderer is the body's.
    layers : mapping of str to SkinLayer
    font_px : int
        Height of the letters [px].
    contours : KeptContours
        The flat map's too.
    """

    def __init__(
        self,
        plotter: pv.Plotter,
        layers: Mapping[str, SkinLayer],
        font_px: int,
        contours: KeptContours,
    ) -> None:
        self.layers, self.renderer, self.contours = layers, plotter.renderer, contours
        self.marks = TouchMarks(plotter)
        self.labels = LabelLayer(plotter.renderer, round(1.1 * font_px))
        self.targets: list[Target] = []
        self._ground = cache(lambda part: Ground(layers[part], layers[part].places))
        self._touches: tuple[NamedTouch, ...] = ()
        self._anchors = self._tips = np.zeros((0, 3))
        self._hidden: dict[str, bool] = {}
        self._seen: Coverage | None = None  # the picture that edges were found in
        self._edges: dict[tuple[int, int], tuple[float, float]] = {}

    def show(
        self,
        touches: Sequence[NamedTouch],
        poses: Mapping[str, FloatArray],
        *,
        faded: bool = False,
    ) -> None:
        """Mark these touches, and no others, on links placed by poses (4, 4)."""
        self._touches = tuple(touches)
        self.targets, anchors = [], []
        lines, solids, tips = [], [], []
        for touch in touches:
            layer = self.layers[touch.part]
            pose = poses[layer.skin.link]
            ground = self._ground(touch.part)
            scale = layer.places.scale
            lift = LINE_LIFT * scale
            contour = self.contours.of(ground, layer, touch, touches, lift)
            for points, colour in (*trail_on(ground, touch, lift), (contour, touch_colour(touch))):
                placed = transform_points(pose, points.reshape(-1, 3)).reshape(-1, 2, 3)
                lines.append((placed, colour))
            arrows = arrow(touch, pose, scale)
            solids += arrows + motion_arrow(touch, pose, scale)
            tips += [points[-1] for points, _, _ in arrows]
            self.targets.append(target(layer, touch, pose))
            normal = self.targets[-1].normals[self.targets[-1].middle]
            centre = transform_points(pose, touch.centre[None])[0]
            anchors.append(centre + (LIFT + LINE_LIFT) * scale * normal)
        self._anchors = np.array(anchors).reshape(-1, 3)
        self._tips = np.array(tips).reshape(-1, 3)
        self.marks.show(lines, solids, faded=faded)

    def write_labels(
        self,
        framing: Framing,
        avoid: Sequence[Box],
        *,
        look: bool,
        moving: bool = False,
        faded: bool = False,
    ) -> None:
        """Place the labels in the picture; `look` finds out anew which centres are hidden.

        The label of a hidden touch ends at the nearest outline of the body and says "behind".

        Without it they stay as they were found last, but what turned away is hidden at once.
        Those of touches that are no longer heard of are faded.
        """
        names = [key(touch, row) for row, touch in enumerate(self._touches)]
        if look:
            found = [framing.hidden(target) for target in self.targets]
            self._hidden = dict(zip(names, found, strict=True))
        places = project(self.renderer, self._anchors)
        sizes = np.array([len(touch.taxels) for touch in self._touches])
        chosen = np.sort(np.argsort(-sizes, kind="stable")[:LABELS])
        tint = pale if faded else str
        busy = framing.busy(moving=moving) if len(chosen) else None
        labels = []
        for row in chosen.tolist():
            hidden = self._hidden.get(names[row], False) or self._turned_away(row)
            anchor = (float(places[row, 0]), float(places[row, 1]))
            words = caption(self._touches[row])
            inward = None
            if hidden and busy is not None:  # a line to it would point through the body
                centre, words = anchor, f"{words}, behind"
                anchor = self._edge(centre, framing, busy)
                inward = (centre[0] - anchor[0], centre[1] - anchor[1])
            colour = tint(touch_colour(self._touches[row]))
            labels.append(Label(names[row], words, colour, anchor, hidden, inward))
        reach = self.labels.font_px
        tips = [
            (float(x) - reach, float(y) - reach, float(x) + reach, float(y) + reach)
            for x, y in project(self.renderer, self._tips)
        ]
        self.labels.show(labels, [*avoid, *tips], busy)

    def _edge(
        self, centre: tuple[float, float], framing: Framing, busy: Coverage
    ) -> tuple[float, float]:
        """Where the body's silhouette lies nearest to a hidden centre [px]; kept while it rests."""
        at = (round(centre[0]), round(centre[1]))
        if self._seen is not busy:
            self._seen, self._edges = busy, {}
        if at not in self._edges:
            self._edges[at] = busy.outline(centre, framing.covers)
        return self._edges[at]

    def _turned_away(self, row: int) -> bool:
        """Whether the skin under a touch faces away from the camera."""
        way = np.array(self.renderer.GetActiveCamera().GetPosition()) - self._anchors[row]
        target = self.targets[row]
        return bool(target.normals[target.middle] @ way <= 0.0)


def key(touch: NamedTouch, row: int) -> str:
    """What a label keeps its place by."""
    return f"{touch.part}/{touch.identity if touch.identity >= 0 else f'row {row}'}"


def target(layer: SkinLayer, touch: NamedTouch, pose: FloatArray) -> Target:
    """What the camera is to see of a touch."""
    skin = layer.skin
    points = skin.positions[touch.taxels]
    if not len(points):  # a touch without taxels is where its centre is
        near = int(np.argmin(np.linalg.norm(skin.positions - touch.centre, axis=1)))
        normals = transform_directions(pose, skin.normals[[near]])
        return Target(transform_points(pose, touch.centre[None]), normals, 0, layer.places.scale)
    middle = int(np.argmin(np.linalg.norm(points - touch.centre, axis=1)))
    normals = transform_directions(pose, skin.normals[touch.taxels])
    return Target(transform_points(pose, points), normals, middle, layer.places.scale)

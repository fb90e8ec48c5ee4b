"""Touches on the body: outlines, trails, arrows and labels, from what the loop found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.live.contacts.named_touch import NamedTouch
from viewer.colours import faded as pale
from viewer.colours import touch_colour
from viewer.drawing.frame.camera import Framing, Target, project
from viewer.drawing.panel.touch_list import caption
from viewer.drawing.skin.draw_positions import LIFT
from viewer.drawing.skin.skin_layer import LINE_LIFT, SkinLayer
from viewer.drawing.touches.touch_marks import (
    Ground,
    KeptContours,
    TouchMarks,
    arrow,
    motion_arrow,
    trail_on,
)
from viewer.drawing.words.labels import Box, Coverage, Label, LabelLayer

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
        self._ground = cache(lambda part: Ground.of(layers[part], layers[part].places))
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
            for points, colour in (
                *trail_on(ground, touch, lift),
                (
                    self.contours.of(ground, layer, touch, touches, lift),
                    touch_colour(touch),
                ),
            ):
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
                centre, anchor, words = (
                    anchor,
                    self._edge(anchor, framing, busy),
                    f"{words}, behind",
                )
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

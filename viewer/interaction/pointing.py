"""What the mouse points at in a scene: boxes that describe taxels, and chosen taxels.

What is known of one taxel: for the page as it is, for the window's box in lines of text.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError, check_known
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.live.contacts.named_touch import Moment
from skinmap.summary import first_few
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.drawing.frame.camera import FACING, Target, project, world_points
from viewer.drawing.panel.touch_list import caption
from viewer.drawing.skin.skin_layer import raised
from viewer.drawing.skin.taxel_drawing import SIGNS
from viewer.interaction.mouse import Lasso, Pace, Reach, Selection, reached
from viewer.interaction.overlays import RING, TextBox, Trace2D
from viewer.layers import Layer, Layers
from viewer.scene import Scene
from viewer.web.scene_data import finite

MANY = 8  # neighbours that are listed by number


def neighbours(skin: PreparedSkin, taxel: int) -> IntArray:
    """(k,) taxels that share an edge of the surface mesh with a taxel."""
    faces = skin.mesh.faces
    own = skin.mesh.representative[taxel]
    around = np.unique(faces[(faces == own).any(axis=1)])
    return around[around != own]


def describe(
    layers: Layers,
    part: str,
    taxel: int,
    moment: Moment | None,
    *,
    shown: str = "pressure",
    structure: bool = True,
) -> dict[str, Any]:
    """Channel, module, place and values of a taxel.

    Parameters
    ----------
    part : str
    taxel : int
        Dense row.
    moment : Moment or None
        What is shown now.
    shown : str
        The page's layer.
    structure : bool
        Whether to name its structure: finding those of a robot takes a second the first time.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        A part or a taxel that is not there.
    """
    check_known("part shown", [part], layers.skins)
    prepared = layers.skins[part]
    skin = prepared.skin
    if not 0 <= taxel < len(skin):
        raise InvalidArrayError(f"{part!r} has taxels 0 to {len(skin) - 1}, not {taxel}")
    touches = () if moment is None else moment.touches
    found: str | None = "being found"
    if structure:
        found = _category(layers.get("structures"), part, taxel, None)
    return {
        "part": part,
        "taxel": taxel,
        "channel": int(skin.channels[taxel]),
        "module": int(skin.modules[taxel]),
        "patch": int(prepared.patches[taxel]) + 1,
        "link": skin.link,
        "position_mm": (1e3 * skin.positions[taxel]).round(1).tolist(),
        "normal": skin.normals[taxel].round(2).tolist(),
        "neighbours": skin.channels[neighbours(prepared, taxel)].tolist(),
        **_felt(part, taxel, moment),
        "structure": found or "unknown",
        "health": _category(layers.get("health"), part, taxel, moment),
        "shown": _shown(layers.get(shown), part, taxel, moment),
        "touches": [caption(t) for t in touches if t.part == part and taxel in t.taxels],
    }


def _felt(part: str, taxel: int, moment: Moment | None) -> dict[str, Any]:
    """Pressure and raw value as they came, and which of them did."""
    found: dict[str, Any] = {"sent": []}
    for name, kind in (("pressure", "pressures"), ("raw", "raw")):
        values = {} if moment is None else getattr(moment, kind)
        found[name] = finite(float(values[part][taxel])) if part in values else None
        found["sent"] += [name] if part in values else []
    return found


def _shown(layer: Layer, part: str, taxel: int, moment: Moment | None) -> dict[str, Any]:
    """What the layer that is shown says."""
    known = not layer.categories
    return {
        "name": layer.name,
        "title": layer.title,
        "unit": layer.unit,
        "value": finite(layer.values(part, moment)[taxel]) if known else None,
        "category": _category(layer, part, taxel, moment),
    }


def _category(layer: Layer, part: str, taxel: int, moment: Moment | None) -> str | None:
    if not layer.categories:
        return None
    kind = layer.values(part, moment)[taxel]
    return layer.categories[round(kind)] if np.isfinite(kind) else None


def lines(about: Mapping[str, Any]) -> tuple[str, ...]:
    """What is known of a taxel, as `describe` has it, for the box beside it."""
    position = " ".join(f"{value:.1f}" for value in about["position_mm"])
    normal = " ".join(f"{value:.2f}" for value in about["normal"])
    told = [
        f"{name} {about[name]:.4g}" if about[name] is not None else f"{name} unknown"
        for name in about["sent"]
    ]
    written = [
        f"{about['part'].replace('_', ' ')}, channel {about['channel']}",
        f"module {about['module']}, patch {about['patch']}, taxel {about['taxel']}",
        f"position {position} mm",
        f"normal {normal}",
        f"neighbours {first_few(about['neighbours'], MANY, ' ') or 'none'}",
    ]
    if told:
        written.append(", ".join(told) + " counts")
    shown = about["shown"]
    if shown["name"] not in ("pressure", "raw", "structures", "patches"):
        value = "unknown" if shown["category"] is None else shown["category"]
        if shown["value"] is not None:
            value = f"{shown['value']:.3g} {shown['unit'].partition(',')[0]}"
        written.append(f"{shown['title']} {value}")
    if shown["name"] != "health" and about["health"] in SIGNS:
        written.append(f"health {about['health']}")
    written.append(f"structure {about['structure']}")
    return (*written, *(f"in {touch}" for touch in about["touches"]))


HOVER = 0.06  # between two looks at what lies under the mouse [s]
SHARE = 0.75  # of the spacing: how far beside a taxel it is still meant
NEAR_PX = 4.0  # however small taxels are in the picture, so near is near enough [px]
SHEET = 0.015  # taxels that lie so much deeper than the first belong to another side [m]


class Pick(NamedTuple):
    """One taxel that the mouse points at.

    Attributes
    ----------
    part : str
    taxel : int
        Dense row.
    where : {"body", "map"}
    """

    part: str
    taxel: int
    where: Literal["body", "map"]


class MapTargets(NamedTuple):
    """The vertices of a part's flat map: taxels (k,), two or more on a seam, and places (k, 2)."""

    taxels: IntArray
    uv: FloatArray
    tree: cKDTree


def within(renderer: Any, x: float, y: float) -> bool:
    """Whether a pixel of the window lies in a renderer."""
    left, bottom = renderer.GetOrigin()
    width, height = renderer.GetSize()
    return bool(left <= x < left + width and bottom <= y < bottom + height)


class Pointing:
    """Picks, boxes and the selection of one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.skins = scene, scene.data.skins
        self._body = scene.plotter.renderers[0]
        self.selection = Selection()
        self.pointed: Pick | None = None
        self._told: tuple[str, ...] = ()
        self.moment: Moment | None = None
        self._pace = Pace(HOVER, time.perf_counter)
        self._mouse: tuple[float, float] | None = None
        self._line: Trace2D | None = None
        renderers = {"body": self._body}
        if scene.panel is not None:
            renderers["map"] = scene.panel.renderer
            self._line = Trace2D(scene.panel.renderer)
        self._boxes = {where: TextBox(one, scene.font_px) for where, one in renderers.items()}
        self._rings = {where: Trace2D(one) for where, one in renderers.items()}
        self._maps: dict[str, MapTargets] = {}
        self._spacings = {part: s.skin.spacing for part, s in self.skins.items()}

    # Picking.

    def pick(self, x: float, y: float) -> Pick | None:
        """The taxel at a pixel of the window."""
        panel = self.scene.panel
        if panel is not None and within(panel.renderer, x, y):
            return self._pick_on_map(panel.renderer, panel.part, x, y)
        return self._pick_on_body(x, y) if within(self._body, x, y) else None

    def _pick_on_map(self, renderer: Any, part: str, x: float, y: float) -> Pick | None:
        """The taxel of the flat map at a pixel."""
        one, other = world_points(renderer, x, y)[0], world_points(renderer, x + 1, y)[0]
        metres = float(abs(other - one).max())  # that a pixel is wide
        reach = max(SHARE * self._spacings[part], NEAR_PX * metres)
        targets = self._map_targets(part)
        distance, row = targets.tree.query(one[:2], distance_upper_bound=reach)
        return Pick(part, int(targets.taxels[row]), "map") if np.isfinite(distance) else None

    def _pick_on_body(self, x: float, y: float) -> Pick | None:
        """The taxel that is met first at a pixel, if it faces the camera and nothing hides it."""
        near, far = world_points(self._body, x, y)
        camera = self._body.GetActiveCamera()
        half = np.tan(np.radians(camera.GetViewAngle() / 2))
        spread = 2.0 * float(half) / self._body.GetSize()[1]  # of a pixel per metre of way [m]
        ahead = (far - near) / np.linalg.norm(far - near)
        best: tuple[float, float, str, Target] | None = None
        for part in self.scene.layers:
            target = self._target(part)
            way = target.points - np.array(camera.GetPosition())
            depth = way @ ahead
            beside = np.linalg.norm(way - depth[:, None] * ahead, axis=1)
            reach = np.maximum(SHARE * self._spacings[part], NEAR_PX * spread * depth)
            facing = -(target.normals @ ahead) > FACING
            rows = np.flatnonzero((depth > 0) & (beside < reach) & facing)
            if len(rows) == 0:
                continue
            rows = rows[depth[rows] < depth[rows].min() + SHEET]
            taxel = int(rows[np.argmin(beside[rows])])
            deep, aside = float(depth[taxel]), float(beside[taxel])
            if best is not None:
                alike = abs(deep - best[0]) < SHEET
                if (aside >= best[1]) if alike else (deep >= best[0]):
                    continue
            best = (deep, aside, part, replace(target, middle=taxel))
        if best is None or self.scene.framing.hidden(best[3]):
            return None
        return Pick(best[2], best[3].middle, "body")

    def _target(self, part: str) -> Target:
        """The taxels of a part in the world."""
        skin = self.skins[part].skin
        pose = self.scene.poses[skin.link]
        points = transform_points(pose, skin.positions)
        scale = self.scene.layers[part].places.scale
        return Target(points, transform_directions(pose, skin.normals), 0, scale)

    def _map_targets(self, part: str) -> MapTargets:
        if part not in self._maps:
            charts = self.skins[part].flat.charts
            taxels = np.concatenate([chart.taxels for chart in charts])
            uv = np.concatenate([chart.uv for chart in charts])
            self._maps[part] = MapTargets(taxels, uv, cKDTree(uv))
        return self._maps[part]

    # Boxes.

    def point(self, x: float, y: float) -> None:
        """Remember where the mouse is; `tick` looks what is there, at its own pace."""
        self._mouse = (x, y)

    def scale(self, font_px: int) -> None:
        """Write in letters of another height [px]."""
        for box in self._boxes.values():
            box.scale(font_px)
        self._told = ()  # what is shown is placed anew
        self.hurry()

    def hurry(self) -> None:
        """Look at once where the mouse is, whenever that was done last."""
        self._pace.reset()

    def put_away(self) -> bool:
        """Hide the box at a taxel; whether there was one."""
        shown = any(box.shown for box in self._boxes.values())
        self.leave()
        return shown

    def leave(self) -> None:
        """The mouse has left: nothing is pointed at."""
        self._mouse = None
        self._show(None)

    def tick(self, moment: Moment | None) -> bool:
        """Bring the box up to date when it is time; whether the picture has changed."""
        self.moment = moment
        if self._mouse is None or not self._pace.due():
            return False
        return self._show(self.pick(*self._mouse))

    def _show(self, pick: Pick | None) -> bool:
        before = self.pointed
        self.pointed = pick
        lines = None if pick is None else self.lines(pick)
        if pick is not None and before == pick and self._told == lines:
            return False
        for where in self._boxes:
            if pick is None or where != pick.where:
                self._boxes[where].hide()
                self._rings[where].hide()
        if pick is None or lines is None:
            return before is not None
        self._told = lines
        x, y = self._place(pick)
        self._rings[pick.where].ring(x, y, RING * self.scene.font_px)
        self._boxes[pick.where].tell(lines, x, y)
        return True

    def _place(self, pick: Pick) -> tuple[float, float]:
        """Where a taxel appears in its renderer [px]; that on the map nearest to the mouse."""
        if pick.where == "body":
            points = self._target(pick.part).points[pick.taxel][None]
            places = project(self._body, points)
            return float(places[0, 0]), float(places[0, 1])
        assert self.scene.panel is not None
        renderer = self.scene.panel.renderer
        targets = self._map_targets(pick.part)
        uv = targets.uv[targets.taxels == pick.taxel]
        places = project(renderer, raised(uv))
        mouse = np.array(self._mouse or places[0]) - np.array(renderer.GetOrigin())
        nearest = places[np.argmin(np.linalg.norm(places - mouse, axis=1))]
        return float(nearest[0]), float(nearest[1])

    def lines(self, pick: Pick) -> tuple[str, ...]:
        """What the box says of a taxel."""
        about = describe(
            self.scene.data, pick.part, pick.taxel, self.moment, shown=self.scene.layer.name
        )
        return lines(about)

    def remove(self) -> None:
        """Take boxes and lines out of the scene."""
        for where in self._boxes:
            self._boxes[where].remove()
            self._rings[where].remove()
        if self._line is not None:
            self._line.remove()

    # Choosing.

    def click(self, x: float, y: float, reach: Reach, *, add: bool) -> None:
        """Choose the taxel at a pixel, its module or patch; beside the skin, nothing."""
        pick = self.pick(x, y)
        self._mouse = (x, y)
        self._show(pick)
        if pick is not None:
            self.choose(pick, reach, add=add)
        elif not add:
            self.clear()

    def choose(self, pick: Pick, reach: Reach, *, add: bool = False) -> None:
        """Choose a taxel, its module or patch, alone or beside what is chosen."""
        taxels = reached(self.skins[pick.part].mesh, pick.taxel, reach)
        (self.selection.toggle if add else self.selection.replace)(pick.part, taxels)
        self.refresh()

    def enclose(self, lasso: Lasso, *, add: bool) -> None:
        """Choose the taxels whose place on the flat map, or one of them, lies within a lasso."""
        panel = self.scene.panel
        if panel is None:
            return
        targets = self._map_targets(panel.part)
        places = project(panel.renderer, raised(targets.uv)) + np.array(panel.renderer.GetOrigin())
        taxels = np.unique(targets.taxels[lasso.holds(places)])
        if add:
            taxels = np.union1d(taxels, self.selection.taxels(panel.part))
            self.selection.set(panel.part, taxels)
        else:
            self.selection.replace(panel.part, taxels)
        self.refresh()

    def trace(self, lasso: Lasso | None) -> None:
        """Draw the lasso as far as it goes, or take it away."""
        if self._line is None:
            return
        if lasso is None:
            self._line.hide()
        else:
            self._line.trace(lasso.corners - np.array(self._line.renderer.GetOrigin()))

    def clear(self) -> None:
        """Choose nothing."""
        self.selection.clear()
        self.refresh()

    def refresh(self) -> None:
        """Show what is chosen in the scene."""
        for part in self.skins:
            self.scene.select(part, self.selection.taxels(part))

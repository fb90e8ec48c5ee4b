"""What the mouse points at in a scene: boxes that describe taxels, and chosen taxels."""

from __future__ import annotations

import time

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.live.moment import Moment
from viewer.drawing.frame import camera
from viewer.drawing.frame.camera import project
from viewer.interaction.describe import describe, lines
from viewer.interaction.mouse import Pace
from viewer.interaction.overlays import RING, TextBox, Trace2D
from viewer.interaction.picking import (
    MapTargets,
    Pick,
    Target,
    pick_on_body,
    ray,
    within,
    world_points,
)
from viewer.interaction.selection import Lasso, Reach, Selection, reached
from viewer.scene import Scene

HOVER = 0.06  # between two looks at what lies under the mouse [s]


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
        self._boxes = {"body": TextBox(self._body, scene.font_px)}
        self._rings = {"body": Trace2D(self._body)}
        self._line: Trace2D | None = None
        self._maps: dict[str, MapTargets] = {}
        self._spacings = {part: s.skin.spacing for part, s in self.skins.items()}
        if scene.panel is not None:
            self._boxes["map"] = TextBox(scene.panel.renderer, scene.font_px)
            self._rings["map"] = Trace2D(scene.panel.renderer)
            self._line = Trace2D(scene.panel.renderer)

    # Picking.

    def pick(self, x: float, y: float) -> Pick | None:
        """The taxel at a pixel of the window."""
        scene = self.scene
        if scene.panel is not None and within(scene.panel.renderer, x, y):
            renderer = scene.panel.renderer
            one, other = world_points(renderer, x, y)[0], world_points(renderer, x + 1, y)[0]
            return self._map_targets(scene.panel.part).at(one[:2], float(abs(other - one).max()))
        if not within(self._body, x, y):
            return None
        found = ray(self._body, x, y)
        return pick_on_body(found, (self._target(part) for part in scene.layers), self._hidden)

    def _target(self, part: str) -> Target:
        skin, pose = self.skins[part].skin, self._pose(part)
        return Target(
            part,
            transform_points(pose, skin.positions),
            transform_directions(pose, skin.normals),
            self._spacings[part],
        )

    def _pose(self, part: str) -> FloatArray:
        return self.scene.poses[self.skins[part].skin.link]

    def _hidden(self, position: FloatArray, normal: FloatArray) -> bool:
        target = camera.Target(position[None], normal[None], 0)
        return self.scene.framing.hidden(target)

    def _map_targets(self, part: str) -> MapTargets:
        if part not in self._maps:
            charts = self.skins[part].flat.charts
            taxels = np.concatenate([chart.taxels for chart in charts])
            uv = np.concatenate([chart.uv for chart in charts])
            self._maps[part] = MapTargets(part, taxels, uv, self._spacings[part])
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
        if pick is None:
            for where in self._boxes:
                self._boxes[where].hide()
                self._rings[where].hide()
            return before is not None
        lines = self.lines(pick)
        if before == pick and self._told == lines:
            return False
        self._told = lines
        for where in self._boxes:
            if where != pick.where:
                self._boxes[where].hide()
                self._rings[where].hide()
        x, y = self._place(pick)
        self._rings[pick.where].ring(x, y, RING * self.scene.font_px)
        self._boxes[pick.where].tell(lines, x, y)
        return True

    def _place(self, pick: Pick) -> tuple[float, float]:
        """Where a taxel appears in its renderer [px]; that on the map nearest to the mouse."""
        if pick.where == "body":
            points = self._target(pick.part).positions[pick.taxel][None]
            places = project(self._body, points)
            return float(places[0, 0]), float(places[0, 1])
        assert self.scene.panel is not None
        renderer = self.scene.panel.renderer
        targets = self._map_targets(pick.part)
        uv = targets.uv[targets.taxels == pick.taxel]
        places = project(renderer, np.column_stack([uv, np.zeros(len(uv))]))
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
        if pick is None:
            if not add:
                self.clear()
            return
        self.choose(pick, reach, add=add)

    def choose(self, pick: Pick, reach: Reach, *, add: bool = False) -> None:
        """Choose a taxel, its module or patch, alone or beside what is chosen."""
        taxels = reached(self.skins[pick.part].mesh, pick.taxel, reach)
        if add:
            self.selection.toggle(pick.part, taxels)
        else:
            self.selection.replace(pick.part, taxels)
        self.refresh()

    def enclose(self, lasso: Lasso, *, add: bool) -> None:
        """Choose the taxels of the flat map within a lasso."""
        panel = self.scene.panel
        if panel is None:
            return
        taxels = self.enclosed(lasso, panel.part)
        if add:
            taxels = np.union1d(taxels, self.selection.taxels(panel.part))
            self.selection.set(panel.part, taxels)
        else:
            self.selection.replace(panel.part, taxels)
        self.refresh()

    def enclosed(self, lasso: Lasso, part: str) -> IntArray:
        """(k,) taxels whose place on the map, or one of them, lies within a lasso."""
        assert self.scene.panel is not None
        renderer = self.scene.panel.renderer
        targets = self._map_targets(part)
        places = project(renderer, np.column_stack([targets.uv, np.zeros(len(targets.uv))]))
        return np.unique(targets.taxels[lasso.holds(places + np.array(renderer.GetOrigin()))])

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

"""The camera's behaviour: it keeps the whole body in the picture and turns towards touches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from vtkmodules.vtkRenderingCore import vtkRenderer

from skinmap.arrays import FloatArray
from skinmap.errors import UnknownNameError
from viewer.drawing.body.occlusion import Blocks
from viewer.drawing.frame.camera import (
    Margins,
    Target,
    View,
    best_view,
    fit,
    project,
    sees,
    silhouette,
    still_view,
)
from viewer.drawing.words.label_places import Coverage

Mode = Literal["auto", "still", "free"]
BRIEF = 4  # pictures of a turning camera for which labels avoid the body where it was
THREE_QUARTER = 20.0  # the front view stands so far to the side [deg]
RISE = 8.0  # of the level views: feet and shoulders show their tops [deg]
TOP = 82.0  # straight down the picture would have no upright [deg]
AROUND = 0.06  # what is shown around a touch that is looked at [m]

# How far each view is turned from the robot's front, seen from above [deg], and its elevation.
PRESETS = {
    "front": (0.0, RISE),
    "back": (180.0, RISE),
    "left": (90.0, RISE),
    "right": (-90.0, RISE),
    "top": (0.0, TOP),
}


class Framing:
    """Keeps one renderer's camera on the body.

    Parameters
    ----------
    renderer : vtkRenderer
        Shows the body.
    body : Blocks
        All that can hide a touch; it follows the pose by itself.
    outline : callable
        Returns points (k, 3) that must be in the picture, where they are now [m].
    points : callable
        Returns points (n, 3) all over what is in the picture, where they are now [m].
    front : View
        Where to look from when nothing is touched.
    margins : Margins
        Space kept free around the body.
    mode : {"auto", "still", "free"}
        "auto" turns towards touches, "still" keeps its direction, "free" is led by the mouse.
    """

    def __init__(
        self,
        renderer: vtkRenderer,
        body: Blocks,
        outline: Callable[[], FloatArray],
        points: Callable[[], FloatArray],
        front: View,
        margins: Margins,
        mode: Mode,
    ) -> None:
        self.renderer, self.margins, self.mode = renderer, margins, mode
        self.front = self.view = self.goal = front
        self._body, self._outline, self._points = body, outline, points
        self._targets: Sequence[Target] = ()
        self._busy: Coverage | None = None
        self._turned = 0  # pictures since then in which the camera turned
        self._fitted: tuple[View, tuple[int, int]] | None = None

    def move(self) -> None:
        """The body moved: the camera stays, unless its picture would cut the body."""
        self._busy = None
        places = project(self.renderer, self._outline())
        size = self.renderer.GetSize()
        if ((places < 0) | (places > size)).any():
            self._fitted = None

    def aim(self, targets: Sequence[Target]) -> None:
        """Choose where to look from for these targets."""
        self._targets = targets
        if self.mode == "auto" and targets:
            self.goal = best_view(targets, self._body, self.front, self.goal)

    def settle(self) -> bool:
        """Turn to where most targets are seen, for a picture that stays; whether it turned."""
        if self.mode != "auto" or not self._targets:
            return False
        before = self.view
        self.view = self.goal = still_view(self._targets, self._body, self.front, self.goal)
        return self.view != before

    def look(self, view: View, mode: Mode) -> None:
        """Turn to a view, and go on in a mode."""
        self.view = self.goal = view
        self.mode = mode
        self._fitted = None

    def turn(self, step: float) -> None:
        """Turn by at most `step` [deg] towards the goal, the whole body in the picture."""
        if self.mode == "free":
            self._turned += 1
            return
        self.view = self.view.towards(self.goal, step)
        size = self.renderer.GetSize()
        if self._fitted == (self.view, size):
            return
        camera = self.renderer.GetActiveCamera()
        fit(camera, self.view, self._outline(), size, self.margins)
        self.renderer.ResetCameraClippingRange()
        self._fitted = self.view, size
        self._turned += 1

    def busy(self, *, moving: bool = False) -> Coverage:
        """Where the body is in the picture; while it moves, as it was a few pictures before."""
        size = self.renderer.GetSize()
        old = self._turned >= (BRIEF if moving else 1)
        if self._busy is None or old or self._busy.size != size:
            self._busy, self._turned = Coverage(project(self.renderer, self._points()), size), 0
        return self._busy

    def hidden(self, target: Target) -> bool:
        """Whether the camera does not see the middle of a target."""
        place = np.array(self.renderer.GetActiveCamera().GetPosition())
        way = place - target.points[target.middle]
        return not sees(self._body, target, way / np.linalg.norm(way))


def preset(name: str, front: View) -> View:
    """The view of a name; left and right are the robot's own.

    Parameters
    ----------
    name : str
        One of `PRESETS`.
    front : View
        The scene's three-quarter view.

    Raises
    ------
    UnknownNameError
        No such preset.
    """
    if name not in PRESETS:
        raise UnknownNameError("camera preset", name, PRESETS)
    turn, elevation = PRESETS[name]
    azimuth = (front.azimuth - THREE_QUARTER + turn + 180.0) % 360.0 - 180.0
    return View(azimuth, elevation)


def focus(framing: Framing, targets: Sequence[Target]) -> bool:
    """Bring touches close, seen from straight above them; False where there are none.

    The camera stays there until a key or the mouse moves it.
    """
    if not targets:
        return False
    normals = np.concatenate([target.normals for target in targets]).mean(axis=0)
    length = float(np.linalg.norm(normals))
    view = framing.view
    if length > 0.2:  # touches all round have no side
        n = normals / length
        azimuth = np.degrees(np.arctan2(n[1], n[0])) if np.hypot(n[0], n[1]) > 0.1 else view.azimuth
        view = View(float(azimuth), float(np.clip(np.degrees(np.arcsin(n[2])), -70.0, 70.0)))
    points = np.concatenate([target.points for target in targets])
    corners = np.array(np.meshgrid(*[[-AROUND, AROUND]] * 3)).reshape(3, -1).T
    around = silhouette((points[:, None] + corners).reshape(-1, 3))
    framing.look(view, "free")
    renderer = framing.renderer
    fit(renderer.GetActiveCamera(), view, around, renderer.GetSize(), framing.margins)
    renderer.ResetCameraClippingRange()
    return True

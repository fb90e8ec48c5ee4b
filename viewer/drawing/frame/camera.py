"""Where to look from: the whole body in the picture, from a side that shows the touches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from vtkmodules.vtkRenderingCore import vtkCamera, vtkRenderer

from skinmap.arrays import FloatArray
from skinmap.errors import check_known
from skinmap.geometry.triangles import unit
from viewer.drawing.words.labels import Coverage

VIEW_ANGLE = 22.0  # vertical [deg]: long enough a lens that limbs keep their proportions
AZIMUTHS = np.arange(-180.0, 180.0, 15.0)
ELEVATIONS = (12.0, 35.0, -10.0, 50.0)  # where a person beside the robot has their eyes
UNUSUAL = (-25.0, 70.0, -45.0)  # only for what is seen from none of these: soles, undersides
FLAT = 0.9  # mean cosine between the normals of a flat skin and their mean
FACING = 0.2  # cosine between a normal and the way to the camera: flatter is hard to see
CLEAR = 6e-3  # a ray starts this far above the taxel, clear of the cover it lies in [m]
FAR = 100.0  # what hides a taxel is nearer [m]
TURN_COST = 0.12  # of half a turn away from the front, in targets seen from straight above
RISE_COST = 0.8  # of 90 degrees up or down
RESTLESS = 0.15  # how much better a view must be to be worth turning to
HIDDEN = 0.15  # what a touch behind something else counts, against one in view

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


class Blocks(Protocol):
    """Anything that can stand between two points."""

    def blocks(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the segment between two points (3,) [m] is interrupted."""


@dataclass(frozen=True, slots=True)
class View:
    """A direction to look from.

    Attributes
    ----------
    azimuth, elevation : float
        Of the camera as seen from the body, about +z and above the ground [deg].
    """

    azimuth: float
    elevation: float

    @property
    def direction(self) -> FloatArray:
        """(3,) unit vector from the body to the camera."""
        a, e = np.radians(self.azimuth), np.radians(self.elevation)
        return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])

    def towards(self, goal: View, step: float) -> View:
        """The view `step` [deg] nearer to a goal, the short way round."""
        turn = (goal.azimuth - self.azimuth + 180.0) % 360.0 - 180.0
        rise = goal.elevation - self.elevation
        distance = float(np.hypot(turn, rise))
        share = 1.0 if distance <= step else step / distance
        azimuth = (self.azimuth + share * turn + 180.0) % 360.0 - 180.0
        return View(azimuth, self.elevation + share * rise)


@dataclass(frozen=True, eq=False, slots=True)
class Target:
    """Something to be seen: points (k, 3) [m] with normals (k, 3), and the one in the middle.

    `scale` is that of lifts on its skin.
    """

    points: FloatArray
    normals: FloatArray
    middle: int
    scale: float = 1.0


def front_view(normals: FloatArray) -> View:
    """A three-quarter view of the side on which most taxels with normals (n, 3) are seen.

    A flat skin that lies or leans is looked at from above it.
    """
    mean = unit(normals.sum(axis=0))
    flat = (normals @ mean).mean() > FLAT
    rise = float(np.clip(np.degrees(np.arcsin(mean[2])), 12.0, 50.0)) if flat else 12.0
    scores = [np.clip(normals @ View(a, rise).direction, 0.0, None).mean() for a in AZIMUTHS]
    return View(float(AZIMUTHS[int(np.argmax(scores))]) + 20.0, rise)


def sees(body: Blocks, target: Target, direction: FloatArray, facing: float = FACING) -> bool:
    """Whether the middle of a target faces a far camera in that direction and is not hidden.

    `facing` is the least cosine between them: of a view worth a turn, or 0 of any that shows it.
    """
    point, normal = target.points[target.middle], target.normals[target.middle]
    if normal @ direction <= facing:
        return False
    start = point + CLEAR * target.scale * normal
    return not body.blocks(start, start + FAR * direction)


def best_view(targets: Sequence[Target], body: Blocks, front: View, now: View) -> View:
    """The view in which all targets face the camera and are not hidden, near the front if equal.

    The view of now is kept unless another is clearly better: a camera that moves at each touch
    tires the eye.
    """

    def worth(view: View) -> float:
        direction = view.direction
        seen = 0.0
        for target in targets:
            facing = np.clip(target.normals @ direction, 0.0, None).mean()
            clear = sees(body, target, direction)
            seen += np.sqrt(facing) * (1.0 if clear else HIDDEN)
        return float(seen / max(len(targets), 1) - _turned(view, front))

    best = max([front, *_views(front, ELEVATIONS)], key=worth)
    if not any(sees(body, target, best.direction) for target in targets):
        best = max([best, *_views(front, UNUSUAL)], key=worth)
    restless = RESTLESS if _is_usual(now) or not _is_usual(best) else 0.0
    return best if worth(best) > worth(now) + restless else now


def _turned(view: View, front: View) -> float:
    """What a view costs: how far it is from the front."""
    turn = abs((view.azimuth - front.azimuth + 180.0) % 360.0 - 180.0) / 180.0
    return TURN_COST * turn + RISE_COST * abs(view.elevation - front.elevation) / 90.0


def _views(front: View, elevations: Sequence[float]) -> list[View]:
    """All round, at some heights."""
    return [View(front.azimuth + float(a), elevation) for elevation in elevations for a in AZIMUTHS]


def _is_usual(view: View) -> bool:
    return min(ELEVATIONS) <= view.elevation <= max(ELEVATIONS)


def still_view(targets: Sequence[Target], body: Blocks, front: View, now: View) -> View:
    """The view of a picture that stays: from where most targets are seen, nearest to the front.

    It stands at a natural height, unless no target is seen from any.

    Nothing moves in it, so that no turn is too far; the view of now is kept where no other shows
    more.
    """

    def seen(view: View) -> int:
        return sum(sees(body, target, view.direction) for target in targets)

    def faced(view: View) -> float:
        return float(sum(target.normals.mean(axis=0) @ view.direction for target in targets))

    views = _views(front, ELEVATIONS)
    counts = [seen(view) for view in views]
    usual = max(counts) > 0
    if not usual:
        views += _views(front, UNUSUAL)
        counts = [seen(view) for view in views]
    most = max(counts)
    if seen(now) >= most and (_is_usual(now) or not usual):
        return now
    best = [view for view, count in zip(views, counts, strict=True) if count == most]
    return max(best, key=lambda view: faced(view) / len(targets) - _turned(view, front))


def silhouette(points: FloatArray) -> FloatArray:
    """The points (k, 3) of (n, 3) that can lie on the outline from anywhere: their convex hull."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:  # fewer than four points, or all of them in one plane
        return points


def fit(
    camera: vtkCamera, view: View, points: FloatArray, size: tuple[int, int], margins: Margins
) -> None:
    """Place a camera so that all points (n, 3) [m] appear between the margins.

    Parameters
    ----------
    size : (int, int)
        Width and height of the renderer [px].
    margins : Margins
        Free space on each side.
    """
    forward = -view.direction
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    width, height = size
    focal = height / 2 / np.tan(np.radians(VIEW_ANGLE / 2))  # [px]
    room = np.array([width - margins.left - margins.right, height - margins.top - margins.bottom])
    aim = np.array([margins.left - margins.right, margins.bottom - margins.top]) / 2
    columns = np.ascontiguousarray(points.T)
    least, most = columns.min(axis=1), columns.max(axis=1)
    centre, distance = (least + most) / 2, 3.0 * float((most - least).max())
    axes = np.stack([right, up, forward])
    across, depth = axes[:2] @ columns, axes[2] @ columns
    for _ in range(6):  # perspective makes size and middle depend on each other; this converges
        middle = axes @ centre
        flat = focal * (across - middle[:2, None]) / (depth + (distance - middle[2]))
        low, high = flat.min(axis=1), flat.max(axis=1)
        shift = (low + high) / 2 * distance / focal
        centre = centre + shift[0] * right + shift[1] * up
        distance *= float(((high - low) / room).max())
    offset = aim * distance / focal
    centre = centre - offset[0] * right - offset[1] * up
    camera.SetViewAngle(VIEW_ANGLE)
    camera.SetFocalPoint(*centre)
    camera.SetPosition(*(centre - distance * forward))
    camera.SetViewUp(0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Margins:
    """Space kept free around the body [px]."""

    left: float
    right: float
    top: float
    bottom: float


def look_down(renderer: vtkRenderer, middle: FloatArray, metres: float) -> None:
    """Show a flat thing, a place (2,) [m] of it in the middle, where a pixel is `metres` wide."""
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(middle[0], middle[1], 0.0)
    camera.SetPosition(middle[0], middle[1], 1.0)
    camera.SetViewUp(0.0, 1.0, 0.0)
    camera.SetParallelScale(renderer.GetSize()[1] * metres / 2)
    camera.SetClippingRange(0.5, 1.5)


def project(renderer: vtkRenderer, points: FloatArray) -> FloatArray:
    """(n, 2) places of world points (n, 3) [m] in the renderer's picture [px], y upwards."""
    T = projection(renderer)
    x, y, w = T[[0, 1, 3], :3] @ points.T + T[[0, 1, 3], 3:]
    size = np.array(renderer.GetSize())
    return np.asarray((np.stack([x, y], axis=1) / w[:, None] + 1.0) / 2.0 * size)


def projection(renderer: vtkRenderer, nearest: float = -1.0) -> FloatArray:
    """(4, 4) from world points [m] to the picture, both sides of which are 1 from its middle.

    Depths run from `nearest` to 1.
    """
    width, height = renderer.GetSize()
    matrix = renderer.GetActiveCamera().GetCompositeProjectionTransformMatrix(
        width / height, nearest, 1.0
    )
    return np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])


def world_points(renderer: vtkRenderer, x: float, y: float) -> tuple[FloatArray, FloatArray]:
    """World points (3,) [m] that a pixel of the window shows nearest and furthest."""
    left, bottom = renderer.GetOrigin()
    width, height = renderer.GetSize()
    u, v = 2.0 * (x - left) / width - 1.0, 2.0 * (y - bottom) / height - 1.0
    corners = np.array([[u, v, -1.0, 1.0], [u, v, 1.0, 1.0]])
    near, far = np.linalg.solve(projection(renderer), corners.T).T
    return near[:3] / near[3], far[:3] / far[3]


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

    def covers(self, place: FloatArray) -> bool:
        """Whether a ray through a place (2,) of the picture [px] meets the body."""
        start = np.array(self.renderer.GetActiveCamera().GetPosition())
        share = 2.0 * place / np.array(self.renderer.GetSize()) - 1.0
        far = np.linalg.inv(projection(self.renderer)) @ np.array([*share, 1.0, 1.0])
        return self._body.blocks(start, far[:3] / far[3])

    def hidden(self, target: Target) -> bool:
        """Whether the camera does not see the middle of a target."""
        place = np.array(self.renderer.GetActiveCamera().GetPosition())
        way = place - target.points[target.middle]
        return not sees(self._body, target, way / np.linalg.norm(way), 0.0)


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
    check_known("camera preset", [name], PRESETS)
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

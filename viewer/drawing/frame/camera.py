"""Where to look from: the whole body in the picture, from a side that shows the touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from vtkmodules.vtkRenderingCore import vtkCamera, vtkRenderer

from skinmap.arrays import FloatArray
from viewer.drawing.body.occlusion import Blocks

VIEW_ANGLE = 22.0  # vertical [deg]: long enough a lens that limbs keep their proportions
AZIMUTHS = np.arange(-180.0, 180.0, 15.0)
ELEVATIONS = (12.0, 35.0, -10.0, 50.0)  # where a person beside the robot has their eyes
UNUSUAL = (-25.0, 70.0, -45.0)  # only for what is seen from none of these: soles, undersides
FACING = 0.2  # cosine between a normal and the way to the camera: flatter is not seen
CLEAR = 6e-3  # a ray starts this far above the taxel, clear of the cover it lies in [m]
TURN_COST = 0.12  # of half a turn away from the front, in targets seen from straight above
RISE_COST = 0.8  # of 90 degrees up or down
RESTLESS = 0.15  # how much better a view must be to be worth turning to
HIDDEN = 0.15  # what a touch behind something else counts, against one in view


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
    """Something to be seen: points (k, 3) [m] with normals (k, 3), and the one in the middle."""

    points: FloatArray
    normals: FloatArray
    middle: int


def front_view(normals: FloatArray) -> View:
    """A three-quarter view of the side on which most taxels with normals (n, 3) are seen."""
    scores = [np.clip(normals @ View(a, 12.0).direction, 0.0, None).mean() for a in AZIMUTHS]
    return View(float(AZIMUTHS[int(np.argmax(scores))]) + 20.0, 12.0)


def sees(body: Blocks, target: Target, direction: FloatArray) -> bool:
    """Whether the middle of a target faces a far camera in that direction and is not hidden."""
    point, normal = target.points[target.middle], target.normals[target.middle]
    if normal @ direction < FACING:
        return False
    start = point + CLEAR * normal
    return not body.blocks(start, start + 3.0 * direction)


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
        turn = abs((view.azimuth - front.azimuth + 180.0) % 360.0 - 180.0) / 180.0
        rise = abs(view.elevation - front.elevation) / 90.0
        return float(seen / max(len(targets), 1) - TURN_COST * turn - RISE_COST * rise)

    best = max([front, *_views(front, ELEVATIONS)], key=worth)
    if not any(sees(body, target, best.direction) for target in targets):
        best = max([best, *_views(front, UNUSUAL)], key=worth)
    restless = RESTLESS if _is_usual(now) or not _is_usual(best) else 0.0
    return best if worth(best) > worth(now) + restless else now


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

    def turned(view: View) -> float:
        turn = abs((view.azimuth - front.azimuth + 180.0) % 360.0 - 180.0) / 180.0
        return TURN_COST * turn + RISE_COST * abs(view.elevation - front.elevation) / 90.0

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
    return max(best, key=lambda view: faced(view) / len(targets) - turned(view))


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


def project(renderer: vtkRenderer, points: FloatArray) -> FloatArray:
    """(n, 2) places of world points (n, 3) [m] in the renderer's picture [px], y upwards."""
    width, height = renderer.GetSize()
    matrix = renderer.GetActiveCamera().GetCompositeProjectionTransformMatrix(
        width / height, -1.0, 1.0
    )
    T = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    x, y, w = T[[0, 1, 3], :3] @ points.T + T[[0, 1, 3], 3:]
    size = np.array([width, height])
    return np.asarray((np.stack([x, y], axis=1) / w[:, None] + 1.0) / 2.0 * size)

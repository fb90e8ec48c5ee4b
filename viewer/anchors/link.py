"""The link of the calibration view: its mesh, the patch laid on it, anchors, places to measure."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv

from calibration.commands.anchor_session import AnchorSession
from calibration.commands.results import MM
from skinmap.arrays import FloatArray
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.triangles import face_normals, unit
from viewer.anchors.marks import (
    ANCHOR,
    CHOSEN,
    NEXT,
    Limits,
    Marks,
    Names,
    channels,
    paint,
    ranked,
    round_limits,
)
from viewer.colours import BODY
from viewer.drawing.frame.polydata import make_mesh

FEATURE_ANGLE = 35.0  # sharper edges stay sharp [deg]
LIFT = 2.0e-3  # of the patch above its taxels [m]: covers lie up to 1 mm above taxels
DISC, RING, BALL = 0.42, 0.75, 0.30  # radii in pitches
TURNED = np.radians([25.0, 20.0])  # the first view looks from beside and above, not flat on
AWAY = 2.6  # of the camera, in lengths of what it looks at
NO_POINT: FloatArray = np.zeros((0, 3))


class LinkPicture:
    """The link in a plotter's active renderer.

    Parameters
    ----------
    plotter : pyvista.Plotter
    session : AnchorSession
    font_px : int
        Height of the letters [px].
    """

    def __init__(self, plotter: pv.Plotter, session: AnchorSession, font_px: int) -> None:
        import igl

        self.session = session
        self.renderer = plotter.renderer
        self.vertices = np.ascontiguousarray(session.link[0], np.float64)
        self.faces = np.ascontiguousarray(session.link[1], np.int64)
        self._tree = igl.AABB()
        self._tree.init(self.vertices, self.faces)
        self.normals = face_normals(self.vertices, self.faces)
        self.pitch = median_spacing(session.board.layout)
        body = pv.Actor(mapper=pv.DataSetMapper(_smooth(self.vertices, self.faces)))
        body.prop.color = BODY
        body.prop.ambient, body.prop.diffuse = 0.35, 0.65
        plotter.add_actor(body, reset_camera=False, render=False)
        self.patch = Marks(plotter)
        self.lines = Marks(plotter, NEXT, width=3.0)
        self.following = Marks(plotter, NEXT)
        self.chosen = Marks(plotter, CHOSEN)
        self.balls = Marks(plotter, ANCHOR)
        self.names = Names(self.renderer, font_px, ANCHOR)
        self.next_names = Names(self.renderer, font_px, NEXT)

    def show(self) -> Limits | None:
        """Draw what the session has now; the limits of the scale [mm], None without a patch."""
        session, found = self.session, self.session.found
        points = session.task().points if session.anchors else NO_POINT
        radius = BALL * self.pitch
        known = [anchor.taxel for anchor in session.anchors]
        out = self._outward(points)
        if found is not None:  # above the patch, which is drawn above its taxels
            points = points + 1.2 * LIFT * found.normals[known]
        self.balls.show(_balls(points, radius))
        self.names.show(channels(session), points, out)
        chosen = session.point
        self.chosen.show(None if chosen is None else _balls(chosen[None], 1.3 * radius))
        if found is None:
            for marks in (self.patch, self.lines, self.following):
                marks.show(None)
            self.next_names.show([], NO_POINT)
            return None
        limits = round_limits(MM * found.predicted_sd)
        high = found.positions + LIFT * found.normals
        self.patch.discs(
            high, found.normals, DISC * self.pitch, paint(MM * found.predicted_sd, limits)
        )
        self.lines.segments(points, found.positions[known] + 1.2 * LIFT * found.normals[known])
        after = found.next_taxels
        self.following.rings(
            high[after] + 0.5 * LIFT * found.normals[after],
            found.normals[after],
            RING * self.pitch,
            0.3,
        )
        self.next_names.show(ranked(session, after), high[after], found.normals[after])
        return limits

    def pick(self, x: float, y: float) -> tuple[FloatArray, int] | None:
        """The point (3,) [m] and face of the link under a pixel; None beside it."""
        near, far = self._ray(x, y)
        face, share, _ = self._tree.intersect_ray_first(
            self.vertices, self.faces, near[None], (far - near)[None]
        )
        if face[0] < 0:
            return None
        return near + float(share[0]) * (far - near), int(face[0])

    def _outward(self, points: FloatArray) -> FloatArray:
        """(k, 3) normals of the link nearest to some points (k, 3)."""
        if len(points) == 0:
            return NO_POINT
        _, face, _ = self._tree.squared_distance(self.vertices, self.faces, points)
        return np.asarray(self.normals[np.asarray(face)])

    def _ray(self, x: float, y: float) -> tuple[FloatArray, FloatArray]:
        """The points (3,) of a pixel on the near and far end of what the camera sees [m]."""
        ends = []
        for depth in (0.0, 1.0):
            self.renderer.SetDisplayPoint(x, y, depth)
            self.renderer.DisplayToWorld()
            place = np.array(self.renderer.GetWorldPoint())
            ends.append(place[:3] / place[3])
        return ends[0], ends[1]

    def look(self) -> None:
        """Turn to the patch, or where there is none yet to the link, from where the anchors are."""
        found, anchors = self.session.found, self.session.anchors
        points, out = self.vertices, np.array([1.0, 0.0, 0.3])
        if found is not None:
            points, out = found.positions, found.normals.mean(axis=0)
        elif anchors:
            out = self.session.task().points.mean(axis=0) - self.vertices.mean(axis=0)
        _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        out = unit(out if np.linalg.norm(out) > 1e-9 else axes[-1])
        up = axes[0] - (axes[0] @ out) * out
        up = unit(up if np.linalg.norm(up) > 0.1 else np.cross(out, axes[1]))
        up = up * (np.sign(up[np.argmax(np.abs(up))]) or 1.0)
        side = np.cross(up, out)
        beside, above = np.tan(TURNED)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        camera: Any = self.renderer.GetActiveCamera()
        camera.SetFocalPoint(*middle)
        camera.SetPosition(*(middle + AWAY * size * unit(out + beside * side + above * up)))
        camera.SetViewUp(*up)
        self.renderer.ResetCameraClippingRange()


def _smooth(vertices: FloatArray, faces: Any) -> pv.PolyData:
    """The link as it came, shaded smoothly; picks go to the same triangles."""
    surface = make_mesh(vertices, faces).clean(point_merging=True)
    return surface.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=FEATURE_ANGLE,
        consistent_normals=False,
    )  # fmt: skip


def _balls(places: FloatArray, radius: float) -> pv.PolyData | None:
    if len(places) == 0:
        return None
    ball = pv.Sphere(radius=radius, theta_resolution=16, phi_resolution=12)
    corners = np.asarray(ball.points)
    triangles = np.asarray(ball.regular_faces, np.int64)
    k = np.arange(len(places))[:, None, None] * len(corners)
    points = (places[:, None] + corners[None]).reshape(-1, 3)
    return make_mesh(points, (triangles[None] + k).reshape(-1, 3))

"""The bare body in its renderer: one actor for each link, moved by joint angles.

Meshes stay as they are loaded; joint angles change a matrix for each link. Each link has a good
mesh for a picture that rests, and a quick one for while it moves.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkDataSetMapper

from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.skin.robot import Robot
from viewer.drawing.body.bare_body import Links, check_links, drawable
from viewer.drawing.body.occlusion import Occluders
from viewer.drawing.body.shading import shade
from viewer.drawing.frame.camera import View, front_view, silhouette
from viewer.drawing.skin.skin_layer import SkinLayer

GOOD_PX, QUICK_PX = 1.5, 13.0  # side of a cell within which vertices become one [px]
FINEST = 0.5e-3  # and no smaller [m]: a close-up of a hand shows no more
BEHIND = 1.0e-3  # the body is drawn this far behind its place: no cover tears the skin on it [m]
QUICK_BEHIND = 0.6  # the same for quick meshes, in their cells
EVERY = 7  # one point of so many is enough to say where the body is in the picture, but of a
SMALL = 1000  # mesh with fewer


class BodyView:
    """Links of a robot, drawn.

    Parameters
    ----------
    plotter : pyvista.Plotter
        Its active renderer shows them.
    robot : Robot
    links : iterable of str, "all" or "skin", optional
        All that have a mesh by default; no other link is read.
    poses : mapping of str to (4, 4) float
        T_root_link.
    parts : iterable of str
        Parts shown: "skin" takes the links that carry them.
    """

    def __init__(
        self,
        plotter: pv.Plotter,
        robot: Robot,
        links: Links,
        poses: Mapping[str, FloatArray],
        parts: tuple[str, ...] = (),
    ) -> None:
        self.robot, self.poses = robot, poses
        self.links = check_links(robot, links, parts)
        corners = {link: box_corners(robot.mesh(link).vertices) for link in self.links}
        self._pixel = _size(corners, poses) / min(plotter.window_size)
        self.meshes = {link: self._reduced(link, GOOD_PX) for link in self.links}
        self._good = {link: _mapper(mesh) for link, mesh in self.meshes.items()}
        # Kept: PyVista would wrap a mesh that nobody holds whenever its mapper is asked for it.
        self._coarse: dict[str, pv.PolyData] = {}
        self._quick: dict[str, vtkDataSetMapper] = {}
        if not plotter.off_screen:
            # A still never needs them; a window at the first turn, which they would hold up then.
            self._make_quick()
        self.actors = {link: pv.Actor(mapper=self._good[link]) for link in self.links}
        self.quick = False
        for actor in self.actors.values():
            shade(actor, behind=BEHIND)
            plotter.add_actor(actor, reset_camera=False, render=False)
        self.occluders = Occluders(self.meshes, poses)
        self._outlines: dict[str, FloatArray] = {}
        self._placed: dict[str, FloatArray] = {}  # points where they are now
        self.move(poses)

    def _reduced(self, link: str, cell_px: float) -> pv.PolyData:
        return drawable(self.robot.mesh(link), cell=max(cell_px * self._pixel, FINEST))

    def _make_quick(self) -> None:
        self._coarse = {link: self._reduced(link, QUICK_PX) for link in self.links}
        self._quick = {link: _mapper(mesh) for link, mesh in self._coarse.items()}

    def move(self, poses: Mapping[str, FloatArray]) -> None:
        """Place the links by poses (4, 4)."""
        self.poses = poses
        self._placed.clear()
        self.occluders.place(poses)
        for link, actor in self.actors.items():
            actor.user_matrix = poses[link]

    def detail(self, quick: bool) -> None:
        """Draw quick meshes, for while the picture moves, or good ones."""
        if quick == self.quick:
            return
        self.quick = quick
        if quick and not self._quick:
            self._make_quick()
        behind = max(BEHIND, QUICK_BEHIND * QUICK_PX * self._pixel) if quick else BEHIND
        for link, actor in self.actors.items():
            actor.SetMapper((self._quick if quick else self._good)[link])
            shade(actor, behind=behind)

    def points(self, layers: Mapping[str, SkinLayer]) -> FloatArray:
        """(n, 3) points all over body and skins, as they stand now [m]."""
        if "all" in self._placed:
            return self._placed["all"]
        links = [
            transform_points(self.poses[link], thinned(mesh.points))
            for link, mesh in self.meshes.items()
        ]
        skins = [transform_points(self.poses[x.skin.link], x.points) for x in layers.values()]
        self._placed["all"] = np.concatenate([*links, *skins, np.zeros((0, 3))])
        return self._placed["all"]

    def outline(self, layers: Mapping[str, SkinLayer], *, close: bool = False) -> FloatArray:
        """(k, 3) points that can lie on the outline of body and skins from anywhere [m].

        With `close`, of the links that carry the skins alone.
        """
        if not self._outlines:
            for link, mesh in self.meshes.items():
                self._outlines[link] = silhouette(thinned(mesh.points))
            for part, layer in layers.items():
                self._outlines[f"{layer.skin.link}/{part}"] = silhouette(layer.points)
        if "outline" not in self._placed:
            carriers = {layer.skin.link for layer in layers.values()}
            self._placed["outline"] = np.concatenate(
                [
                    transform_points(self.poses[k.split("/")[0]], p)
                    for k, p in self._outlines.items()
                    if not close or k.split("/")[0] in carriers
                ]
            )
        return self._placed["outline"]

    def front(self, layers: Mapping[str, SkinLayer]) -> View:
        """From where most of the skin is seen."""
        normals = [
            transform_directions(self.poses[layer.skin.link], layer.skin.normals)
            for layer in layers.values()
        ]
        return front_view(np.concatenate([np.zeros((1, 3)), *normals]))


def thinned(points: FloatArray) -> FloatArray:
    """Some of the points (n, 3) of a mesh, all of a small one: each may be a corner."""
    return np.asarray(points[:: EVERY if len(points) > SMALL else 1], np.float64)


def _mapper(mesh: pv.PolyData) -> vtkDataSetMapper:
    mapper = vtkDataSetMapper()  # PyVista's own makes a table of colours for each
    mapper.SetInputData(mesh)
    mapper.SetScalarVisibility(False)
    return mapper


def box_corners(points: FloatArray) -> FloatArray:
    """(8, 3) corners of the box around points (n, 3); none around none."""
    if not len(points):
        return np.zeros((0, 3))
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T


def _size(corners: Mapping[str, FloatArray], poses: Mapping[str, FloatArray]) -> float:
    """Largest side of the box around placed corners [m]; 1 without any."""
    placed = [transform_points(poses[link], points) for link, points in corners.items()]
    points = np.concatenate([*placed, np.zeros((0, 3))])
    return float(np.ptp(points, axis=0).max()) if len(points) else 1.0

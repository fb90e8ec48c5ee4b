"""The bare body in its renderer: one actor for each link, moved by joint angles.

Meshes stay as they are loaded; joint angles change a matrix for each link. Each link has a good
mesh for a picture that rests, and a quick one for while it moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonCore import mutable
from vtkmodules.vtkCommonDataModel import vtkPolyData, vtkStaticCellLocator
from vtkmodules.vtkRenderingCore import vtkDataSetMapper

from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.skin.robot import Robot
from viewer.colours import BODY
from viewer.drawing.body.bare_body import Links, check_links, drawable
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
        self._outlines: list[tuple[str, FloatArray]] = []
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
            links = [(link, thinned(mesh.points)) for link, mesh in self.meshes.items()]
            skins = [(layer.skin.link, layer.points) for layer in layers.values()]
            self._outlines = [(link, silhouette(points)) for link, points in (*links, *skins)]
        if "outline" not in self._placed:
            carriers = {layer.skin.link for layer in layers.values()}
            self._placed["outline"] = np.concatenate(
                [
                    transform_points(self.poses[link], points)
                    for link, points in self._outlines
                    if not close or link in carriers
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


# What stands in the way: rays against the links, which move with the joints.
#
# Each link keeps one search structure in its own frame, so that a new pose costs nothing.


class Surface:
    """One surface that does not move."""

    def __init__(self, surface: vtkPolyData) -> None:
        self._surface = surface
        self._locator: vtkStaticCellLocator | None = None  # made when first asked

    def blocks(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the segment between two points (3,) meets the surface."""
        if self._locator is None:
            self._locator = vtkStaticCellLocator()
            self._locator.SetDataSet(self._surface)
            self._locator.BuildLocator()
        # Typed by VTK as plain numbers, which it could not write to.
        distance: Any = mutable(0.0)
        sub: Any = mutable(0)
        cell: Any = mutable(0)
        hit, local = [0.0] * 3, [0.0] * 3
        return bool(
            self._locator.IntersectWithLine(
                start.tolist(), end.tolist(), 1e-6, distance, hit, local, sub, cell
            )
        )


class Occluders:
    """The links of a body.

    Parameters
    ----------
    meshes : mapping of str to pyvista.PolyData
        In the frame of each link [m].
    poses : mapping of str to (4, 4) float
        T_root_link of each.
    """

    def __init__(self, meshes: Mapping[str, pv.PolyData], poses: Mapping[str, FloatArray]) -> None:
        meshes = {link: mesh for link, mesh in meshes.items() if mesh.n_cells}
        self.links = tuple(meshes)
        self._surfaces = [Surface(mesh) for mesh in meshes.values()]
        bounds = np.array([mesh.bounds for mesh in meshes.values()]).reshape(-1, 3, 2)
        self._centres = bounds.mean(axis=2)
        self._radii = np.linalg.norm(np.ptp(bounds, axis=2), axis=1) / 2
        self.place(poses)

    def place(self, poses: Mapping[str, FloatArray]) -> None:
        """Move the links."""
        T = np.array([poses[link] for link in self.links]).reshape(-1, 4, 4)
        self._to_link = np.linalg.inv(T)
        self._middles = np.einsum("kij,kj->ki", T[:, :3, :3], self._centres) + T[:, :3, 3]

    def blocks(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the segment between two points (3,) [m] meets any link."""
        way = end - start
        share = (self._middles - start) @ way / max(float(way @ way), 1e-12)
        nearest = start + np.clip(share, 0.0, 1.0)[:, None] * way
        near = np.linalg.norm(self._middles - nearest, axis=1) <= self._radii
        for k in np.flatnonzero(near):
            T = self._to_link[k]
            if self._surfaces[k].blocks(T[:3, :3] @ start + T[:3, 3], T[:3, :3] @ end + T[:3, 3]):
                return True
        return False


# How the body is shaded: as cheaply as software rendering allows.
#
# VTK's own light loop and its depth offset cost as much as the rest of a link together: the offset
# is written for each pixel, which rules out testing depth before shading. Here two fixed lights
# take two dot products, and the body is pushed back for each vertex.

AMBIENT = 0.25
DIFFUSE = 0.75
HEADLIGHT, FILL = 0.8, 0.35  # strengths of both lights
FILL_FROM = (-0.6, 1.2, 1.0)  # above the left shoulder of who looks: right, up, towards the eye
PUSH = """//VTK::PositionVC::Impl
  // The projection's third row is a times its fourth, but for the constant b: depth is a + b / w
  // with the distance w, so that moving back by d gives a + b / (w + d).
  vec3 awayPB = vec3(MCDCMatrix[0][3], MCDCMatrix[1][3], MCDCMatrix[2][3]);
  vec3 depthPB = vec3(MCDCMatrix[0][2], MCDCMatrix[1][2], MCDCMatrix[2][2]);
  float aPB = dot(depthPB, awayPB) / max(dot(awayPB, awayPB), 1.0e-12);
  float bPB = gl_Position.z - aPB * gl_Position.w;
  gl_Position.z = (aPB + bPB / (gl_Position.w + %.6f)) * gl_Position.w;
"""
# In the place of all of VTK's own lines there: the last of them discards what has no opacity, and
# a shader that may discard has its depth written late.
LIGHT = """  float headSB = max(0.0, normalVCVSOutput.z);
  float fillSB = max(0.0, dot(normalVCVSOutput, vec3(%.6f, %.6f, %.6f)));
  gl_FragData[0] = vec4(ambientColor + (%.6f * headSB + %.6f * fillSB) * diffuseColor, opacity);
"""


FLAT = "  gl_FragData[0] = vec4(ambientColor + diffuseColor, opacity);\n"


def shade(actor: pv.Actor, *, behind: float) -> None:
    """Give an actor the body's look.

    Parameters
    ----------
    actor : pyvista.Actor
        Of a mesh with normals.
    behind : float
        How far behind its place it is drawn [m]: skin that lies on it stays whole.
    """
    actor.prop.color = BODY
    actor.prop.ambient, actor.prop.diffuse, actor.prop.specular = AMBIENT, DIFFUSE, 0.0
    actor.prop.culling = "back"
    shader: Any = actor.GetShaderProperty()
    shader.ClearAllShaderReplacements()
    shader.AddVertexShaderReplacement("//VTK::PositionVC::Impl", True, PUSH % behind, False)
    light(actor)


def light(actor: pv.Actor) -> None:
    """Light an actor that has normals by the two fixed lights."""
    fill = np.array(FILL_FROM) / np.linalg.norm(FILL_FROM)
    _colour_pixels(actor, LIGHT % (*fill, HEADLIGHT, FILL))


def flat(actor: pv.Actor) -> None:
    """Show an opaque actor without lighting in its own colours."""
    _colour_pixels(actor, FLAT)


def _colour_pixels(actor: pv.Actor, code: str) -> None:
    shader: Any = actor.GetShaderProperty()
    shader.AddFragmentShaderReplacement("//VTK::Light::Impl", True, code, False)

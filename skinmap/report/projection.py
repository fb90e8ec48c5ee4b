"""Pictures of surfaces without OpenGL: a parallel projection drawn back to front."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.flat.atlas import limb_frame
from skinmap.geometry.triangles import face_areas, face_normals
from skinmap.surface.surface_mesh import SurfaceMesh

LIGHT = np.array([-0.35, 0.55, 0.76])  # over the left shoulder: right, up, towards the viewer
AMBIENT = 0.55  # share of the light that comes from everywhere
SEEN = 0.3  # cosine: flatter triangles are seen as slivers, another view has to show them
ENOUGH = 0.92  # share of the area that the views of one picture show together
MAX_VIEWS = 3


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """Where one looks from.

    Attributes
    ----------
    name : str
    out : (3,) float
        Unit, from the surface towards the viewer.
    up : (3,) float
        Unit, square to it.
    """

    name: str
    out: FloatArray
    up: FloatArray

    def project(self, points: FloatArray) -> FloatArray:
        """(..., 3) right, up and towards the viewer, of points (..., 3)."""
        return np.asarray(points @ np.stack([np.cross(self.up, self.out), self.up, self.out]).T)


def choose_views(vertices: FloatArray, faces: IntArray, frame: FloatArray) -> list[View]:
    """As few views as show nearly all of a surface, the one with most first.

    Parameters
    ----------
    vertices : (n, 3) array of float
    faces : (m, 3) array of int
    frame : (3, 3) array of float
        Rows: up, the way that the surface looks, and the third direction.
    """
    up, front, side = frame
    turns = np.radians(np.arange(0, 360, 45))
    candidates = [
        View(_turned(turn), np.cos(turn) * front + np.sin(turn) * side, up) for turn in turns
    ]
    candidates += [View("from above", up, -front), View("from below", -up, front)]
    normals, area = face_normals(vertices, faces), face_areas(vertices, faces)
    shown = np.zeros(len(faces), bool)
    views: list[View] = []
    while len(views) < MAX_VIEWS and area[shown].sum() < ENOUGH * area.sum():
        facing = [np.where(shown, 0.0, np.maximum(normals @ view.out, 0.0)) for view in candidates]
        gains = np.array([area @ cosine for cosine in facing]) / area.sum()
        best = candidates.pop(int(np.argmax(np.round(gains, 6))))
        shown |= normals @ best.out > SEEN
        views.append(best)
    return views


def mesh_views(mesh: SurfaceMesh) -> list[View]:
    """The views that show a part, seen as its limb stands."""
    frame = limb_frame(mesh.vertices, mesh.faces, mesh.skin.up)
    return choose_views(mesh.vertices, mesh.faces, frame)


def _turned(turn: float) -> str:
    return "front" if turn == 0 else f"turned by {np.degrees(turn):.0f}\N{DEGREE SIGN}"


def draw_surface(
    axis: Any,
    view: View,
    polygons: Sequence[FloatArray] | FloatArray,
    normals: FloatArray,
    colours: FloatArray,
    *,
    both_sides: bool = False,
) -> None:
    """Draw flat polygons, those behind first, darker where they look aside.

    Parameters
    ----------
    axis : matplotlib axes
    view : View
    polygons : sequence of (k, 3) array of float
    normals : (m, 3) array of float
        Unit; polygons that look away are left out unless `both_sides`.
    colours : (m, 4) array of float
    """
    from matplotlib.collections import PolyCollection

    seen = np.arange(len(polygons)) if both_sides else np.flatnonzero(normals @ view.out > 0.0)
    chosen = [polygons[k] for k in seen.tolist()]
    sizes = np.array([len(polygon) for polygon in chosen], np.int64)
    ends = np.cumsum(sizes)
    places = view.project(np.concatenate([np.zeros((0, 3)), *chosen]))
    depth = np.bincount(np.repeat(np.arange(len(chosen)), sizes), places[:, 2]) / sizes
    order = np.argsort(depth, kind="stable")
    paint = shaded(colours[seen], view.project(normals[seen]))
    axis.add_collection(
        PolyCollection(
            [places[ends[k] - sizes[k] : ends[k], :2] for k in order],
            facecolors=paint[order],
            edgecolors="face",
            linewidths=0.2,
        )
    )


def shaded(colours: FloatArray, normals: FloatArray) -> FloatArray:
    """Colours (m, 4) under Lambert's law for normals (m, 3) as the viewer sees them."""
    light = np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    dark = np.array(colours)
    dark[:, :3] *= (AMBIENT + (1.0 - AMBIENT) * light)[:, None]
    return dark


def visible(view: View, vertices: FloatArray, faces: IntArray, count: int) -> BoolArray:
    """(count,) whether each vertex belongs to a face that looks towards the viewer."""
    seen = np.zeros(count, bool)
    seen[faces[face_normals(vertices, faces) @ view.out > 0.0].ravel()] = True
    return seen

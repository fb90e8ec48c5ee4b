"""The skin of one part on the body: a coloured sheet with an edge, and a mark for each taxel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.topology import border_edges, edges
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh
from viewer.drawing.frame.polydata import make_mesh
from viewer.drawing.skin.draw_positions import LIFT, Places, body_places
from viewer.drawing.skin.refinement import FineSurface, means, refine
from viewer.layers import check_values

LINE_LIFT = 0.9e-3  # outlines above the sheet [m]
BACK = 1.0e-3  # the sheet's back below its front [m]
EDGE_DEPTH = 5.0e-3  # how far the sheet's edge reaches down to the body [m]
HALF = 0.5  # share of a vertex's value that must be known for it to be drawn


@dataclass(eq=False, slots=True)
class SkinLayer:
    """What is drawn of one part, in the frame of its link.

    Attributes
    ----------
    mesh : SurfaceMesh
    fine : FineSurface
        v vertices.
    places : Places
        Where it is drawn.
    shell : pyvista.PolyData
        Its edge and back.
    edge : pyvista.PolyData
        Its edge alone, as coarse as the taxels: for while the picture moves.
    border : (b, 2) int
        Border edges of the sheet.
    beside : (n, n) sparse
        Mean of each taxel and of those beside it.
    soft : (v, n) sparse
        As `fine.smooth`, each taxel averaged with its neighbours first: for calm outlines.
    pressures : (n,) float
        What is felt now, 0 to 255 counts; NaN where nothing is known, as of mute taxels.
    """

    mesh: SurfaceMesh
    fine: FineSurface
    places: Places
    shell: pv.PolyData
    edge: pv.PolyData
    border: IntArray
    beside: csr_array
    soft: csr_array
    pressures: FloatArray

    @property
    def skin(self) -> Skin:
        """The taxels."""
        return self.mesh.skin

    @property
    def points(self) -> FloatArray:
        """(v, 3) vertices of the sheet as drawn [m]."""
        return self.places.points

    def field(self, values: FloatArray) -> FloatArray:
        """(v,) values (n,) carried to the sheet's vertices; NaN where too little is known."""
        known = np.isfinite(values)
        if known.all():
            return np.asarray(self.fine.smooth @ values)
        # Straight edges here: the weights of the curved ones may be negative.
        share = self.fine.linear @ known.astype(np.float64)
        total = self.fine.linear @ np.where(known, values, 0.0)
        enough = share >= HALF
        return np.where(enough, total / np.where(enough, share, 1.0), np.nan)

    def set_pressures(self, pressures: ArrayLike) -> None:
        """Take pressures (n,) of 0 to 255 counts."""
        self.pressures = check_values(pressures, len(self.skin), self.skin.part)


def build_layer(mesh: SurfaceMesh, *, levels: int = 1) -> SkinLayer:
    """Sheet, edge and marks for one part's surface mesh."""
    fine = refine(mesh, levels)
    places = body_places(mesh, fine)
    beside = neighbour_mean(mesh)
    return SkinLayer(
        mesh,
        fine,
        places,
        underside(places, fine),
        underside(places, fine, quick=True),
        border_edges(fine.faces),
        beside,
        fine.smooth @ beside,
        np.zeros(len(mesh.skin)),
    )


def neighbour_mean(mesh: SurfaceMesh) -> csr_array:
    """(n, n) mean of each taxel and the ends of the mesh edges that leave it; rows sum to 1."""
    n = len(mesh.skin)
    a, b = edges(mesh.faces).T
    taxel = np.arange(n)
    row, column = np.concatenate([a, b, taxel]), np.concatenate([b, a, mesh.representative])
    return means(row, column, (n, n))


def underside(places: Places, fine: FineSurface, *, quick: bool = False) -> pv.PolyData:
    """Edge and back of the sheet: they make it look solid, and hide its colours from behind.

    The edge reaches from the border down to the body; the back is the unrefined mesh. The quick
    one is an edge of the unrefined mesh without a back: where a body is drawn, it hides the back.
    """
    points, faces = places.points, fine.coarse if quick else fine.faces
    used, number = np.unique(border_edges(faces), return_inverse=True)
    a, b = number.reshape(-1, 2).T
    n = len(used)
    edge = np.concatenate([np.stack([a, a + n, b + n], axis=1), np.stack([a, b + n, b], axis=1)])
    low = points[used] - EDGE_DEPTH * places.scale * fine.normals[used]
    if quick:
        return make_mesh(np.concatenate([points[used], low]), edge)
    k = len(fine.taxels)
    behind = fine.positions[:k] + (LIFT - BACK) * places.scale * fine.normals[:k]
    faces = np.concatenate([edge, fine.coarse[:, ::-1] + 2 * n])
    vertices = np.concatenate([points[used], low, behind])
    return make_mesh(vertices, faces)

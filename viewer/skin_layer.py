"""The skin of one part on the body: a coloured sheet with an edge, and a dot for each taxel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csr_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import SkinMismatchError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.topology import edges
from skinmap.geometry.triangles import unit
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh
from viewer.colours import DOT, RIM, pressure_colours
from viewer.polydata import make_mesh, write_values
from viewer.refinement import FineSurface, boundary_edges, refine

FULL_SCALE = 255.0  # counts
PRESSURE = "pressure"
LIFT = 2.0e-3  # the sheet above the taxels [m]: covers lie up to 1 mm above taxels
DOT_LIFT = 0.35e-3  # dots above the sheet [m]
LINE_LIFT = 0.9e-3  # outlines above the sheet [m]
DOT_SHARE = 0.16  # a dot's radius in spacings
BACK = 1.0e-3  # the sheet's back below its front [m]
EDGE_DEPTH = 5.0e-3  # how far the sheet's edge reaches down to the body [m]


@dataclass(eq=False, slots=True)
class SkinLayer:
    """What is drawn of one part, in the frame of its link.

    Attributes
    ----------
    mesh : SurfaceMesh
    fine : FineSurface
        v vertices.
    points : (v, 3) float
        Vertices of the sheet as drawn [m].
    sheet, shell, dots : pyvista.PolyData
    border : (b, 2) int
        Border edges of the sheet.
    soft : (v, n) sparse
        As `fine.smooth`, each taxel averaged with its neighbours first: for calm outlines.
    pressures : (n,) float
        What is shown now, 0 to 255 counts.
    """

    mesh: SurfaceMesh
    fine: FineSurface
    points: FloatArray
    sheet: pv.PolyData
    shell: pv.PolyData
    dots: pv.PolyData
    border: IntArray
    soft: csr_array
    pressures: FloatArray

    @property
    def skin(self) -> Skin:
        """The taxels."""
        return self.mesh.skin

    def field(self, pressures: FloatArray) -> FloatArray:
        """(v,) pressures (n,) carried to the sheet's vertices [counts]."""
        return np.asarray(self.fine.smooth @ pressures)

    def set_pressures(self, pressures: ArrayLike) -> None:
        """Colour the sheet by pressures (n,) of 0 to 255 counts, in place."""
        self.pressures = check_pressures(pressures, self.skin)
        write_values(self.sheet, PRESSURE, shown(self.field(self.pressures)))


def check_pressures(pressures: ArrayLike, skin: Skin) -> FloatArray:
    """Pressures (n,) as float64.

    Raises
    ------
    SkinMismatchError
        Another number of values than the skin has taxels.
    """
    values = np.asarray(pressures, np.float64)
    if values.shape != (len(skin),):
        raise SkinMismatchError(
            f"pressures of shape {values.shape} for the {len(skin)} taxels of {skin.part!r}"
        )
    return values


def shown(counts: FloatArray) -> NDArray[np.float32]:
    """Counts as a share of full scale, 0 to 1: the curve between taxels may swing beyond."""
    return np.clip(counts / FULL_SCALE, 0.0, 1.0).astype(np.float32)


def build_layer(mesh: SurfaceMesh, *, levels: int = 1) -> SkinLayer:
    """Sheet, edge and dots for one part's surface mesh."""
    fine = refine(mesh, levels)
    points = fine.positions + LIFT * fine.normals
    border = boundary_edges(fine.faces)
    sheet = make_mesh(points, fine.faces)
    sheet.point_data["Normals"] = fine.normals.astype(np.float32)
    sheet.point_data.active_normals_name = "Normals"
    sheet.point_data[PRESSURE] = np.zeros(len(points), np.float32)
    sheet.set_active_scalars(PRESSURE, preference="point")
    return SkinLayer(
        mesh,
        fine,
        points,
        sheet,
        underside(points, fine, mesh),
        taxel_dots(mesh.skin, LIFT + DOT_LIFT),
        border,
        fine.smooth @ neighbour_mean(mesh),
        np.zeros(len(mesh.skin)),
    )


def neighbour_mean(mesh: SurfaceMesh) -> csr_array:
    """(n, n) mean of each taxel and the ends of the mesh edges that leave it; rows sum to 1."""
    n = len(mesh.skin)
    a, b = edges(mesh.faces).T
    taxel = np.arange(n)
    row, column = np.concatenate([a, b, taxel]), np.concatenate([b, a, mesh.representative])
    count = np.bincount(row, minlength=n)
    return coo_array((1.0 / count[row], (row, column)), shape=(n, n)).tocsr()


def underside(points: FloatArray, fine: FineSurface, mesh: SurfaceMesh) -> pv.PolyData:
    """Edge and back of the sheet: they make it look solid, and hide its colours from behind.

    The edge reaches from the border down to the body; the back is the unrefined mesh.
    """
    used, number = np.unique(boundary_edges(fine.faces), return_inverse=True)
    a, b = number.reshape(-1, 2).T
    n = len(used)
    edge = np.concatenate([np.stack([a, a + n, b + n], axis=1), np.stack([a, b + n, b], axis=1)])
    low = points[used] - EDGE_DEPTH * fine.normals[used]
    taxels, back = np.unique(mesh.faces, return_inverse=True)
    behind = mesh.vertices[taxels] + (LIFT - BACK) * mesh.skin.normals[taxels]
    faces = np.concatenate([edge, back.reshape(-1, 3)[:, ::-1] + 2 * n])
    vertices = np.concatenate([points[used], low, behind])
    return make_mesh(vertices, faces)


def taxel_dots(skin: Skin, lift: float) -> pv.PolyData:
    """One small hexagon per taxel, lying in the skin, `lift` [m] above the taxel."""
    radius = DOT_SHARE * median_spacing(skin.positions)
    return hexagons(skin.positions + lift * skin.normals, skin.normals, radius)


def hexagons(centres: FloatArray, normals: FloatArray, radius: float) -> pv.PolyData:
    """Regular hexagons (n of them) around centres (n, 3), facing their normals (n, 3) [m]."""
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    right = unit(np.cross(normals, least))
    up = np.cross(normals, right)
    angle = np.arange(6) * np.pi / 3
    ring = np.cos(angle)[:, None] * right[:, None] + np.sin(angle)[:, None] * up[:, None]
    corners = centres[:, None] + radius * ring
    faces = np.arange(6 * len(centres)).reshape(-1, 6)
    return make_mesh(corners.reshape(-1, 3), faces)


def pressure_table() -> pv.LookupTable:
    """Colours of pressures from 0 to 1 of full scale: fixed limits, so that pictures compare."""
    table = pv.LookupTable(values=pressure_colours())
    table.scalar_range = (0.0, 1.0)
    return table


def style_sheet(actor: pv.Actor) -> None:
    """Matt, lightly shaded: the colour must stay readable as a value."""
    prop = actor.prop
    prop.ambient, prop.diffuse, prop.specular = 0.5, 0.52, 0.0
    prop.interpolation = "Gouraud"
    prop.culling = "back"


def add_layer(plotter: pv.Plotter, layer: SkinLayer, table: pv.LookupTable) -> list[pv.Actor]:
    """Put a layer into a plotter's active renderer, once."""
    sheet = pv.DataSetMapper(layer.sheet)
    sheet.lookup_table = table
    sheet.scalar_map_mode = "point"
    sheet.scalar_range = (0.0, 1.0)
    sheet.interpolate_before_map = True
    actors = [pv.Actor(mapper=sheet)]
    style_sheet(actors[0])
    for mesh, colour in ((layer.shell, RIM), (layer.dots, DOT)):
        if mesh.n_cells == 0:
            continue
        actor = pv.Actor(mapper=pv.DataSetMapper(mesh))
        actor.prop.color = colour
        actor.prop.lighting = mesh is layer.shell
        actors.append(actor)
    for actor in actors:
        plotter.add_actor(actor, reset_camera=False, render=False)
    return actors

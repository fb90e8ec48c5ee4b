"""Where the skin of one part is drawn: on the body, and on its flat map."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh
from viewer.drawing.frame.polydata import make_mesh
from viewer.drawing.skin.refinement import FineSurface, flat_vertices, split

# Lifts, depths and arrows are those of skins of a pitch from FINE to COARSE [m]; on finer ones they
# shrink with it, and on coarser ones they grow as far as the skin is longer than WIDE [m].
FINE, COARSE, WIDE = 4.5e-3, 7.0e-3, 0.5
LIFT = 2.0e-3  # the sheet above the taxels [m]: covers lie up to 1 mm above taxels
DISC_LIFT = 0.35e-3  # dots and discs above the sheet [m]
DOT_SHARE = 0.16  # a dot's radius in spacings
DISC_SHARE = 0.43  # a disc's: neighbours do not touch
FLAT_LIFT = 1e-3  # of discs above a flat map: more than the depth buffer's step [m]


@dataclass(frozen=True, eq=False, slots=True)
class Places:
    """Where the skin of one part lies, on the body or on the flat map.

    Attributes
    ----------
    points, normals : (w, 3) float
        Of the sheet [m].
    faces : (m, 3) int
    vertex : (w,) int
        Vertex of the part's fine surface that each point shows.
    cells : (q, 4) int
        Quadrilaterals over `cell_points`, three for each triangle between taxels.
    cell_points, cell_normals : (c, 3) float
        [m].
    owner : (q,) int
        Taxel whose corner each cell is.
    centres, facing : (k, 3) float
        Of discs, and their directions.
    taxels : (k,) int
        Taxel of each disc; one on a seam of the flat map has more than one.
    disc, dot : float
        Radii [m].
    lit : bool
        Whether light falls on it.
    scale : float
        Lifts and arrows here, in those of a usual skin.
    """

    points: FloatArray
    normals: FloatArray
    faces: IntArray
    vertex: IntArray
    cells: IntArray
    cell_points: FloatArray
    cell_normals: FloatArray
    owner: IntArray
    centres: FloatArray
    facing: FloatArray
    taxels: IntArray
    disc: float
    dot: float
    lit: bool
    scale: float


def mark_scale(skin: Skin) -> float:
    """Lifts and arrows of a skin, in those of a usual one."""
    pitch = skin.spacing
    size = float(np.ptp(skin.positions, axis=0).max())
    return min(pitch / FINE, max(1.0, min(pitch / COARSE, size / WIDE)))


def body_places(mesh: SurfaceMesh, fine: FineSurface) -> Places:
    """On the body, in the frame of the part's link: a little above the taxels."""
    skin, scale = mesh.skin, mark_scale(mesh.skin)
    points = fine.positions + LIFT * scale * fine.normals
    base = fine.coarse
    cells, mids, corners = taxel_cells(base)
    # Where the fine surface has them, the middles of edges are its own: they follow the curve.
    k = len(fine.taxels)
    if len(fine.positions) >= k + len(mids):
        ends, bent = points[: k + len(mids)], fine.normals[: k + len(mids)]
    else:
        ends = np.vstack([points, points[mids].mean(axis=1)])
        bent = np.vstack([fine.normals, unit(fine.normals[mids].sum(axis=1))])
    spacing = skin.spacing
    return Places(
        points,
        fine.normals,
        fine.faces,
        np.arange(len(points)),
        cells,
        np.vstack([ends, ends[corners].mean(axis=1)]),
        np.vstack([bent, unit(bent[corners].sum(axis=1))]),
        fine.taxels[base.T.ravel()],
        skin.positions + (LIFT + DISC_LIFT) * scale * skin.normals,
        skin.normals,
        np.arange(len(skin)),
        DISC_SHARE * spacing,
        DOT_SHARE * spacing,
        True,
        scale,
    )


def flat_places(flat: FlatMap, fine: FineSurface, dot: float) -> Places:
    """On the flat map, z up, from the charts' own vertices: whole on both sides of a seam.

    Parameters
    ----------
    flat : FlatMap
    fine : FineSurface
        Of the same part.
    dot : float
        Largest radius of a dot [m].
    """
    mesh = flat.mesh
    if len(mesh.faces) == 0:
        return _disc_places(flat, fine, dot)
    faces, start = np.zeros_like(mesh.faces), 0
    for chart in flat.charts:  # chart faces are the patch's own, in their order
        faces[mesh.face_patches == chart.patch] = chart.faces + start
        start += len(chart.taxels)
    uv = np.concatenate([chart.uv for chart in flat.charts])
    taxels = np.concatenate([chart.taxels for chart in flat.charts])
    cells, mids, corners = taxel_cells(faces)
    ends = np.vstack([uv, uv[mids].mean(axis=1)])
    points, halves = uv, faces
    while len(halves) < len(fine.faces):
        edges, halves = split(halves)
        points = np.vstack([points, points[edges].mean(axis=1)])
    vertex = np.zeros(len(points), np.int64)
    vertex[halves.ravel()] = fine.faces.ravel()
    spacing = mesh.skin.spacing
    return Places(
        raised(points),
        _up(len(points)),
        halves,
        vertex,
        cells,
        raised(np.vstack([ends, ends[corners].mean(axis=1)])),
        _up(len(ends) + len(corners)),
        taxels[faces.T.ravel()],
        raised(uv, FLAT_LIFT),
        _up(len(uv)),
        taxels,
        DISC_SHARE * spacing,
        min(DOT_SHARE * spacing, dot),
        False,
        mark_scale(mesh.skin),
    )


def _disc_places(flat: FlatMap, fine: FineSurface, dot: float) -> Places:
    """On the flat map, taxels without a surface: each a disc."""
    on_body = body_places(flat.mesh, fine)
    _, mids, corners = taxel_cells(fine.coarse)
    uv = flat_vertices(fine, flat)
    ends = uv[: len(fine.taxels) + len(mids)]
    return replace(
        on_body,
        points=raised(uv),
        normals=_up(len(uv)),
        cell_points=raised(np.vstack([ends, ends[corners].mean(axis=1)])),
        cell_normals=_up(len(ends) + len(corners)),
        centres=raised(flat.uv, FLAT_LIFT),
        facing=_up(len(flat.uv)),
        dot=min(on_body.dot, dot),
        lit=False,
    )


def taxel_cells(faces: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Each triangle shared out among its corners, the borders halfway along its edges.

    Parameters
    ----------
    faces : (m, 3) int
        Over k vertices.

    Returns
    -------
    cells : (3 m, 4) int
        Those of all first corners, then second, then third; their vertices are the k, then the
        middles of e edges, then the middles of m faces.
    ends : (e, 2) int
        Edges.
    corners : (m, 3) int
        Vertices that a face's middle is the mean of: the middles of its edges.
    """
    ends, halves = split(faces)
    m = len(faces)
    (a, ab, ca), (b, bc, _), (c, _, _) = (halves[i * m : (i + 1) * m].T for i in range(3))
    middle = int(faces.max(initial=-1)) + 1 + len(ends) + np.arange(m)
    quads = [(a, ab, middle, ca), (b, bc, middle, ab), (c, ca, middle, bc)]
    cells = np.concatenate([np.stack(quad, axis=1) for quad in quads])
    return cells, ends, np.stack([ab, bc, ca], axis=1)


def raised(uv: FloatArray, height: float = 0.0) -> FloatArray:
    """(n, 3) points of the flat map (n, 2), `height` above it [m]."""
    return np.column_stack([uv, np.full(len(uv), height)])


def _up(n: int) -> FloatArray:
    return np.tile([0.0, 0.0, 1.0], (n, 1))


def polygons(
    centres: FloatArray, normals: FloatArray, radius: float, corners: int = 6
) -> pv.PolyData:
    """Regular polygons (n of them) around centres (n, 3), facing their normals (n, 3) [m]."""
    angle = np.arange(corners) * 2 * np.pi / corners
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) @ tangent_frames(normals)
    points = centres[:, None] + radius * ring
    faces = np.arange(corners * len(centres)).reshape(-1, corners)
    return make_mesh(points.reshape(-1, 3), faces)

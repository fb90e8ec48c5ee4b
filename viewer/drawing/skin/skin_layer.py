"""The skin of one part: a coloured sheet with an edge, and a mark for each taxel.

The sheet is a finer surface through the taxels, and a sparse matrix carries pressures onto it. Each
edge is halved by the cubic Hermite curve through its two ends (values and slopes). The taxels stay
where they are and keep their values exactly; values and positions are linear in the taxels' own, so
one sparse product per sample colours the whole skin. It is drawn on the body, and on its flat map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csr_array, diags_array, vstack

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.topology import border_edges, edges, half_edges
from skinmap.geometry.triangles import cross_products, unit
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh
from viewer.drawing.frame.polydata import make_mesh
from viewer.layers import check_values

RIM = 12  # corners of the disc of a taxel without a surface


class FineSurface:
    """A refined surface mesh with v vertices over n taxels; gaps and holes stay as they are.

    Taxels without a surface become discs, each a fan of triangles that has the taxel's own value.

    Parameters
    ----------
    mesh : SurfaceMesh
    levels : int
        How many times each of its edges is halved.

    Attributes
    ----------
    positions, normals : (v, 3) float
        [m] and unit, outward. The first vertices are the taxels that faces use.
    faces : (m, 3) int
        Vertices, counter-clockwise seen from outside.
    smooth : (v, n) sparse
        Pressures of the taxels to values of the vertices; rows sum to 1.
    linear : (v, n) sparse
        The same by straight edges: for the flat map, whose triangles are flat.
    taxels : (k,) int
        Taxel of each of the first k vertices.
    coarse : (c, 3) int
        Triangles over those, before any edge was halved.
    """

    def __init__(self, mesh: SurfaceMesh, levels: int = 1) -> None:
        if len(mesh.faces):
            self.taxels, compact = np.unique(mesh.faces, return_inverse=True)
            positions, faces = mesh.vertices[self.taxels], compact.reshape(-1, 3)
        else:
            self.taxels, positions, faces = _discs(mesh.skin)
        self.coarse, normals = faces, mesh.skin.normals[self.taxels]
        n = len(mesh.representative)
        # Taxels that are one vertex of the mesh have its mean.
        smooth = means(mesh.representative, np.arange(n), (n, n))[self.taxels]
        linear = smooth
        for _ in range(levels):
            ends, halves = split(faces)
            rows = np.repeat(np.arange(len(ends)), 2)
            middle = means(rows, ends.ravel(), (len(ends), len(positions)))
            slopes = _slopes(positions, faces, ends)
            smooth = vstack([smooth, (middle + slopes) @ smooth], format="csr")
            linear = vstack([linear, middle @ linear], format="csr")
            positions = np.vstack([positions, _curved(positions, normals, ends)])
            normals = np.vstack([normals, unit(normals[ends[:, 0]] + normals[ends[:, 1]])])
            faces = halves
        self.positions, self.normals, self.faces = positions, normals, faces
        self.smooth, self.linear = smooth, linear


def _discs(skin: Skin) -> tuple[IntArray, FloatArray, IntArray]:
    """Taxel (k,), place (k, 3) [m] and triangles (c, 3) of discs around taxels that touch."""
    angle = np.arange(RIM) * 2.0 * np.pi / RIM
    ring = 0.5 * skin.spacing * np.column_stack([np.cos(angle), np.sin(angle)])
    fans = np.concatenate([np.zeros((1, 2)), ring]) @ tangent_frames(skin.normals)
    points = skin.positions[:, None] + fans
    spoke = 1 + np.arange(RIM)
    fan = np.column_stack([np.zeros(RIM, np.int64), spoke, 1 + spoke % RIM])
    faces = fan + (RIM + 1) * np.arange(len(skin))[:, None, None]
    taxels = np.repeat(np.arange(len(skin)), RIM + 1)
    return taxels, points.reshape(-1, 3), faces.reshape(-1, 3)


def flat_vertices(fine: FineSurface, flat: FlatMap) -> FloatArray:
    """(v, 2) places of a fine surface's vertices on the flat map [m]."""
    uv = np.asarray(fine.linear @ np.nan_to_num(flat.uv))
    if len(flat.mesh.faces) == 0:  # discs: as wide as on the body
        skin = flat.mesh.skin
        away = fine.positions - fine.linear @ skin.positions
        uv += np.einsum("vij,vj->vi", tangent_frames(fine.linear @ skin.normals), away)
    return uv


def split(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Edges (e, 2), and the four triangles of each face: new vertices are numbered by edge."""
    directed = np.sort(half_edges(faces), axis=1)
    ends, number = np.unique(directed, axis=0, return_inverse=True)
    middle = number.reshape(-1, 3) + (int(faces.max(initial=-1)) + 1)
    a, b, c = faces.T
    ab, bc, ca = middle.T
    corners = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return ends, np.concatenate([np.stack(corner, axis=1) for corner in corners])


def unsplit(faces: IntArray) -> IntArray:
    """The faces (m / 4, 3) from which `split` made these, over the first of their vertices."""
    m = len(faces) // 4
    return np.stack([faces[k * m : (k + 1) * m, 0] for k in range(3)], axis=1)


def means(row: IntArray, column: IntArray, shape: tuple[int, int]) -> csr_array:
    """Sparse matrix whose rows are the means over their columns, each pair (row, column) one."""
    count = np.bincount(row, minlength=shape[0])
    return coo_array((1.0 / count[row], (row, column)), shape=shape).tocsr()


def _slopes(positions: FloatArray, faces: IntArray, ends: IntArray) -> csr_array:
    """(e, n) an eighth of the difference of the slopes at both ends of each edge.

    The Hermite cubic through (0, p) and (1, q) with slopes s and t is (p + q) / 2 + (s - t) / 8
    in the middle. Slopes come from the mean gradient of the faces around a vertex.
    """
    n = len(positions)
    along = positions[ends[:, 1]] - positions[ends[:, 0]]
    total = csr_array((len(ends), n))
    for axis, gradient in enumerate(_gradients(positions, faces)):
        difference = gradient[ends[:, 0]] - gradient[ends[:, 1]]
        total = total + diags_array(along[:, axis] / 8.0) @ difference
    return total.tocsr()


def _gradients(positions: FloatArray, faces: IntArray) -> list[csr_array]:
    """Three (n, n) matrices: x, y and z of the area-weighted mean gradient at each vertex.

    In a triangle, the gradient of a corner's hat function is normal x opposite edge / (2 area).
    """
    n = len(positions)
    cross = cross_products(positions, faces)
    normal = unit(cross)
    area = np.bincount(
        faces.ravel(), np.repeat(np.linalg.norm(cross, axis=1), 3), minlength=n
    )  # twice the area, as below
    hats = np.stack(
        [
            np.cross(normal, positions[faces[:, (k + 2) % 3]] - positions[faces[:, (k + 1) % 3]])
            for k in range(3)
        ],
        axis=1,
    )
    row = np.repeat(faces, 3, axis=1).ravel()
    column = np.tile(faces, (1, 3)).ravel()
    scale = diags_array(1.0 / area)
    return [
        (
            scale @ coo_array((np.tile(hats[:, :, axis], (1, 3)).ravel(), (row, column)), (n, n))
        ).tocsr()
        for axis in range(3)
    ]


def _curved(positions: FloatArray, normals: FloatArray, ends: IntArray) -> FloatArray:
    """(e, 3) middles of the Hermite curves whose end slopes lie in the tangent planes [m]."""
    a, b = positions[ends[:, 0]], positions[ends[:, 1]]
    along = b - a
    rise_a = np.einsum("ij,ij->i", normals[ends[:, 0]], along)[:, None] * normals[ends[:, 0]]
    rise_b = np.einsum("ij,ij->i", normals[ends[:, 1]], along)[:, None] * normals[ends[:, 1]]
    return np.asarray((a + b) / 2 + (rise_b - rise_a) / 8)


# Lifts, depths and arrows are those of skins of a pitch from FINE to COARSE [m]; on finer ones they
# shrink with it, and on coarser ones they grow as far as the skin is longer than WIDE [m]. On a
# skin shorter than SMALL [m] arrows are about as long as it is, down to a scale of LEAST: the sheet
# stays above a cover.
FINE, COARSE, WIDE, SMALL, LEAST = 4.5e-3, 7.0e-3, 0.5, 0.06, 0.5
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
    long = max(1.0, min(pitch / COARSE, size / WIDE))
    return min(pitch / FINE, long, max(size / SMALL, LEAST) if size else 1.0)


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


LINE_LIFT = 0.9e-3  # outlines above the sheet [m]
BACK = 1.0e-3  # the sheet's back below its front [m]
EDGE_DEPTH = 5.0e-3  # how far the sheet's edge reaches down to the body [m]
HALF = 0.5  # share of a vertex's value that must be known for it to be drawn


class SkinLayer:
    """What is drawn of one part, in the frame of its link.

    Parameters
    ----------
    mesh : SurfaceMesh

    Attributes
    ----------
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

    def __init__(self, mesh: SurfaceMesh) -> None:
        self.mesh, self.fine = mesh, FineSurface(mesh)
        self.places = body_places(mesh, self.fine)
        self.shell = underside(self.places, self.fine)
        self.edge = underside(self.places, self.fine, quick=True)
        self.border, self.beside = border_edges(self.fine.faces), neighbour_mean(mesh)
        self.soft = self.fine.smooth @ self.beside
        self.pressures = np.zeros(len(mesh.skin))

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

"""The surface that a patch is laid on: a link's mesh, wrapped so that it is closed and clean."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.disk_cache import Arrays, Ingredient, cached
from skinmap.geometry.proximity import closest_on_mesh, edge_graph
from skinmap.geometry.topology import edges
from skinmap.geometry.triangles import face_normals, unit, vertex_normals
from skinmap.imports import import_meshlab
from skinmap.summary import first_few

ALPHA = 15e-3  # openings narrower than this are closed [m]
DETAIL = 4e-3  # longest edge: a facet's sagitta stays below 0.1 mm on a wrist [m]
OFFSET = 0.3e-3  # of the wrap from the mesh [m]
# The wrap's triangles change altogether with the last bit of a vertex, so what is wrapped is
# rounded first: a mesh read in metres and in millimetres gives one wrap. The wrap is then carried
# from the rounded mesh to the true one. The steps start at an odd place (the golden section), as
# CAD coordinates are round numbers and would lie on the border between two steps.
ROUNDING, SHIFT = 1e-3, 0.6180339887498949  # [m], steps
CHORD, OPEN = 2.0 * OFFSET, 5.0 * OFFSET  # heights of the wrap up to which it is one, and not
THIN = 5e-3  # shells up to so thick have two sides that a sheet could be laid on [m]
KEPT = 8  # wraps kept in memory: one a link that is worked on


@dataclass(eq=False)
class Target:
    """A closed surface with normals, ready to be asked for closest points.

    Attributes
    ----------
    vertices : (n, 3) float
        [m].
    faces : (m, 3) int
    normals : (n, 3) float
        Unit vertex normals, outward.
    """

    vertices: FloatArray
    faces: IntArray
    normals: FloatArray
    _tree: Any
    _link: tuple[FloatArray, IntArray]
    _graph: Any = None

    @property
    def graph(self) -> csr_array:
        """(n, n) edges with their lengths [m], made once."""
        if self._graph is None:
            self._graph = edge_graph(self.vertices, edges(self.faces))
        return self._graph

    def project(
        self, points: FloatArray, facing: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Closest points (k, 3) [m] and unit normals (k, 3), interpolated inside each face.

        An open mesh is wrapped on both of its sides, a hair apart. Where it is known which way a
        sheet faces (k, 3), its points belong to the side that faces so too.
        """
        close, normals = self._closest(points)
        if facing is None:
            return close, normals
        away = np.flatnonzero(np.einsum("kd,kd->k", normals, facing) < 0.0)
        if len(away):
            lifted = points[away] + THIN * unit(facing[away])
            other, out = self._closest(lifted)
            better = np.einsum("kd,kd->k", out, facing[away]) > 0.0
            close[away[better]], normals[away[better]] = other[better], out[better]
        return close, normals

    def behind(self, points: FloatArray, normals: FloatArray) -> BoolArray:
        """(k,) points on the back of a thin shell, as the mesh itself turns its faces.

        Only there is the mesh asked: of a closed body the wrap knows the outside better.
        """
        _, other = self._closest(points - THIN * normals)
        shell = np.flatnonzero(np.einsum("kd,kd->k", other, normals) < 0.0)
        found = np.zeros(len(points), bool)
        if len(shell):
            vertices, faces = self._link
            _, face, _ = closest_on_mesh(points[shell], vertices, faces)
            own = face_normals(vertices, faces[face])
            found[shell] = np.einsum("kd,kd->k", own, normals[shell]) < 0.0
        return found

    def _closest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        _, face, closest = self._tree.squared_distance(self.vertices, self.faces, points)
        corner = self.faces[np.asarray(face)]
        weights = _barycentric(closest, self.vertices[corner])
        return np.asarray(closest), unit(np.einsum("kc,kcd->kd", weights, self.normals[corner]))


_targets: OrderedDict[str, Target] = OrderedDict()


def make_target(vertices: FloatArray, faces: IntArray) -> Target:
    """Wrap a link's mesh (n, 3) [m], (m, 3): closed, without inner sheets, faces outward.

    Visual meshes are no targets as they are: open, with inner sheets and faces that point
    inward, so that the closest point jumps from sheet to sheet. The wrap (Portaneri et al.,
    "Alpha Wrapping with an Offset", ACM Transactions on Graphics 41(4), 2022, through
    pymeshlab) has neither, and is kept for the next call with the same mesh. Openings narrower
    than `ALPHA` are closed, and no edge of it is longer than `DETAIL`.
    """
    vertices = _as_stored(vertices)
    key = hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest()
    if key not in _targets:
        how: list[Ingredient] = [
            vertices, faces, ALPHA, OFFSET, CHORD, OPEN, DETAIL, ROUNDING, SHIFT
        ]  # fmt: skip
        wrap = partial(_wrap_of, vertices, faces)
        made = cached("target", how, wrap, made_by=("pymeshlab", "libigl"))
        _targets[key] = _made(made["vertices"], made["faces"], (vertices, one_way(vertices, faces)))
        while len(_targets) > KEPT:
            _targets.popitem(last=False)
    _targets.move_to_end(key)
    return _targets[key]


def one_way(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Faces (m, 3) of a sheet, turned as most of each piece is where they do not agree.

    Where more than two faces meet at an edge nobody knows, and all stay as they are.
    """
    places, same = np.unique(vertices, axis=0, return_inverse=True)
    corner = same.ravel()[faces]
    way = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2)
    _, count = np.unique(np.sort(way, axis=1), axis=0, return_counts=True)
    _, along = np.unique(way, axis=0, return_counts=True)
    if count.max(initial=0) > 2 or along.max(initial=0) < 2:
        return faces
    import igl

    turned, piece = igl.bfs_orient(corner)
    area = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]],
                    vertices[faces[:, 2]] - vertices[faces[:, 0]])  # fmt: skip
    a, b, c = (places[turned[:, k]] for k in range(3))
    kept = np.sign(np.einsum("fd,fd->f", area, np.cross(b - a, c - a)))
    most = np.bincount(piece, kept * np.linalg.norm(area, axis=1)) >= 0.0
    flips = (kept < 0.0) == most[piece]
    return np.where(flips[:, None], faces[:, ::-1], faces)


def _wrap_of(vertices: FloatArray, faces: IntArray) -> Arrays:
    coarse = rounded(vertices)
    wrap, triangles = _wrapped(coarse, faces)
    return {"vertices": _carried(wrap, coarse, vertices, faces), "faces": triangles}


def _carried(
    points: FloatArray, coarse: FloatArray, true: FloatArray, faces: IntArray
) -> FloatArray:
    """Points (k, 3) of the rounded mesh's wrap at the same triangles of the true one.

    The wrap's facets are chords, so it stands off by up to twice its offset: there it is drawn to
    the offset. Where it spans an opening it keeps its distance.
    """
    import igl

    _, face, closest = igl.point_mesh_squared_distance(points, coarse, faces)
    corner = faces[np.asarray(face)]
    weights = _barycentric(closest, coarse[corner])
    off = points - closest
    high = np.linalg.norm(off, axis=1, keepdims=True)
    wanted = np.clip(OPEN / (OPEN - CHORD) * (high - CHORD), OFFSET, np.maximum(high, OFFSET))
    off = off * np.minimum(1.0, wanted / np.maximum(high, 1e-12))
    return np.asarray(np.einsum("kc,kcd->kd", weights, true[corner]) + off)


def rounded(vertices: FloatArray) -> FloatArray:
    """Vertices (n, 3) [m] to the bits that do not depend on the unit of the file they came from."""
    steps = np.floor(_as_stored(vertices) / ROUNDING + SHIFT)
    return np.asarray((steps + 0.5 - SHIFT) * ROUNDING)


def _as_stored(vertices: FloatArray) -> FloatArray:
    """Vertices [m] as a file of single floats holds them, in metres or in millimetres.

    STL and PLY files hold single floats, so each unit rounds in its own way. Of the two, the
    coarser one at each magnitude: once through it, the way through the other comes back to the
    same number.
    """
    metres = vertices.astype(np.float32)
    millimetres = (1e3 * vertices).astype(np.float32)
    coarser = np.spacing(np.abs(metres)).astype(np.float64) > 1e-3 * np.spacing(np.abs(millimetres))
    return np.where(coarser, metres.astype(np.float64), 1e-3 * millimetres.astype(np.float64))


def _made(vertices: FloatArray, faces: IntArray, link: tuple[FloatArray, IntArray]) -> Target:
    import igl

    tree = igl.AABB()
    tree.init(vertices, faces)
    return Target(vertices, faces, vertex_normals(vertices, faces), tree, link)


def _wrapped(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    pymeshlab = import_meshlab()

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    length = pymeshlab.PureValue
    meshes.generate_alpha_wrap(alpha=length(ALPHA), offset=length(OFFSET))
    meshes.meshing_surface_subdivision_midpoint(iterations=6, threshold=length(DETAIL))
    made = meshes.current_mesh()
    return made.vertex_matrix(), made.face_matrix().astype(np.int64)


def _barycentric(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Weights (k, 3) of points (k, 3) on triangles (k, 3, 3); a corner where there is no area."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    square = np.einsum("kd,kd->k", normal, normal)
    safe = np.where(square > 0, square, 1.0)
    v = np.einsum("kd,kd->k", np.cross(points - a, c - a), normal) / safe
    w = np.einsum("kd,kd->k", np.cross(b - a, points - a), normal) / safe
    return np.column_stack([1.0 - v - w, v, w])


SHUT = 0.05  # of its area a mesh may lack and still hold a volume


def mesh_notes(vertices: FloatArray, faces: IntArray) -> tuple[str, ...]:
    """One line for each fault of a mesh (v, 3) [m], (f, 3), with the first faces that have it.

    Vertices at one place count as one, as STL files repeat them.
    """
    _, same = np.unique(vertices, axis=0, return_inverse=True)
    corner = same.ravel()[faces]
    ends = np.sort(np.stack([corner, np.roll(corner, -1, axis=1)], axis=2), axis=2)
    _, edge, count = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
    sharing = count[edge.ravel()].reshape(-1, 3)
    notes = []
    for wrong, kind in ((sharing == 1, "open"), (sharing > 2, "not a manifold")):
        if rows := np.flatnonzero(wrong.any(axis=1)).tolist():
            notes.append(
                f"the mesh is {kind} at {int(wrong.sum())} edges of {len(rows)} faces "
                f"({first_few(rows)}): wrapped first"
            )
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    across = np.cross(b - a, c - a)
    # Of what is closed but for holes; a sheet holds no volume.
    closed = np.linalg.norm(across.sum(axis=0)) < SHUT * np.linalg.norm(across, axis=1).sum()
    if closed and np.einsum("fd,fd->", a, np.cross(b, c)) < 0.0:
        notes.append(f"the mesh is inside out, all in all ({len(faces)} faces): wrapped first")
    return tuple(notes)

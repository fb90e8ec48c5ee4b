"""A link's mesh, wrapped so that it is closed and clean, and the board that is laid on it.

A board has a layout, lengths that hold, rigid plates, and heights that go together.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.disk_cache import Arrays, cached
from skinmap.geometry.proximity import closest_on_mesh, edge_graph, median_spacing
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

    @cached_property
    def graph(self) -> csr_array:
        """(n, n) edges with their lengths [m]."""
        return edge_graph(self.vertices, edges(self.faces))

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
            _, face, _ = closest_on_mesh(points[shell], *self._link)
            own = face_normals(self._link[0], self._link[1][face])
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
        how = (vertices, faces, ALPHA, OFFSET, CHORD, OPEN, DETAIL, ROUNDING, SHIFT)
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


REACH, PITCHES = 15e-3, 1.8  # distances on the board that the sheet keeps: in m, or in pitches
ACROSS = 1.5  # times the gap between two pieces of a board: the distances that hold them together
GAP = 2.5  # pitches: what is wider apart is no triangle of the sheet
STRAIN = 0.01  # standard deviation of a length on the body against the board
SCALE = 0.01  # of the board's scale against its drawing
# Strain that neither scale nor flat map explain: smooth fields of each of its three components.
SMOOTH, SMOOTH_REACH, FIELDS = 0.005, 40e-3, 10
# Heights of the iCub's 23 patches above their wrapped links, by maximum likelihood: 0.69 mm
# that strays over 6.4 mm (facets of flat boards), and a part common to some centimetres.
FACET, FACET_REACH = 0.65e-3, 6.4e-3
DRIFT, DRIFT_REACH = 0.6e-3, 60e-3
WHITE = 0.1e-3
# A module of 10 taxels is 26 mm long; those of the iCub are flat to the last digit. What is called
# one module and is larger bends with the link.
LARGEST_PLATE = 35e-3


@dataclass(frozen=True, eq=False, slots=True)
class Board(Frozen):
    """A layout with the pairs whose lengths hold, and how heights go together.

    Attributes
    ----------
    layout : (n, 2) float
        Seen from outside [m].
    pairs : (p, 2) int
    lengths, spread : (p,) float
        Length of each pair and its standard deviation [m].
    expected : (p,) float
        Logarithm of the ratio of the pair's length on the link to that of the layout.
    fields : (p, m) float
        What each unknown field of strain adds to that logarithm; the first is the scale.
    firmness : (m,) float
        Inverse variance of each unknown.
    ends : (p, n) sparse float
        -1 at the first taxel of a pair, 1 at the second.
    facets : (n, t) sparse float
        1 at the three taxels of each triangle of the sheet.
    triangles : (t, 3) int
        Counter-clockwise on the layout, so that they face outward.
    plates : tuple of (k,) int
        Taxels of each rigid module; none where the board is one flexible sheet.
    rise : (n,) float
        Height of each taxel over the common one, as its plate stands [m].
    stiffness : (n, n) float
        Inverse covariance of the heights [1/m2].
    lifted : (3n, 3n) float
        The same, each entry three by three times.
    slots, mirrored : (p, 9) int
        Where the block of a pair and its mirror image stand in a flat matrix of 3n + m + 1 columns.
    """

    layout: FloatArray
    pairs: IntArray
    lengths: FloatArray
    spread: FloatArray
    expected: FloatArray
    fields: FloatArray
    firmness: FloatArray
    ends: csr_array
    facets: csr_array
    triangles: IntArray
    plates: tuple[IntArray, ...]
    rise: FloatArray
    stiffness: FloatArray
    lifted: FloatArray
    slots: IntArray
    mirrored: IntArray


def make_board(layout: FloatArray, modules: IntArray | None = None) -> Board:
    """The sheet model of a layout (n, 2) [m], with the module (n,) of each taxel where known."""
    distance = np.linalg.norm(layout[:, None] - layout[None], axis=2)
    pairs = _held_pairs(distance, max(REACH, PITCHES * median_spacing(layout)))
    lengths = distance[pairs[:, 0], pairs[:, 1]]
    # Strains of neighbouring pairs go together, so all pairs speak no louder than the edges of
    # a triangulation would: three a taxel.
    share = min(1.0, 3.0 * len(layout) / max(1, len(pairs)))
    covariance = FACET**2 * np.exp(-0.5 * (distance / FACET_REACH) ** 2)
    covariance += DRIFT**2 * np.exp(-distance / DRIFT_REACH)
    covariance[np.diag_indices(len(layout))] += WHITE**2
    stiffness = np.linalg.inv(covariance)
    i, j = 3 * pairs.T[:, :, None, None]
    fields = _fields_of_strain(layout, pairs)
    firmness = np.full(fields.shape[1], 1.0 / SMOOTH**2)
    firmness[0] = 1.0 / SCALE**2
    rows = np.arange(len(pairs))
    ends = csr_array(
        (np.tile([-1.0, 1.0], len(pairs)), (np.repeat(rows, 2), pairs.ravel())),
        shape=(len(pairs), len(layout)),
    )
    triangles = _triangles(layout)
    a, b = np.arange(3)[:, None], np.arange(3)
    columns = 3 * len(layout) + len(firmness) + 1
    return Board(
        layout,
        pairs,
        lengths,
        STRAIN * lengths / np.sqrt(share),
        np.zeros(len(pairs)),
        fields,
        firmness,
        ends,
        csr_array(
            (np.ones(triangles.size), (triangles.ravel(), np.repeat(np.arange(len(triangles)), 3))),
            shape=(len(layout), len(triangles)),
        ),
        triangles,
        () if modules is None else _plates(layout, modules),
        np.zeros(len(layout)),
        stiffness,
        np.repeat(np.repeat(stiffness, 3, axis=0), 3, axis=1),
        ((i + a) * columns + j + b).reshape(-1, 9),
        ((j + a) * columns + i + b).reshape(-1, 9),
    )


def _triangles(layout: FloatArray) -> IntArray:
    """Triangles (t, 3) of a board, counter-clockwise, none across a gap."""
    corners = Delaunay(layout).simplices.astype(np.int64)
    side = np.linalg.norm(layout[corners] - layout[np.roll(corners, 1, axis=1)], axis=2)
    corners = corners[side.max(axis=1) <= max(REACH, GAP * median_spacing(layout))]
    first, second, third = (layout[corners[:, k]] for k in range(3))
    (ax, ay), (bx, by) = (second - first).T, (third - first).T
    clockwise = ax * by < ay * bx
    corners[clockwise] = corners[clockwise][:, ::-1]
    return corners


def facing(board: Board, positions: FloatArray) -> FloatArray:
    """(n, 3) which way the sheet itself faces at each taxel [m2]; 0 where nothing joins it."""
    a, b, c = (positions[board.triangles[:, k]] for k in range(3))
    return np.asarray(board.facets @ np.cross(b - a, c - a))


def _plates(layout: FloatArray, modules: IntArray) -> tuple[IntArray, ...]:
    """Taxels of each module that is small enough to be rigid, and large enough to be a plate."""
    members = [np.flatnonzero(modules == name) for name in np.unique(modules)]
    return tuple(
        rows
        for rows in members
        if len(rows) >= 3 and np.linalg.norm(np.ptp(layout[rows], axis=0)) <= LARGEST_PLATE
    )


def _fields_of_strain(layout: FloatArray, pairs: IntArray) -> FloatArray:
    """(p, 1 + 3 f) the scale, and the main smooth fields of a Gaussian process at the pairs.

    Each field is one of three components of strain, e_xx, e_yy and e_xy, along the pair.
    """
    n, count = len(layout), min(FIELDS, len(layout))
    distance = np.linalg.norm(layout[:, None] - layout[None], axis=2)
    together = np.exp(-0.5 * (distance / SMOOTH_REACH) ** 2)
    values, vectors = eigh(together, subset_by_index=(n - count, n - 1))
    # The sign of an eigenvector is chance: the largest entry is made positive.
    largest = np.abs(vectors).argmax(axis=0)
    vectors = vectors * np.sign(vectors[largest, np.arange(count)])
    smooth = vectors * np.sqrt(np.maximum(values, 0.0))
    i, j = pairs.T
    step = layout[j] - layout[i]
    x, y = (step / np.linalg.norm(step, axis=1, keepdims=True)).T
    middle = 0.5 * (smooth[i] + smooth[j])
    parts = [factor[:, None] * middle for factor in (x * x, y * y, 2.0 * x * y)]
    return np.concatenate([np.ones((len(pairs), 1)), *parts], axis=1)


def _held_pairs(distance: FloatArray, reach: float) -> IntArray:
    """Pairs (p, 2) whose lengths hold: near ones, and those across the gaps between pieces."""
    held = distance <= reach
    tree = minimum_spanning_tree(distance).tocoo()
    _, piece = connected_components(distance <= reach / ACROSS, directed=False)
    for i, j, gap in zip(tree.row, tree.col, tree.data, strict=True):
        if piece[i] != piece[j]:
            between = (piece == piece[i])[:, None] & (piece == piece[j])
            held |= between & (distance <= ACROSS * gap)
    return np.argwhere(np.triu(held | held.T, 1)).astype(np.int64)


def chords(
    board: Board, positions: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance (p,) and unit direction (p, 3) of each pair, and the length (p,) it should have.

    A length d along a surface that turns by the angle t has a chord of d (1 - t^2 / 24).
    """
    chord, along = _steps(positions, board.pairs)
    return chord, along, board.lengths * shortening(positions, normals, board.pairs)


def _steps(places: FloatArray, pairs: IntArray) -> tuple[FloatArray, FloatArray]:
    step = places[pairs[:, 1]] - places[pairs[:, 0]]
    length = np.linalg.norm(step, axis=1)
    return length, step / np.maximum(length, 1e-12)[:, None]


def shortening(places: FloatArray, normals: FloatArray, pairs: IntArray) -> FloatArray:
    """(p,) chords against lengths along the surface, from how its normals turn on the way."""
    turned = normals[pairs[:, 1]] - normals[pairs[:, 0]]
    bend = np.clip(np.einsum("pd,pd->p", turned, _steps(places, pairs)[1]), -1.5, 1.5)
    return np.asarray(1.0 - bend**2 / 24.0)

"""A board: its layout, the lengths that hold, the plates it is made of, how heights go together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.geometry.proximity import median_spacing

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
class Board:
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

    def __post_init__(self) -> None:
        freeze(self)


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
    i, j = board.pairs.T
    step = positions[j] - positions[i]
    chord = np.linalg.norm(step, axis=1)
    along = step / np.maximum(chord, 1e-12)[:, None]
    return chord, along, board.lengths * shortening(positions, normals, board.pairs)


def shortening(places: FloatArray, normals: FloatArray, pairs: IntArray) -> FloatArray:
    """(p,) chords against lengths along the surface, from how its normals turn on the way."""
    i, j = pairs.T
    step = places[j] - places[i]
    along = step / np.maximum(np.linalg.norm(step, axis=1), 1e-12)[:, None]
    bend = np.clip(np.einsum("pd,pd->p", normals[j] - normals[i], along), -1.5, 1.5)
    return np.asarray(1.0 - bend**2 / 24.0)

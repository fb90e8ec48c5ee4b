"""The sheet model: a board that keeps its lengths, floats over the link and may be scaled a little.

Unknown are the positions of all taxels, the strain of the sheet (its scale, and a few smooth
fields) and its height above the wrapped link. The cost of a state adds up, each over its expected
spread,

- lengths: |x_i - x_j| against the layout's, shortened to the chord of the surface's bend. Where a
  link is doubly curved no drawing keeps all lengths: a board is a flat map of where it lies, so
  the strain of that flat map is expected (`expecting`) and only what differs from it costs,
- heights above the surface, which stray together over a few millimetres and over the whole patch
  (covers are thicker here than there). Where the modules are known they are rigid plates: their
  corners rise above a bent link, and their gaps open,
- the strain and the height themselves,
- whatever evidence there is (anchors, touches), which callers add as points with weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay

from calibration.patch.link_surface import Target
from calibration.patch.solver_budget import STEPS
from skinmap.arrays import BoolArray, FloatArray, IntArray, freeze
from skinmap.geometry.triangles import unit

REACH = 15e-3  # distances on the board that the sheet keeps [m]
ACROSS = 1.5  # times the gap between two pieces of a board: the distances that hold them together
STRAIN = 0.01  # standard deviation of a length on the body against the board
SCALE = 0.01  # of the board's scale against its drawing
# Strain that neither scale nor flat map explain: smooth fields of each of its three components.
SMOOTH, SMOOTH_REACH, FIELDS = 0.005, 40e-3, 10
FOLDED = 0.1  # ratio of lengths below which a sheet has collapsed: no strain means anything
FLAT_STEPS = 12  # of Gauss and Newton, at most, that lay a surface's lengths flat
# Heights of the iCub's 23 patches above their wrapped links, by maximum likelihood: 0.69 mm
# that strays over 6.4 mm (facets of flat boards), and a part common to some centimetres.
FACET, FACET_REACH = 0.65e-3, 6.4e-3
DRIFT, DRIFT_REACH = 0.6e-3, 60e-3
WHITE = 0.1e-3
HEIGHT = 3e-3  # of the common height before anything is known [m]
# A module of 10 taxels is 26 mm long; those of the iCub are flat to the last digit. What is called
# one module and is larger bends with the link.
LARGEST_PLATE = 35e-3
STAGES = (8.0, 3.0, 1.0)  # stiffness, annealed: stiff first, so that folds cannot form
SETTLED = 2e-6  # a step that moves no taxel further than this ends the last stage [m]
ROUGHLY = 0.1e-3  # and this the stages before [m]
SAME = 0.3e-3  # states whose taxels are this close on average are one [m]
STRIDE = 5e-3  # no taxel moves further in one step [m]
CAUCHY = 3.0  # residuals over their spread, in space, from which on evidence is doubted
DAMPING = 1e-4  # of the diagonal (Levenberg and Marquardt)


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """Places that the sheet should pass through.

    Attributes
    ----------
    blend : (k, n) float
        Shares of the taxels in each place, each row of sum 1: a single taxel for an anchor, the
        activated ones for a touch.
    points : (k, 3) float
        [m].
    sigma : (k,) float
        Standard deviation of each coordinate [m].
    doubted : (k,) bool
        Evidence that may be altogether wrong: Cauchy's loss instead of the square.
    """

    blend: FloatArray
    points: FloatArray
    sigma: FloatArray
    doubted: BoolArray

    def __post_init__(self) -> None:
        freeze(
            self,
            blend=self.blend,
            points=self.points,
            sigma=self.sigma,
            doubted=self.doubted,
        )

    def __len__(self) -> int:
        return len(self.points)

    def only(self, rows: BoolArray) -> Evidence:
        """Some of the places."""
        return Evidence(self.blend[rows], self.points[rows], self.sigma[rows], self.doubted[rows])

    def missed(self, positions: FloatArray, normals: FloatArray) -> FloatArray:
        """(k, 3) from each point to the sheet there [m].

        The mean of places on a bent sheet lies below it by half the covariance of the places
        with the normals; that is put back.
        """
        mean, out = self.blend @ positions, self.blend @ normals
        both = self.blend @ np.einsum("nd,nd->n", positions, normals)
        sag = 0.5 * (both - np.einsum("kd,kd->k", mean, out))
        return np.asarray(mean + sag[:, None] * unit(out) - self.points)

    def loss(self, missed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Cost of each place, and its weight in the next step of Gauss and Newton [1/m2]."""
        square = (missed**2).sum(axis=1) / self.sigma**2
        heavy = np.where(self.doubted, square / CAUCHY**2, 0.0)
        cost = np.where(self.doubted, CAUCHY**2 * np.log1p(heavy), square)
        return cost, 1.0 / (self.sigma**2 * (1.0 + heavy))


def at_taxels(count: int, taxels: IntArray, points: FloatArray, sigma: FloatArray) -> Evidence:
    """Anchors: places of single taxels, of a board of `count`."""
    return Evidence(np.eye(count)[taxels], points, sigma, np.zeros(len(taxels), bool))


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
        freeze(
            self,
            layout=self.layout,
            pairs=self.pairs,
            lengths=self.lengths,
            spread=self.spread,
            expected=self.expected,
            fields=self.fields,
            firmness=self.firmness,
            rise=self.rise,
            triangles=self.triangles,
            stiffness=self.stiffness,
            lifted=self.lifted,
            slots=self.slots,
            mirrored=self.mirrored,
        )


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """A sheet in place.

    Attributes
    ----------
    positions : (n, 3) float
        [m].
    strain : (m,) float
        Share of each field of strain; the first is the logarithm of the scale.
    height : float
        [m].
    """

    positions: FloatArray
    strain: FloatArray
    height: float

    @property
    def scale(self) -> float:
        """Of the body's lengths against the layout's."""
        return float(np.exp(self.strain[0]))


def make_board(layout: FloatArray, modules: IntArray | None = None) -> Board:
    """The sheet model of a layout (n, 2) [m], with the module (n,) of each taxel where known."""
    distance = np.linalg.norm(layout[:, None] - layout[None], axis=2)
    pairs = _held_pairs(distance)
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
    corners = corners[side.max(axis=1) <= REACH]
    a, b = (
        layout[corners[:, 1]] - layout[corners[:, 0]],
        layout[corners[:, 2]] - layout[corners[:, 0]],
    )
    clockwise = a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]
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


def _held_pairs(distance: FloatArray) -> IntArray:
    """Pairs (p, 2) whose lengths hold: near ones, and those across the gaps between pieces."""
    held = distance <= REACH
    tree = minimum_spanning_tree(distance).tocoo()
    _, piece = connected_components(distance <= REACH / ACROSS, directed=False)
    for i, j, gap in zip(tree.row, tree.col, tree.data, strict=True):
        if piece[i] != piece[j]:
            between = (piece == piece[i])[:, None] & (piece == piece[j])
            held |= between & (distance <= ACROSS * gap)
    return np.argwhere(np.triu(held | held.T, 1)).astype(np.int64)


def settle(
    target: Target,
    board: Board,
    evidence: Evidence,
    state: State,
    *,
    stages: tuple[float, ...],
    steps: int = STEPS,
    settled: float = SETTLED,
    known: Sequence[State] = (),
) -> State:
    """The minimum of the cost that a state leads to, through annealed stiffness.

    A stage has at most so many `steps`. One that moves no taxel further than `settled` [m] ends
    it. One that comes to a `known` minimum ends there too, as it would lead to that one.
    """
    for stiff in stages:
        for _ in range(steps):
            _, gradient, hessian = linearise(target, board, evidence, state, stiff=stiff)
            hessian[np.diag_indices_from(hessian)] *= 1.0 + DAMPING
            # Symmetric, so that its transpose is the same matrix in the order that LAPACK wants.
            factor = cho_factor(hessian.T, lower=True, overwrite_a=True, check_finite=False)
            step = cho_solve(factor, -gradient, check_finite=False)
            coordinates = state.positions.size
            move = step[:coordinates].reshape(-1, 3)
            furthest = float(np.abs(move).max())
            brake = min(1.0, STRIDE / furthest) if furthest > 0 else 1.0
            state = State(
                state.positions + brake * move,
                state.strain + brake * step[coordinates:-1],
                state.height + brake * float(step[-1]),
            )
            if furthest < settled or any(apart(state, other) < SAME for other in known):
                break
    return state


def apart(one: State, other: State) -> float:
    """Mean distance between the taxels of two states [m]."""
    return float(np.linalg.norm(one.positions - other.positions, axis=1).mean())


def linearise(
    target: Target, board: Board, evidence: Evidence, state: State, *, stiff: float = 1.0
) -> tuple[float, FloatArray, FloatArray]:
    """Cost, half its gradient (3n + m + 1,) and Gauss-Newton matrix of that size at a state.

    Unknowns in order: coordinates by taxel, fields of strain, height.
    """
    x, n = state.positions, len(board.layout)
    close, normals = target.project(x, facing(board, x))
    columns = 3 * n + len(board.firmness) + 1
    hessian = np.empty((columns, columns))
    gradient = np.empty(columns)
    strains = slice(3 * n, -1)

    chord, along, wanted = chords(board, x, normals)
    spread = board.spread / stiff
    wanted = np.exp(board.expected + board.fields @ state.strain) * wanted
    length = (chord - wanted) / spread
    grown = -wanted / spread  # derivative by the logarithm of the length that is wanted
    high = np.einsum("nd,nd->n", x - close, normals) - state.height - board.rise
    push = board.stiffness @ high
    missed = evidence.missed(x, normals)
    loss, weight = evidence.loss(missed)

    weighted = weight[:, None] * evidence.blend
    across = normals.ravel()
    surface = hessian[: 3 * n, : 3 * n]
    np.multiply(board.lifted, across, out=surface)
    surface *= across[:, None]
    _add_lengths(board, along / spread[:, None], hessian)
    together = evidence.blend.T @ weighted
    for axis in range(3):
        surface[axis::3, axis::3] += together
        pull = (grown / spread * along[:, axis])[:, None] * board.fields
        hessian[axis : 3 * n : 3, strains] = board.ends.T @ pull
    hessian[strains, : 3 * n] = hessian[: 3 * n, strains].T
    grows = grown[:, None] * board.fields
    hessian[strains, strains] = grows.T @ grows + np.diag(board.firmness)
    lift = -board.stiffness.sum(axis=1)[:, None] * normals
    hessian[: 3 * n, -1] = hessian[-1, : 3 * n] = lift.ravel()
    hessian[-1, -1] = board.stiffness.sum() + 1.0 / HEIGHT**2
    hessian[strains, -1] = hessian[-1, strains] = 0.0

    force = board.ends.T @ ((length / spread)[:, None] * along)
    force += push[:, None] * normals
    force += weighted.T @ missed
    gradient[: 3 * n] = force.ravel()
    gradient[strains] = grows.T @ length + board.firmness * state.strain
    gradient[-1] = -push.sum() + state.height / HEIGHT**2
    cost = (
        length @ length
        + high @ push
        + float(loss.sum())
        + float(board.firmness @ state.strain**2)
        + (state.height / HEIGHT) ** 2
    )
    return float(cost), gradient, hessian


def expecting(target: Target, board: Board, state: State) -> Board:
    """The board as a flat map of where a state has it: with the strain that this implies.

    The sheet is put on the surface at its common height, its lengths there are laid flat by least
    squares over the same pairs, and what that map stretches is what the layout is expected to.
    Rigid modules are put as plates on both, which says how their gaps open and corners rise.
    """
    close, normals = target.project(state.positions, facing(board, state.positions))
    on = close + state.height * normals
    lengths = _apart(on, board.pairs) / _shortening(on, normals, board.pairs)
    drawn = _laid_flat(board, lengths)
    placed = _as_plates(board, on)
    drawn = _as_plates(board, drawn)
    below, out = target.project(placed, facing(board, placed))
    rise = np.einsum("nd,nd->n", placed - below, out) - state.height
    longer = _apart(placed, board.pairs) / np.maximum(_apart(drawn, board.pairs), SETTLED)
    return replace(
        board,
        expected=np.log(np.maximum(longer, FOLDED) / _shortening(placed, out, board.pairs)),
        rise=rise if board.plates else board.rise,
    )


def _apart(places: FloatArray, pairs: IntArray) -> FloatArray:
    """Distance (p,) of each pair."""
    return np.asarray(np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1))


def _as_plates(board: Board, places: FloatArray) -> FloatArray:
    """Places (n, 2 or 3) with each rigid module moved, as it was drawn, to where they have it."""
    moved = places.copy()
    for rows in board.plates:
        drawn = board.layout[rows] - board.layout[rows].mean(axis=0)
        middle = places[rows].mean(axis=0)
        left, _, right = np.linalg.svd((places[rows] - middle).T @ drawn, full_matrices=False)
        moved[rows] = middle + drawn @ (left @ right).T
    return moved


def _laid_flat(board: Board, lengths: FloatArray) -> FloatArray:
    """Places in the plane (n, 2) whose distances are nearest to given lengths (p,) of the pairs."""
    places, n = board.layout * float(np.median(lengths / board.lengths)), len(board.layout)
    weight = 1.0 / board.spread**2
    for _ in range(FLAT_STEPS):
        step = board.ends @ places
        drawn = np.linalg.norm(step, axis=1)
        along = step / np.maximum(drawn, 1e-12)[:, None]
        normal = np.empty((2 * n, 2 * n))
        force = np.empty(2 * n)
        for a in range(2):
            force[a::2] = board.ends.T @ (weight * (drawn - lengths) * along[:, a])
            for b in range(2):
                block = weight * along[:, a] * along[:, b]
                normal[a::2, b::2] = (board.ends.T @ (block[:, None] * board.ends)).toarray()
        # Rigid motions are free: a trace of damping holds them.
        normal[np.diag_indices(2 * n)] *= 1.0 + 1e-6
        move = cho_solve(cho_factor(normal, check_finite=False), -force, check_finite=False)
        places = places + move.reshape(-1, 2)
        if np.abs(move).max() < SETTLED:
            break
    return places


def _add_lengths(board: Board, pull: FloatArray, hessian: FloatArray) -> None:
    """Add the pairs' weighted directions d (p, 3): -dd' off the diagonal, their sums on it."""
    n = len(board.layout)
    i, j = board.pairs.T
    block = (pull[:, :, None] * pull[:, None, :]).reshape(-1, 9)
    flat = hessian.reshape(-1)  # a view: it was made in one piece
    flat[board.slots] -= block
    flat[board.mirrored] -= block
    both, twice = np.concatenate([i, j]), np.concatenate([block, block])
    for a in range(3):
        for b in range(a, 3):
            total = np.bincount(both, twice[:, 3 * a + b], minlength=n)
            at = 3 * np.arange(n)
            hessian[at + a, at + b] += total
            if a != b:
                hessian[at + b, at + a] += total


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
    return chord, along, board.lengths * _shortening(positions, normals, board.pairs)


def _shortening(places: FloatArray, normals: FloatArray, pairs: IntArray) -> FloatArray:
    """(p,) chords against lengths along the surface, from how its normals turn on the way."""
    i, j = pairs.T
    step = places[j] - places[i]
    along = step / np.maximum(np.linalg.norm(step, axis=1), 1e-12)[:, None]
    bend = np.clip(np.einsum("pd,pd->p", normals[j] - normals[i], along), -1.5, 1.5)
    return np.asarray(1.0 - bend**2 / 24.0)

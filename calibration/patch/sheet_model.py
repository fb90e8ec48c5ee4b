"""The sheet model: a board that keeps its lengths, floats over the link and may be scaled a little.

Unknown are the positions of all taxels, the scale of the layout and the height of the sheet above
the wrapped link. The cost of a state adds up, each over its expected spread,

- lengths: |x_i - x_j| against the layout's, shortened to the chord of the surface's bend,
- heights above the surface, which stray together over a few millimetres (boards are flat and links
  are not) and over the whole patch (covers are thicker here than there),
- the scale and the height themselves,
- whatever evidence there is (anchors, touches), which callers add as points with weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from calibration.patch.link_surface import Target
from calibration.patch.solver_budget import STEPS
from skinmap.arrays import BoolArray, FloatArray, IntArray, freeze
from skinmap.geometry.triangles import unit

REACH = 15e-3  # distances on the board that the sheet keeps [m]
ACROSS = 1.5  # times the gap between two pieces of a board: the distances that hold them together
STRAIN = 0.01  # standard deviation of a length on the body against the board
SCALE = 0.01  # of the board's scale against its drawing
# Heights of the iCub's 23 patches above their wrapped links, by maximum likelihood: 0.69 mm
# that strays over 6.4 mm (facets of flat boards), and a part common to some centimetres.
FACET, FACET_REACH = 0.65e-3, 6.4e-3
DRIFT, DRIFT_REACH = 0.6e-3, 60e-3
WHITE = 0.1e-3
HEIGHT = 3e-3  # of the common height before anything is known [m]
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
    stiffness : (n, n) float
        Inverse covariance of the heights [1/m2].
    lifted : (3n, 3n) float
        The same, each entry three by three times.
    slots, mirrored : (p, 9) int
        Where the block of a pair and its mirror image stand in a flat matrix of 3n + 2 columns.
    """

    layout: FloatArray
    pairs: IntArray
    lengths: FloatArray
    spread: FloatArray
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
            stiffness=self.stiffness,
            lifted=self.lifted,
            slots=self.slots,
            mirrored=self.mirrored,
        )


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """A sheet in place: positions (n, 3) [m], logarithm of the scale, height [m]."""

    positions: FloatArray
    log_scale: float
    height: float


def make_board(layout: FloatArray) -> Board:
    """The sheet model of a layout (n, 2) [m]."""
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
    a, b, columns = np.arange(3)[:, None], np.arange(3), 3 * len(layout) + 2
    return Board(
        layout,
        pairs,
        lengths,
        STRAIN * lengths / np.sqrt(share),
        stiffness,
        np.repeat(np.repeat(stiffness, 3, axis=0), 3, axis=1),
        ((i + a) * columns + j + b).reshape(-1, 9),
        ((j + a) * columns + i + b).reshape(-1, 9),
    )


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
            move = step[:-2].reshape(-1, 3)
            furthest = float(np.abs(move).max())
            brake = min(1.0, STRIDE / furthest) if furthest > 0 else 1.0
            state = State(
                state.positions + brake * move,
                state.log_scale + brake * step[-2],
                state.height + brake * step[-1],
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
    """Cost, half its gradient (3n + 2,) and Gauss-Newton matrix (3n + 2, 3n + 2) at a state.

    Unknowns in order: coordinates by taxel, logarithm of the scale, height.
    """
    x, n = state.positions, len(board.layout)
    close, normals = target.project(x)
    hessian = np.empty((3 * n + 2, 3 * n + 2))
    gradient = np.empty(3 * n + 2)

    chord, along, wanted = chords(board, x, normals)
    spread = board.spread / stiff
    wanted = np.exp(state.log_scale) * wanted
    length = (chord - wanted) / spread
    grown = -wanted / spread  # derivative by the logarithm of the scale
    high = np.einsum("nd,nd->n", x - close, normals) - state.height
    push = board.stiffness @ high
    missed = evidence.missed(x, normals)
    loss, weight = evidence.loss(missed)

    weighted = weight[:, None] * evidence.blend
    across = normals.ravel()
    surface = hessian[:-2, :-2]
    np.multiply(board.lifted, across, out=surface)
    surface *= across[:, None]
    _add_lengths(board, along / spread[:, None], hessian)
    together = evidence.blend.T @ weighted
    for axis in range(3):
        surface[axis::3, axis::3] += together
    hessian[:-2, -2] = hessian[-2, :-2] = _gather(board, (grown / spread)[:, None] * along)
    hessian[-2, -2] = grown @ grown + 1.0 / SCALE**2
    lift = -board.stiffness.sum(axis=1)[:, None] * normals
    hessian[:-2, -1] = hessian[-1, :-2] = lift.ravel()
    hessian[-1, -1] = board.stiffness.sum() + 1.0 / HEIGHT**2
    hessian[-2, -1] = hessian[-1, -2] = 0.0

    force = _gather(board, (length / spread)[:, None] * along).reshape(n, 3)
    force += push[:, None] * normals
    force += weighted.T @ missed
    gradient[:-2] = force.ravel()
    gradient[-2] = grown @ length + state.log_scale / SCALE**2
    gradient[-1] = -push.sum() + state.height / HEIGHT**2
    cost = (
        length @ length
        + high @ push
        + float(loss.sum())
        + (state.log_scale / SCALE) ** 2
        + (state.height / HEIGHT) ** 2
    )
    return float(cost), gradient, hessian


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


def _gather(board: Board, pull: FloatArray) -> FloatArray:
    """(3n,) sums over pairs (p, 3): added at the second taxel, taken off at the first."""
    n = len(board.layout)
    i, j = board.pairs.T
    total = [
        np.bincount(j, column, minlength=n) - np.bincount(i, column, minlength=n)
        for column in pull.T
    ]
    return np.stack(total, axis=1).ravel()


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
    turn = np.clip(np.einsum("pd,pd->p", normals[j] - normals[i], along), -1.5, 1.5)
    return chord, along, board.lengths * (1.0 - turn**2 / 24.0)

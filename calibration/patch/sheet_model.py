"""The sheet model: a board that keeps its lengths, floats over the link and may be scaled a little.

Unknown are the positions of all taxels, the strain of the sheet (its scale, and a few smooth
fields) and its height above the wrapped link. The cost of a state adds up, each over its expected
spread,

- lengths: |x_i - x_j| against the layout's, shortened to the chord of the surface's bend. Where a
  link is doubly curved no drawing keeps all lengths: a board is a flat map of where it lies, so
  the strain of that flat map is expected (`expected_strain`) and only what differs from it costs,
- heights above the surface, which stray together over a few millimetres and over the whole patch
  (covers are thicker here than there). Where the modules are known they are rigid plates: their
  corners rise above a bent link, and their gaps open,
- the strain and the height themselves,
- whatever evidence there is (anchors, touches), which callers add as points with weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from calibration.patch.link_surface import Board, Target, chords, facing
from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.geometry.triangles import unit

HEIGHT = 3e-3  # of the common height before anything is known [m]
STAGES = (8.0, 3.0, 1.0)  # stiffness, annealed: stiff first, so that folds cannot form
SETTLED = 2e-6  # a step that moves no taxel further than this ends the last stage [m]
ROUGHLY = 0.1e-3  # and this the stages before [m]
SAME = 0.3e-3  # states whose taxels are this close on average are one [m]
STEPS = 20  # of Gauss and Newton in a stage at most; most stages settle before
STRIDE = 5e-3  # no taxel moves further in one step [m]
CAUCHY = 3.0  # residuals over their spread, in space, from which on evidence is doubted
DAMPING = 1e-4  # of the diagonal (Levenberg and Marquardt)


@dataclass(frozen=True, eq=False, slots=True)
class Evidence(Frozen):
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

    def __len__(self) -> int:
        return len(self.points)

    def only(self, rows: BoolArray) -> Evidence:
        """Some of the places."""
        return Evidence(self.blend[rows], self.points[rows], self.sigma[rows], self.doubted[rows])

    def taxel(self, row: int) -> int:
        """The taxel that a place is of most."""
        return int(np.argmax(self.blend[row]))

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
    moved : float
        How far the last step wanted to move a taxel: what a search still had to go [m].
    """

    positions: FloatArray
    strain: FloatArray
    height: float
    moved: float = np.inf

    @property
    def scale(self) -> float:
        """Of the body's lengths against the layout's."""
        return float(np.exp(self.strain[0]))


def settle(
    target: Target,
    board: Board,
    evidence: Evidence,
    state: State,
    *,
    stages: tuple[float, ...],
    settled: float = SETTLED,
    known: Sequence[State] = (),
) -> State:
    """The minimum of the cost that a state leads to, through annealed stiffness.

    A stage has at most `STEPS`. One that moves no taxel further than `settled` [m] ends
    it. One that comes to a `known` minimum ends there too, as it would lead to that one.
    """
    for stiff in stages:
        for _ in range(STEPS):
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
                furthest,
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

"""Descent on the symmetric Dirichlet energy with one factor of the surface's own Laplacian.

The energy of a map with Jacobians J is sum A |J|^2 (1 + 1 / det(J)^2): 4 per area for an
isometry, infinite before a triangle flips. Near an isometry its Hessian is that of an elastic
sheet, which the Laplacian bounds from both sides whatever the mesh (Korn's inequality): as the
first guess of a quasi-Newton method it makes the number of steps independent of the resolution.

References
----------
Smith and Schaefer, "Bijective parameterization with free boundaries", ACM Transactions on
Graphics 34(4), 2015: energy and largest step. Kovalsky, Galun and Lipman, "Accelerated quadratic
proxy for geometric optimization", 35(4), 2016, and Zhu, Bridson and Kaufman, "Blended cured
quasi-Newton for distortion optimization", 37(4), 2018: the Laplacian as a metric, reused.
Nocedal and Wright, "Numerical Optimization", 2006, section 7.2: the two-loop recursion.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.disc import Disc, uniform_on_circle
from skinmap.geometry.triangles import cross_2d

Barrier = Callable[[FloatArray], tuple[float, FloatArray]]
ITERATIONS = 200  # near an isometry about 10 are enough
WILD = 8.0  # mean energy of a start, 4 for an isometry, from which others are tried
MEMORY = 8  # pairs of steps and changes of gradient kept
TOLERANCE = 1e-5  # of the excess energy: a step that gains less than this is the last
SAFE = 0.9  # share of the way to the first flip that a step may go
SUFFICIENT = 1e-4  # Armijo's share of the slope
HALVINGS = 30


def locally_injective_map(disc: Disc, *, iterations: int = ITERATIONS) -> FloatArray:
    """(n, 2) least symmetric Dirichlet energy from the best of our starts.

    That is the conformal one wherever it does not flip and distorts moderately; else the better
    of the as-rigid-as-possible and the convex one.
    """
    start = at_best_size(disc, disc.conformal)
    area = float(disc.areas.sum())
    if not energy_and_gradient(disc, start)[0] < WILD * area:
        rigid = as_rigid_as_possible(disc, disc.conformal, iterations=ROUNDS)
        others = [at_best_size(disc, uv) for uv in (rigid, uniform_on_circle(disc))]
        start = min([start, *others], key=lambda uv: energy_and_gradient(disc, uv)[0])
    return symmetric_dirichlet_descent(disc, start, iterations=iterations)


def symmetric_dirichlet_descent(
    disc: Disc,
    start: FloatArray,
    *,
    iterations: int = ITERATIONS,
    barrier: Barrier | None = None,
) -> FloatArray:
    """Less distorted flat coordinates than a start, every triangle keeping its side.

    Parameters
    ----------
    disc : Disc
    start : (n, 2) array of float
        Free of flips [m].
    iterations : int
        At most so many steps.
    barrier : callable, optional
        One more energy [m2] with its gradient (n, 2), of coordinates (n, 2).

    Returns
    -------
    (n, 2) array of float
        [m].
    """

    def objective(uv: FloatArray) -> tuple[float, FloatArray]:
        energy, gradient = energy_and_gradient(disc, uv)
        if barrier is None or not np.isfinite(energy):
            return energy, gradient
        added, slope = barrier(uv)
        return energy + added, gradient + slope

    uv = start
    energy, gradient = objective(uv)
    floor = 4.0 * float(disc.areas.sum())
    memory: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=MEMORY)
    for _ in range(iterations):
        direction = -_quasi_newton(disc, gradient, memory)
        moved = _line_search(disc, objective, uv, energy, gradient, direction)
        if moved is None:
            break
        before, step = energy, moved[0] - uv
        change = moved[2] - gradient
        uv, energy, gradient = moved
        if float(np.vdot(step, change)) > 0.0:
            memory.append((step, change))
        if before - energy <= TOLERANCE * (energy - floor):
            break
    return uv


def at_best_size(disc: Disc, uv: FloatArray) -> FloatArray:
    """The map times the factor of least energy: |J|^2 s^2 against |J^-1|^2 s^-2."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rows = disc.gradient @ uv
        square = np.einsum("ij,ij->i", rows, rows).reshape(-1, 2).sum(axis=1)
        inverse = square / cross_2d(rows[0::2], rows[1::2]) ** 2
        factor = (np.dot(disc.areas, inverse) / np.dot(disc.areas, square)) ** 0.25
    return uv * factor if np.isfinite(factor) and factor > 0 else uv


def energy_and_gradient(disc: Disc, uv: FloatArray) -> tuple[float, FloatArray]:
    """Symmetric Dirichlet energy [m2] and its gradient (n, 2); inf where a triangle flips."""
    rows = disc.gradient @ uv  # rows 2 f: derivative along x, 2 f + 1: along y
    along, across = rows[0::2], rows[1::2]
    det = cross_2d(along, across)
    if not (det > 0.0).all():
        return float("inf"), rows[:0]
    square = np.einsum("ij,ij->i", along, along) + np.einsum("ij,ij->i", across, across)
    inverse = 1.0 / (det * det)
    energy = float(np.dot(disc.areas, square * (1.0 + inverse)))
    # d/dJ of |J|^2 (1 + det^-2): 2 J (1 + det^-2) - 2 |J|^2 det^-3 cof(J).
    keep = (2.0 * disc.areas * (1.0 + inverse))[:, None]
    push = (2.0 * disc.areas * square * inverse / det)[:, None]
    slope = np.empty_like(rows)
    slope[0::2] = keep * along - push * np.column_stack([across[:, 1], -across[:, 0]])
    slope[1::2] = keep * across - push * np.column_stack([-along[:, 1], along[:, 0]])
    return energy, disc.divergence @ slope


def largest_step(uv: FloatArray, direction: FloatArray, faces: IntArray) -> float:
    """First step at which a triangle loses its area: the least positive root of a quadratic.

    Infinite where none ever does.
    """
    corner, motion = uv[faces], direction[faces]
    p, q = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    dp, dq = motion[:, 1] - motion[:, 0], motion[:, 2] - motion[:, 0]
    # Area (p + t dp) x (q + t dq) = c + b t + a t^2 with c > 0. With t = 1 / s the first root is
    # the largest s of c s^2 + b s + a, which is stable where a vanishes.
    a, b, c = cross_2d(dp, dq), cross_2d(p, dq) + cross_2d(dp, q), cross_2d(p, q)
    root = b * b - 4.0 * a * c
    real = root >= 0.0
    inverse = (-b[real] + np.sqrt(root[real])) / (2.0 * c[real])
    largest = float(inverse.max(initial=0.0))
    return 1.0 / largest if largest > 0.0 else float("inf")


def _quasi_newton(
    disc: Disc, gradient: FloatArray, memory: deque[tuple[FloatArray, FloatArray]]
) -> FloatArray:
    """Inverse Hessian times gradient: limited-memory BFGS round the inverse Laplacian."""
    right = gradient.copy()
    shares = []
    for step, change in reversed(memory):
        share = float(np.vdot(step, right)) / float(np.vdot(step, change))
        right -= share * change
        shares.append(share)
    # The second derivative of s^2 + s^-2 at s = 1 is 8.
    result = disc.solve_free(right) / 8.0
    for (step, change), share in zip(memory, reversed(shares), strict=True):
        result += (share - float(np.vdot(change, result)) / float(np.vdot(step, change))) * step
    return result


def _line_search(
    disc: Disc,
    objective: Barrier,
    uv: FloatArray,
    energy: float,
    gradient: FloatArray,
    direction: FloatArray,
) -> tuple[FloatArray, float, FloatArray] | None:
    """Backtracking from the full step, or from short of the first flip; None where stuck."""
    slope = float(np.vdot(gradient, direction))
    if not slope < 0.0:
        return None
    step = min(1.0, SAFE * largest_step(uv, direction, disc.faces))
    for _ in range(HALVINGS):
        moved = uv + step * direction
        reached, new_gradient = objective(moved)
        if reached <= energy + SUFFICIENT * step * slope:
            return moved, reached, new_gradient
        # The minimum of the parabola through what is known, kept within reason.
        curve = reached - energy - step * slope
        best = -0.5 * slope * step * step / curve if np.isfinite(curve) and curve > 0 else 0.0
        step = min(max(best, 0.1 * step), 0.5 * step)
    return None


# As-rigid-as-possible maps: rotations per triangle and one linear solve, in turns.
#
# Liu, Zhang, Xu, Gotsman and Gortler, "A Local/Global Approach to Mesh Parameterization",
# Symposium on Geometry Processing 2008.

ROUNDS = 5  # from a conformal start: more change the energy's excess by less than 1 %


def rigid_map(disc: Disc, *, iterations: int = ROUNDS) -> FloatArray:
    """(n, 2) as rigid as possible from the conformal start; that start where it flips."""
    uv = as_rigid_as_possible(disc, disc.conformal, iterations=iterations)
    return uv if disc.is_injective(uv) else disc.conformal


def as_rigid_as_possible(disc: Disc, start: FloatArray, *, iterations: int) -> FloatArray:
    """Flat coordinates (n, 2) after some rounds from a start (n, 2), all with one factor."""
    uv = start
    weights = np.repeat(disc.areas, 2)[:, None]
    for _ in range(iterations):
        turned = closest_rotations((disc.gradient @ uv).reshape(-1, 2, 2)).reshape(-1, 2)
        uv = disc.solve_free(disc.divergence @ (weights * turned))
    return uv


def closest_rotations(maps: FloatArray) -> FloatArray:
    """(m, 2, 2) rotation next to each plane map: its conformal part at unit size."""
    cosine = maps[:, 0, 0] + maps[:, 1, 1]
    sine = maps[:, 0, 1] - maps[:, 1, 0]
    size = np.hypot(cosine, sine)
    size[size == 0.0] = 1.0
    cosine, sine = cosine / size, sine / size
    return np.stack([cosine, sine, -sine, cosine], axis=1).reshape(-1, 2, 2)

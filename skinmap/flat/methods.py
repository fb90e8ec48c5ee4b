"""Flattening methods by name: each maps a disc to the plane, in the size of the disc.

A method is a function `(vertices (n, 3) [m], faces (m, 3), loop (b,)) -> uv (n, 2) [m]`; the
flattening around it centres and scales its input, splits patches, fills holes and checks what
comes back. Others are added through the entry-point group `skinmap.flatteners`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.flat.budget import within_budget
from skinmap.flat.dirichlet import (
    at_best_size,
    locally_injective_map,
    rigid_map,
    symmetric_dirichlet_descent,
)
from skinmap.flat.disc import Disc, harmonic_on_circle, uniform_on_circle
from skinmap.geometry.triangles import face_areas, signed_areas
from skinmap.registry import Registry

Flattener = Callable[[FloatArray, IntArray, IntArray], FloatArray]
flatteners: Registry[Flattener] = Registry("flattening method", "skinmap.flatteners")
SLIM_ITERATIONS = 5
MAX_SLIM = 20_000  # vertices: above, the factorisation that SLIM needs for each step is too dear
FROM_AFAR = 1000  # steps from a convex map: a strip of 2.5 turns needs 356
CLEAR = 0.3  # of the median border edge: within it the border pushes itself away


def on_disc(method: Callable[[Disc], FloatArray]) -> Flattener:
    """A method of a `Disc` as one of vertices, faces and loop."""

    @wraps(method)
    def flattener(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
        return method(Disc(vertices, faces, loop))

    _methods_of_discs[flattener] = method
    return flattener


_methods_of_discs: dict[Flattener, Callable[[Disc], FloatArray]] = {}


def check_effort(method: str, iterations: int | None) -> None:
    """Refuse iterations that a method cannot have.

    Raises
    ------
    InvalidArrayError
        Fewer than one iteration, not a whole number, or a method without iterations.
    """
    if iterations is None:
        return
    if not isinstance(iterations, int | np.integer) or iterations < 1:
        raise InvalidArrayError(f"iterations must be a whole number, 1 or more, got {iterations!r}")
    if method not in ITERATED:
        raise InvalidArrayError(
            f"iterations need one of the methods {', '.join(ITERATED)}, got {method!r}"
        )


def apply_flattener(name: str, disc: Disc, *, iterations: int | None = None) -> FloatArray:
    """Flat coordinates by the method of a name; ours share what the disc has computed before."""
    if iterations is not None:
        return ITERATED[name](disc, iterations)
    flattener = flatteners.get(name)
    if flattener in _methods_of_discs:
        return _methods_of_discs[flattener](disc)
    return np.asarray(flattener(disc.vertices, disc.faces, disc.loop), np.float64)


def lscm(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Least-squares conformal map, two border vertices far apart pinned, through libigl."""
    import igl

    far = loop[np.argmax(np.linalg.norm(vertices[loop] - vertices[loop[0]], axis=1))]
    other = loop[np.argmax(np.linalg.norm(vertices[loop] - vertices[far], axis=1))]
    span = float(np.linalg.norm(vertices[far] - vertices[other]))
    uv, _ = igl.lscm(vertices, faces, np.array([far, other]), np.array([[0.0, 0.0], [span, 0.0]]))
    uv = np.asarray(uv)
    size = face_areas(vertices, faces).sum() / max(abs(signed_areas(uv, faces).sum()), 1e-300)
    return uv * np.sqrt(size)


def accurate(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """SLIM on small discs, our own descent on the same energy on large ones."""
    if len(vertices) <= MAX_SLIM:
        return slim(vertices, faces, loop)
    return locally_injective_map(Disc(vertices, faces, loop))


def slim(
    vertices: FloatArray, faces: IntArray, loop: IntArray, *, iterations: int = SLIM_ITERATIONS
) -> FloatArray:
    """Scalable locally injective mapping (symmetric Dirichlet) from a BFF start, by libigl.

    Rabinovich et al., ACM Transactions on Graphics 36(2), 2017.
    """
    import igl

    start = Disc(vertices, faces, loop).conformal
    column = np.asfortranarray
    data = igl.slim_precompute(
        column(vertices),
        column(faces.astype(np.int32)),
        column(start),
        igl.MappingEnergyType.SYMMETRIC_DIRICHLET,
        np.zeros(0, np.int32),
        np.zeros((0, 2), order="F"),
        0.0,
    )
    return np.asarray(igl.slim_solve(data, iterations))


def bff(disc: Disc) -> FloatArray:
    """Boundary first flattening: conformal, the border keeps its lengths."""
    return disc.conformal


def bijective_map(disc: Disc, *, iterations: int = FROM_AFAR) -> FloatArray:
    """(n, 2) little symmetric Dirichlet energy [m], one to one on the whole disc.

    A map whose triangles all keep their side is one to one exactly where its border does not cross
    itself (a degree argument, for discs). The descent keeps both when it starts so, from a convex
    map, and refuses every step that crosses; a barrier between border vertices and border edges
    keeps it from getting stuck where they meet (Smith and Schaefer, "Bijective parameterization
    with free boundaries", ACM Transactions on Graphics 34(4), 2015).
    """
    start = at_best_size(disc, uniform_on_circle(disc))
    return symmetric_dirichlet_descent(disc, start, iterations=iterations, barrier=Barrier(disc))


class Barrier:
    """Energy between border vertices and the border edges that they are no end of."""

    def __init__(self, disc: Disc) -> None:
        self._disc = disc
        self._loop, self._next = disc.loop, np.roll(disc.loop, -1)
        sides = disc.vertices[self._next] - disc.vertices[self._loop]
        lengths = np.linalg.norm(sides, axis=1)
        self._clear = CLEAR * float(np.median(lengths))
        self._weight = float(disc.areas.sum()) / len(disc.loop)

    def __call__(self, uv: FloatArray) -> tuple[float, FloatArray]:
        """Energy [m2] and its gradient (n, 2); infinite where the border crosses itself."""
        gradient = np.zeros_like(uv)
        if not self._disc.is_border_simple(uv):
            return float("inf"), gradient
        point, edge = self._near(uv)
        p, a, b = uv[self._loop[point]], uv[self._loop[edge]], uv[self._next[edge]]
        along = b - a
        square = np.maximum(np.einsum("ij,ij->i", along, along), np.finfo(float).tiny)
        t = np.clip(np.einsum("ij,ij->i", p - a, along) / square, 0.0, 1.0)
        away = p - a - t[:, None] * along
        distance = np.linalg.norm(away, axis=1)
        near = distance < self._clear
        if not near.any():
            return 0.0, gradient
        point, edge, t, away, distance = (x[near] for x in (point, edge, t, away, distance))
        excess = self._clear / distance - 1.0
        slope = -2.0 * self._weight * excess * self._clear / distance**2
        push = (slope / distance)[:, None] * away
        np.add.at(gradient, self._loop[point], push)
        np.add.at(gradient, self._loop[edge], -(1.0 - t)[:, None] * push)
        np.add.at(gradient, self._next[edge], -t[:, None] * push)
        return float(self._weight * (excess**2).sum()), gradient

    def _near(self, uv: FloatArray) -> tuple[np.ndarray, np.ndarray]:
        """(k,) border vertices and (k,) border edges that may be closer than the clearance."""
        start, end = uv[self._loop], uv[self._next]
        reach = self._clear + 0.5 * float(np.linalg.norm(end - start, axis=1).max())
        found = cKDTree(0.5 * (start + end)).query_ball_point(start, reach)
        point = np.repeat(np.arange(len(found)), [len(one) for one in found])
        edge = np.concatenate([np.asarray(one, np.int64) for one in found])
        n = len(self._loop)
        apart = (edge != point) & ((edge + 1) % n != point)
        return point[apart], edge[apart]


OWN: dict[str, Flattener] = {
    "tutte": on_disc(uniform_on_circle),
    "harmonic": on_disc(harmonic_on_circle),
    "lscm": lscm,
    "bff": on_disc(bff),
    "arap": on_disc(rigid_map),
    "slim": slim,
    "dirichlet": on_disc(locally_injective_map),
    "bijective": on_disc(bijective_map),
    "fast": on_disc(bff),
    "balanced": on_disc(rigid_map),
    "accurate": accurate,
    "auto": on_disc(lambda disc: within_budget(disc).uv),
}
# Methods that go on as long as they are told to.
ITERATED: dict[str, Callable[[Disc, int], FloatArray]] = {
    "arap": lambda disc, n: rigid_map(disc, iterations=n),
    "balanced": lambda disc, n: rigid_map(disc, iterations=n),
    "slim": lambda disc, n: slim(disc.vertices, disc.faces, disc.loop, iterations=n),
    "dirichlet": lambda disc, n: locally_injective_map(disc, iterations=n),
    "bijective": lambda disc, n: bijective_map(disc, iterations=n),
}
for _name, _method in OWN.items():
    flatteners.register(_name)(_method)

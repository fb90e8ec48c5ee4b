"""Flattening methods by name: each maps a disc to the plane, in the size of the disc.

A method is a function `(vertices (n, 3) [m], faces (m, 3), loop (b,)) -> uv (n, 2) [m]`; the
flattening around it centres and scales its input, splits patches, fills holes and checks what
comes back. Others are added through the entry-point group `skinmap.flatteners`.

`auto`: the method that a budget of time or of error pays for, by measured cost.

One surface with a border laid flat: checks before, the method, checks after, a fallback.
"""

from __future__ import annotations

import logging
import math
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray, check_faces, check_points
from skinmap.errors import FlatteningError, InvalidArrayError, InvalidMeshError, SkinWarning
from skinmap.flat.dirichlet import (
    at_best_size,
    locally_injective_map,
    rigid_map,
    symmetric_dirichlet_descent,
)
from skinmap.flat.disc import Disc, harmonic_on_circle, uniform_on_circle
from skinmap.flat.distortion import edge_rms
from skinmap.geometry.topology import check_surface, loop_length, loops_by_length
from skinmap.geometry.triangles import face_areas, signed_areas, vertex_normals
from skinmap.registry import Registry
from skinmap.surface.consensus_meshing import close_loop, used_chords

# CPU seconds (s, p) as s (n / 100,000)^p; what `balanced` and `dirichlet` add to `fast`, which is
# their start. From "cost_model" of benchmarks/results/geometry.json, by `make bench-geometry`.
# What a method really takes is scaled by what `fast` took on the machine and the mesh at hand.
COSTS = {"fast": (0.83, 1.17), "balanced": (0.87, 1.18), "dirichlet": (1.41, 1.13)}
SMALLEST = 1e-3  # seconds: no disc takes less
CHEAP = 0.1  # seconds: without a budget, the most that `dirichlet` may take beside `fast`


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    """What `auto` took.

    Attributes
    ----------
    uv : (n, 2) float
        [m].
    method : str
    reason : str
        Why, with the figures.
    met : bool
        Whether the result keeps to the budget.
    """

    uv: FloatArray
    method: str
    reason: str
    met: bool


def check_budget(method: str, budgets: Mapping[str, float | None]) -> None:
    """Refuse budgets that are not positive, or that no choice follows.

    Parameters
    ----------
    method : str
    budgets : mapping of str to float
        Under the names that the user has for them: keywords, or options.

    Raises
    ------
    InvalidArrayError
    """
    for name, value in budgets.items():
        if value is None:
            continue
        if not 0.0 < value < math.inf:
            raise InvalidArrayError(f"{name} must be above 0 and finite, got {value:g}")
        if method != "auto":
            auto = "--method auto" if name.startswith("-") else "method 'auto'"
            raise InvalidArrayError(f"{name} needs {auto}, got {method!r}")


def predicted_seconds(method: str, n: int) -> float:
    """CPU time that a method adds for a disc of n vertices on the machine of the benchmark."""
    seconds, exponent = COSTS[method]
    return max(seconds * (n / 1e5) ** exponent, SMALLEST)


def within_budget(
    disc: Disc, *, max_seconds: float | None = None, max_edge_rms: float | None = None
) -> Choice:
    """Map a disc by the method that suits a budget; the nearest there is where none does.

    `fast` runs first, as the start of the others and to see how quick this machine is. With a
    limit of error the next dearer method follows while the limit is not met and the time lasts;
    with a limit of time alone, the best that is expected to fit; without either, `dirichlet`
    where it is cheap and `balanced` elsewhere.

    Parameters
    ----------
    disc : Disc
    max_seconds : float, optional
        CPU time of one thread [s].
    max_edge_rms : float, optional
        Root mean square of the edge strain, 0.01 for 1 %.
    """
    started = time.process_time()
    maps = {"fast": disc.conformal}
    pace = (time.process_time() - started) / predicted_seconds("fast", len(disc.vertices))
    limit = float("inf") if max_seconds is None else max_seconds
    cheap = pace * predicted_seconds("dirichlet", len(disc.vertices)) <= CHEAP
    order = ["dirichlet"] if cheap else ["balanced"]  # those that are worth trying
    if max_edge_rms is not None:
        order = ["balanced", "dirichlet"]
    elif max_seconds is not None:
        order = ["dirichlet", "balanced"]
    for method in order:
        if max_edge_rms is not None and _best(disc, maps)[1] <= max_edge_rms:
            break
        spent = time.process_time() - started
        if spent + pace * predicted_seconds(method, len(disc.vertices)) <= limit:
            maps[method] = OWN[method](disc)
            if max_edge_rms is None and disc.is_injective(maps[method]):
                return _explain(disc, maps, method, started, max_seconds, max_edge_rms)
    return _explain(disc, maps, _best(disc, maps)[0], started, max_seconds, max_edge_rms)


def _best(disc: Disc, maps: dict[str, FloatArray]) -> tuple[str, float]:
    """Name and error of the map with least edge error among those that do not flip."""
    errors = {
        name: edge_rms(disc.vertices, disc.faces, uv) if disc.is_injective(uv) else float("inf")
        for name, uv in maps.items()
    }
    name = min(errors, key=lambda key: errors[key])
    return name, errors[name]


def _explain(
    disc: Disc,
    maps: dict[str, FloatArray],
    method: str,
    started: float,
    max_seconds: float | None,
    max_edge_rms: float | None,
) -> Choice:
    error = edge_rms(disc.vertices, disc.faces, maps[method])
    spent = time.process_time() - started
    words, met = [], True
    if max_seconds is not None:
        met &= spent <= max_seconds
        words.append(f"{spent:.3g} s of {max_seconds:.3g} s")
    if max_edge_rms is not None:
        met &= error <= max_edge_rms
        words.append(f"edge rms {100 * error:.3g} % of {100 * max_edge_rms:.3g} %")
    if not words:
        words = ["no budget, the most accurate that is cheap" if method == "dirichlet" else
                 "no budget, the default"]  # fmt: skip
    tried = ", ".join(maps)
    return Choice(maps[method], method, f"{'; '.join(words)}; tried {tried}", bool(met))


Flattener = Callable[[FloatArray, IntArray, IntArray], FloatArray]
flatteners: Registry[Flattener] = Registry("flattening method", "skinmap.flatteners")
SLIM_ITERATIONS = 5
MAX_SLIM = 20_000  # vertices: above, the factorisation that SLIM needs for each step is too dear
FROM_AFAR = 1000  # steps from a convex map: a strip of 2.5 turns needs 356
CLEAR = 0.3  # of the median border edge: within it the border pushes itself away


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
    flattener = flatteners.get(name)
    if getattr(flattener, "__wrapped__", flattener) is OWN.get(name):
        return OWN[name](disc) if iterations is None else OWN[name](disc, iterations=iterations)
    return np.asarray(flattener(disc.vertices, disc.faces, disc.loop), np.float64)


def lscm(disc: Disc) -> FloatArray:
    """Least-squares conformal map, two border vertices far apart pinned, through libigl."""
    import igl

    vertices, faces, loop = disc.vertices, disc.faces, disc.loop
    far = loop[np.argmax(np.linalg.norm(vertices[loop] - vertices[loop[0]], axis=1))]
    other = loop[np.argmax(np.linalg.norm(vertices[loop] - vertices[far], axis=1))]
    span = float(np.linalg.norm(vertices[far] - vertices[other]))
    uv, _ = igl.lscm(vertices, faces, np.array([far, other]), np.array([[0.0, 0.0], [span, 0.0]]))
    uv = np.asarray(uv)
    size = face_areas(vertices, faces).sum() / max(abs(signed_areas(uv, faces).sum()), 1e-300)
    return uv * np.sqrt(size)


def accurate(disc: Disc) -> FloatArray:
    """SLIM on small discs, our own descent on the same energy on large ones."""
    return slim(disc) if len(disc.vertices) <= MAX_SLIM else locally_injective_map(disc)


def slim(disc: Disc, *, iterations: int = SLIM_ITERATIONS) -> FloatArray:
    """Scalable locally injective mapping (symmetric Dirichlet) from a BFF start, by libigl.

    Rabinovich et al., ACM Transactions on Graphics 36(2), 2017.
    """
    import igl

    column = np.asfortranarray
    data = igl.slim_precompute(
        column(disc.vertices),
        column(disc.faces.astype(np.int32)),
        column(disc.conformal),
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


OWN: dict[str, Callable[..., FloatArray]] = {  # of a disc
    "tutte": uniform_on_circle,
    "harmonic": harmonic_on_circle,
    "lscm": lscm,
    "bff": bff,
    "arap": rigid_map,
    "slim": slim,
    "dirichlet": locally_injective_map,
    "bijective": bijective_map,
    "fast": bff,
    "balanced": rigid_map,
    "accurate": accurate,
    "auto": lambda disc: within_budget(disc).uv,
}
ITERATED = ("arap", "balanced", "slim", "dirichlet", "bijective")  # on and on, as they are told to


def on_disc(method: Callable[[Disc], FloatArray]) -> Flattener:
    """A method of a `Disc` as one of vertices, faces and loop."""

    @wraps(method)
    def flattener(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
        return method(Disc(vertices, faces, loop))

    return flattener


for _name, _method in OWN.items():
    flatteners.register(_name)(on_disc(_method))


logger = logging.getLogger(__name__)

DEFAULT = "balanced"
HOLE_SHARE = 0.35  # a hole's length against the border's: up to here it is filled for the solve
FALLBACKS = ("bff", "dirichlet", "bijective", "tutte")  # the last never flips but for rounding
ONE_TO_ONE = ("bijective", "tutte")  # what may mend a map that overlaps itself
NO_AREA = 1e-12  # smallest altitude against the size of the surface that numbers still resolve


@dataclass(frozen=True, eq=False, slots=True)
class DiscMap:
    """A flat map that passed our checks.

    Attributes
    ----------
    uv : (n, 2) float
        Finite and free of flips [m].
    method : str
        The method that made it.
    fallback : bool
        Whether the method asked for failed and this is another.
    holes : int
        Boundary loops beside the outer one.
    reason : str
        Why this method, where `auto` chose it; otherwise empty.
    """

    uv: FloatArray
    method: str
    fallback: bool
    holes: int
    reason: str = ""


def flatten_disc(
    vertices: FloatArray, faces: IntArray, *, method: str = DEFAULT, where: str = "mesh"
) -> tuple[FloatArray, str, int]:
    """Flat coordinates, method and number of holes of `map_disc`, without a budget."""
    flat = map_disc(vertices, faces, method=method, where=where)
    return flat.uv, flat.method, flat.holes


def map_disc(
    vertices: FloatArray,
    faces: IntArray,
    *,
    method: str = DEFAULT,
    where: str = "mesh",
    max_seconds: float | None = None,
    max_edge_rms: float | None = None,
    iterations: int | None = None,
    may_overlap: bool = False,
) -> DiscMap:
    """Flatten one connected surface with a border; small holes are filled for the solve.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m]; every vertex belongs to a face.
    faces : (m, 3) array of int
    method : str
        One of `flatteners.names()`.
    where : str
        How messages call it.
    max_seconds : float, optional
        For `auto`: CPU time to keep to [s].
    max_edge_rms : float, optional
        For `auto`: edge error to reach, 0.01 for 1 %.
    iterations : int, optional
        Of a method that has them, instead of its own number.
    may_overlap : bool
        Leave a map that lies over itself as it is: for trials, mending takes long.

    Raises
    ------
    InvalidArrayError, InvalidMeshError
        Iterations that the method cannot have; values that are not finite,
        vertices that no face uses, faces that are no surface.
    FlatteningError
        No border, a hole too wide to fill (a tube), a triangle without area, or one that no
        method keeps from flipping.
    """
    check_effort(method, iterations)
    disc, size, holes = _prepare(vertices, faces, where)
    if method == "auto":
        choice = _choose(disc, max_seconds, max_edge_rms)
        if choice is not None:
            if not choice.met:
                words = f"{where}: no method keeps to the budget; {choice.method} comes nearest"
                warnings.warn(f"{words} ({choice.reason})", SkinWarning, stacklevel=3)
            return DiscMap(choice.uv * size, choice.method, False, holes, choice.reason)
    overlapped = False
    for name in (method, *FALLBACKS):
        if overlapped and name not in ONE_TO_ONE:
            continue
        uv = _attempt(name, disc, iterations if name == method else None)
        if uv is not None and (may_overlap or not disc.overlaps(uv)):
            break
        overlapped |= uv is not None
    else:
        raise FlatteningError(f"{where}: neither {method} nor a convex map is free of flips")
    if name != method:
        what = "overlaps itself" if overlapped else "flips or fails"
        warnings.warn(f"{where}: {method} {what}, {name} is used", SkinWarning, stacklevel=3)
    return DiscMap(uv * size, name, name != method, holes)


def _choose(disc: Disc, max_seconds: float | None, max_edge_rms: float | None) -> Choice | None:
    """What `auto` takes; None where it fails or flips."""
    try:
        choice = within_budget(disc, max_seconds=max_seconds, max_edge_rms=max_edge_rms)
    except (ArithmeticError, ValueError, RuntimeError):  # a singular matrix, whatever it is called
        logger.info("flattening method auto fails", exc_info=True)
        return None
    return choice if disc.is_injective(choice.uv) and not disc.overlaps(choice.uv) else None


def _attempt(name: str, disc: Disc, iterations: int | None) -> FloatArray | None:
    """Coordinates (n, 2) by one method; None where it fails, flips or is not finite."""
    try:
        uv = apply_flattener(name, disc, iterations=iterations)
    except Exception as error:  # what a library or a plug-in stumbles over, another may not
        if isinstance(error, TypeError) and name in OWN:  # a fault of the call, not of the surface
            raise
        logger.info("flattening method %s fails", name, exc_info=True)
        return None
    return uv if disc.is_injective(uv) else None


def _prepare(vertices: FloatArray, faces: IntArray, where: str) -> tuple[Disc, float, int]:
    """The surface at unit size round its centre, holes filled; its size [m] and holes."""
    _check_input(vertices, faces, where)
    loops = loops_by_length(vertices, faces)
    if not loops:
        raise FlatteningError(f"{where} is closed: cut it open first")
    filled, normals = [faces], vertex_normals(vertices, faces)
    for loop in loops[1:]:
        if loop_length(vertices, loop) > HOLE_SHARE * loop_length(vertices, loops[0]):
            raise FlatteningError(f"{where} is a tube or has a wide hole: cut it open first")
        used = used_chords(np.concatenate(filled), loop)
        closed = close_loop(vertices, normals, loop, used=used)
        filled.append(closed if len(closed) else close_loop(vertices, normals, loop))
    centre, size = vertices.mean(axis=0), float(np.ptp(vertices, axis=0).max())
    disc = Disc((vertices - centre) / (size or 1.0), np.concatenate(filled), loops[0])
    if disc.smallest_altitudes[: len(faces)].min() <= NO_AREA:
        raise FlatteningError(f"{where} has a triangle without area")
    # Every vertex is used and every edge lies in two faces but for those of the outer loop.
    edges = (3 * len(disc.faces) + len(loops[0])) // 2
    if (number := len(vertices) - edges + len(disc.faces)) != 1:
        raise FlatteningError(f"{where} is not a disc: Euler number {number}")
    return disc, size, len(loops) - 1


def _check_input(vertices: FloatArray, faces: IntArray, where: str) -> None:
    if len(faces) == 0:
        raise FlatteningError(f"{where} has no faces")
    check_points(vertices, f"vertices of {where}")
    check_faces(faces, len(vertices))
    unused = np.setdiff1d(np.arange(len(vertices)), faces)
    if len(unused):
        raise InvalidMeshError(f"vertex {unused[0]} belongs to no face of {where}: drop it first")
    check_surface(faces)

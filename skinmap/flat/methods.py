"""Flattening methods by name: each maps a disc to the plane, in the size of the disc.

A method is a function `(vertices (n, 3) [m], faces (m, 3), loop (b,)) -> uv (n, 2) [m]`; the
flattening around it centres and scales its input, splits patches, fills holes and checks what
comes back. Others are added through the entry-point group `skinmap.flatteners`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.budget import within_budget
from skinmap.flat.convex import harmonic_on_circle, uniform_on_circle
from skinmap.flat.dirichlet import locally_injective_map
from skinmap.flat.disc import Disc
from skinmap.flat.local_global import rigid_map
from skinmap.geometry.triangles import face_areas, signed_areas
from skinmap.registry import Registry

Flattener = Callable[[FloatArray, IntArray, IntArray], FloatArray]
flatteners: Registry[Flattener] = Registry("flattening method", "skinmap.flatteners")
SLIM_ITERATIONS = 5
MOST_SLIM = 20_000  # vertices: above, the factorisation that SLIM needs for each step is too dear


def flattener_names() -> tuple[str, ...]:
    """Names of the flattening methods, those of plug-ins included."""
    return flatteners.names()


def on_disc(method: Callable[[Disc], FloatArray]) -> Flattener:
    """A method of a `Disc` as one of vertices, faces and loop."""

    @wraps(method)
    def flattener(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
        return method(Disc(vertices, faces, loop))

    _methods_of_discs[flattener] = method
    return flattener


_methods_of_discs: dict[Flattener, Callable[[Disc], FloatArray]] = {}


def apply_flattener(name: str, disc: Disc) -> FloatArray:
    """Flat coordinates by the method of a name; ours share what the disc has computed before."""
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
    if len(vertices) <= MOST_SLIM:
        return slim(vertices, faces, loop)
    return locally_injective_map(Disc(vertices, faces, loop))


def slim(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
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
    return np.asarray(igl.slim_solve(data, SLIM_ITERATIONS))


def bff(disc: Disc) -> FloatArray:
    """Boundary first flattening: conformal, the border keeps its lengths."""
    return disc.conformal


OWN: dict[str, Flattener] = {
    "tutte": on_disc(uniform_on_circle),
    "harmonic": on_disc(harmonic_on_circle),
    "lscm": lscm,
    "bff": on_disc(bff),
    "arap": on_disc(rigid_map),
    "slim": slim,
    "dirichlet": on_disc(locally_injective_map),
    "fast": on_disc(bff),
    "balanced": on_disc(rigid_map),
    "accurate": accurate,
    "auto": on_disc(lambda disc: within_budget(disc).uv),
}
for _name, _method in OWN.items():
    flatteners.register(_name)(_method)

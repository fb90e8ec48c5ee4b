"""Flattening methods by name: each maps a disc to the plane, in the size of the disc.

A method is a function `(vertices (n, 3) [m], faces (m, 3), loop (b,)) -> uv (n, 2) [m]`; the
flattening around it centres and scales its input, splits patches, fills holes and checks what
comes back. Others are added through the entry-point group `skinmap.flatteners`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array, diags_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.dirichlet import symmetric_dirichlet_descent
from skinmap.flat.disc import Disc
from skinmap.flat.factorisation import factorise
from skinmap.flat.local_global import as_rigid_as_possible
from skinmap.geometry.topology import edges
from skinmap.geometry.triangles import face_areas, signed_areas
from skinmap.registry import Registry

Flattener = Callable[[FloatArray, IntArray, IntArray], FloatArray]
flatteners: Registry[Flattener] = Registry("flattening method", "skinmap.flatteners")
ARAP_ITERATIONS = 10
SLIM_ITERATIONS = 5
MOST_SLIM = 20_000  # vertices: above, our descent reaches less energy than SLIM in less time
CONVEX_ITERATIONS = 300  # steps from a convex start, which is far from the goal


def flattener_names() -> tuple[str, ...]:
    """Names of the flattening methods, those of plug-ins included."""
    return flatteners.names()


def tutte(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Uniform-weight embedding on a circle: never flips, always stretches."""
    n = len(vertices)
    pairs = edges(faces)
    ones = np.ones(len(pairs))
    half = coo_array((ones, pairs.T), shape=(n, n)).tocsc()
    degree = np.bincount(pairs.ravel(), minlength=n)
    laplacian = (diags_array(degree.astype(float)) - half - half.T).tocsc()
    inside = np.ones(n, bool)
    inside[loop] = False
    uv = np.zeros((n, 2))
    uv[loop] = _circle(vertices, faces, loop)
    if inside.any():
        rows = laplacian[inside]
        uv[inside] = factorise(rows[:, inside])(-(rows[:, loop] @ uv[loop]))
    return uv


def harmonic(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Cotangent-weight embedding on a circle, through libigl."""
    import igl

    return np.asarray(igl.harmonic(vertices, faces, loop, _circle(vertices, faces, loop), 1))


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


def bff(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Boundary first flattening: conformal, the border keeps its lengths."""
    return Disc(vertices, faces, loop).conformal


def arap(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """As rigid as possible from a BFF start; BFF itself where it flips."""
    return rigid(Disc(vertices, faces, loop))


def dirichlet(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Least symmetric Dirichlet energy from a BFF start, or from a convex one where BFF flips."""
    return locally_injective(Disc(vertices, faces, loop))


def accurate(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """SLIM on small discs, our own descent on the same energy on large ones."""
    return (slim if len(vertices) <= MOST_SLIM else dirichlet)(vertices, faces, loop)


def rigid(disc: Disc) -> FloatArray:
    """The `balanced` map (n, 2) of a disc whose operators are shared."""
    uv = as_rigid_as_possible(disc, disc.conformal, iterations=ARAP_ITERATIONS)
    return uv if is_injective(uv, disc.faces) else disc.conformal


def locally_injective(disc: Disc) -> FloatArray:
    """The `dirichlet` map (n, 2) of a disc whose operators are shared."""
    if is_injective(disc.conformal, disc.faces):
        return symmetric_dirichlet_descent(disc, disc.conformal)
    start = tutte(disc.vertices, disc.faces, disc.loop)
    return symmetric_dirichlet_descent(disc, start, iterations=CONVEX_ITERATIONS)


def is_injective(uv: FloatArray, faces: IntArray) -> bool:
    """Whether flat coordinates (n, 2) are finite and no triangle is turned over or without area."""
    return bool(np.isfinite(uv).all()) and bool((signed_areas(uv, faces) > 0.0).all())


def slim(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Scalable locally injective mapping (symmetric Dirichlet) from a BFF start, by libigl.

    Rabinovich et al., ACM Transactions on Graphics 36(2), 2017.
    """
    import igl

    start = bff(vertices, faces, loop)
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


def _circle(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Border positions (b, 2) on a circle of the area of the mesh, spaced by length."""
    length = np.linalg.norm(vertices[np.roll(loop, -1)] - vertices[loop], axis=1)
    angle = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(length)[:-1]]) / length.sum()
    radius = np.sqrt(face_areas(vertices, faces).sum() / np.pi)
    return np.asarray(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


OWN: dict[str, Flattener] = {
    "tutte": tutte,
    "harmonic": harmonic,
    "lscm": lscm,
    "bff": bff,
    "arap": arap,
    "slim": slim,
    "dirichlet": dirichlet,
    "fast": bff,
    "balanced": arap,
    "accurate": accurate,
}
for _name, _method in OWN.items():
    flatteners.register(_name)(_method)

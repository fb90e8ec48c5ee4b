"""Flattening methods by name: each maps a disc to the plane, in the size of the disc.

A method is a function `(vertices (n, 3) [m], faces (m, 3), loop (b,)) -> uv (n, 2) [m]`; the
flattening around it centres and scales its input, splits patches, fills holes and checks what
comes back. Others are added through the entry-point group `skinmap.flatteners`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.bff import bff
from skinmap.geometry.triangles import face_areas, signed_areas
from skinmap.registry import Registry

Flattener = Callable[[FloatArray, IntArray, IntArray], FloatArray]
flatteners: Registry[Flattener] = Registry("flattening method", "skinmap.flatteners")
ARAP_ITERATIONS = 10
SLIM_ITERATIONS = 5
flatteners.register("bff")(bff)
flatteners.register("fast")(bff)


def flattener_names() -> tuple[str, ...]:
    """Names of the flattening methods, those of plug-ins included."""
    return flatteners.names()


@flatteners.register("tutte")
def tutte(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Uniform-weight embedding on a circle: never flips, always stretches."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import spsolve

    from skinmap.geometry.topology import edges

    pairs = edges(faces)
    ones = np.ones(len(pairs))
    graph = coo_array((ones, pairs.T), shape=(len(vertices),) * 2).tocsr()
    graph = graph + graph.T
    from scipy.sparse import diags_array

    laplacian = (diags_array(np.asarray(graph.sum(axis=1)).ravel()) - graph).tocsc()
    inner = np.setdiff1d(np.arange(len(vertices)), loop)
    uv = np.zeros((len(vertices), 2))
    uv[loop] = _circle(vertices, faces, loop)
    if len(inner):
        uv[inner] = spsolve(
            laplacian[inner][:, inner], -(laplacian[inner][:, loop] @ uv[loop])
        ).reshape(-1, 2)
    return uv


@flatteners.register("harmonic")
def harmonic(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """Cotangent-weight embedding on a circle, through libigl."""
    import igl

    return np.asarray(igl.harmonic(vertices, faces, loop, _circle(vertices, faces, loop), 1))


@flatteners.register("lscm")
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


@flatteners.register("arap")
@flatteners.register("balanced")
def arap(vertices: FloatArray, faces: IntArray, loop: IntArray) -> FloatArray:
    """As rigid as possible from a BFF start, through libigl; BFF itself where it flips.

    Liu et al., "A Local/Global Approach to Mesh Parameterization", SGP 2008.
    """
    import igl

    start = bff(vertices, faces, loop)
    data = igl.ARAPData()
    data.max_iter = ARAP_ITERATIONS
    # One pinned vertex: without it the global step is singular and fails on some patches.
    igl.arap_precomputation(vertices, faces, 2, np.array([0], np.int32), data)
    uv = np.asarray(igl.arap_solve(start[[0]], data, start))
    good = bool(np.isfinite(uv).all()) and bool((signed_areas(uv, faces) > 0).all())
    return uv if good else start


@flatteners.register("slim")
@flatteners.register("accurate")
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

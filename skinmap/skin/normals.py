"""Repair of normals: files store placeholders, so estimate them from the positions."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError, SkinWarning
from skinmap.geometry.proximity import (
    closest_on_mesh,
    median_spacing,
    nearest,
    neighbour_graph,
    ray_hits,
)
from skinmap.geometry.triangles import TriangleMesh, face_normals, unit

NEIGHBOURS = 10  # two rings of a hexagonal lattice, half of them missing at a border
PATCH_GAP = 2.5  # in spacings: further apart, points belong to different patches
CLOSE = 1e-4  # nearer to the body a lone taxel lies on it [m]
INWARD = 0.02  # share of normals that may point into the body before others are looked at
LIFT = 0.3  # in spacings (2 mm on the iCub): past the cover that taxels lie on or just under


def patch_labels(points: FloatArray) -> IntArray:
    """(n,) label of the connected patch of each point, by the gap between points alone."""
    limit = PATCH_GAP * median_spacing(points)
    _, label = connected_components(neighbour_graph(points, NEIGHBOURS, limit), directed=False)
    return np.asarray(label, np.int64)


def estimate_normals(points: FloatArray, k: int = NEIGHBOURS) -> FloatArray:
    """(n, 3) unit normals of unknown sign: the direction of least variance of the k nearest.

    References
    ----------
    Hoppe et al., "Surface Reconstruction from Unorganized Points", SIGGRAPH 1992.
    """
    _, index = nearest(points, k)
    hood = points[np.column_stack([np.arange(len(points)), index])]
    centred = hood - hood.mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred))
    return np.ascontiguousarray(vectors[:, :, 0])


def orient_normals(points: FloatArray, normals: FloatArray, labels: IntArray) -> FloatArray:
    """Normals that agree in sign within each patch.

    The sign spreads along a minimum spanning tree with the weight 1 - |n_i . n_j|, so that it
    crosses sharp bends last (Hoppe 1992).
    """
    weight = neighbour_graph(points, NEIGHBOURS, PATCH_GAP * median_spacing(points)).tocoo()
    dots = np.abs(np.einsum("ij,ij->i", normals[weight.row], normals[weight.col]))
    weight.data = 1.0 - np.minimum(dots, 1.0) + 1e-9  # a stored zero would read as no edge
    tree = minimum_spanning_tree(weight.tocsr()).tocoo()
    # One more point beside the first of each patch, so that a single walk visits all patches.
    n = len(points)
    roots = np.unique(labels, return_index=True)[1]
    row, column = np.append(tree.row, np.full(len(roots), n)), np.append(tree.col, roots)
    walk = coo_array((np.ones(len(row)), (row, column)), shape=(n + 1, n + 1)).tocsr()
    order, parent = breadth_first_order(walk, n, directed=False)
    oriented = normals.copy()
    for child in order[1 + len(roots) :]:
        if oriented[child] @ oriented[parent[child]] < 0:
            oriented[child] *= -1
    return oriented


def hidden_views(
    points: FloatArray, normals: FloatArray, body: TriangleMesh
) -> tuple[BoolArray, BoolArray]:
    """Whether (n,) a body hides the view along each normal, and that against it."""
    lift = normals * (LIFT * median_spacing(points))
    above = ray_hits(points + lift, normals, body.vertices, body.faces)
    return above, ray_hits(points - lift, -normals, body.vertices, body.faces)


def less_hidden(
    points: FloatArray, normals: FloatArray, given: FloatArray, body: TriangleMesh
) -> FloatArray:
    """Normals (n, 3), or those that are given where these point into the body less often.

    Estimates mix the two sides of a thin body, such as a palm and its back. Where none are given,
    those of the body's nearest faces are tried.
    """

    def inward(some: FloatArray) -> float:
        above, below = hidden_views(points, some, body)
        return float((above & ~below).mean())

    if len(points) < 3 or (wrong := inward(normals)) <= INWARD:
        return normals
    known = np.allclose(np.linalg.norm(given, axis=1), 1.0, atol=0.1)
    others = unit(given) if known else _lone_normals(points, body, None)
    return others if inward(others) < wrong / 2 else normals


def outward_normals(
    points: FloatArray,
    normals: FloatArray,
    labels: IntArray,
    body: TriangleMesh | None,
    hint: FloatArray | None = None,
) -> FloatArray:
    """Normals turned to the side from which the body does not hide the skin, patch by patch.

    From just above each taxel one ray goes out along the normal and one against it; the side
    on which fewer rays meet the body is the outside. Link meshes are open and double-walled,
    so the sign of the nearest face says nothing. Without a body a hint (n, 3) decides, such as
    the normals of fitted modules; without that, away from the middle of all points: a guess,
    right for limbs and wrong for a flat board, so it warns.
    """
    outward = normals.copy()
    if (body is None or len(body.faces) == 0) and hint is not None:
        margin = np.einsum("ij,ij->i", hint, normals)
    elif body is None or len(body.faces) == 0:
        warnings.warn(
            "no body mesh: normals point away from the middle of the taxels, which is a guess",
            SkinWarning,
            stacklevel=2,
        )
        margin = np.einsum("ij,ij->i", points - points.mean(axis=0), normals)
    else:
        above, below = hidden_views(points, normals, body)
        margin = below.astype(np.float64) - above
    patch = np.unique(labels, return_inverse=True)[1]
    outward[np.bincount(patch, margin)[patch] < 0] *= -1
    return outward


def repair_normals(
    points: FloatArray, body: TriangleMesh | None, hint: FloatArray | None = None
) -> FloatArray:
    """(n, 3) unit normals estimated from positions (n, 3) [m], consistent and outward.

    `hint` (n, 3) are rough outward directions for where there is no body. One or two taxels span
    no surface: theirs are the hints, or those of the body's nearest faces.

    Raises
    ------
    InvalidArrayError
        One or two points without hint and body, or more on one line: no surface there.
    """
    if on_a_line(points):
        return _lone_normals(points, body, hint)
    labels = patch_labels(points)
    oriented = orient_normals(points, estimate_normals(points), labels)
    return outward_normals(points, oriented, labels, body, hint)


def on_a_line(points: FloatArray) -> bool:
    """Whether points (n, 3) span no surface."""
    centred = points - points.mean(axis=0) if len(points) else points
    return len(points) < 3 or np.linalg.matrix_rank(centred, tol=1e-9 * np.abs(centred).max()) < 2


def along_line(points: FloatArray) -> FloatArray:
    """(n,) places of points (n, 3) on the line through them, from the first one [m]."""
    away = points - points[0]
    return np.asarray(away @ unit(away[np.argmax(np.linalg.norm(away, axis=1))]))


def _lone_normals(
    points: FloatArray, body: TriangleMesh | None, hint: FloatArray | None
) -> FloatArray:
    """(n, 3) unit normals of one or two taxels."""
    known = unit(np.zeros_like(points) if hint is None else np.asarray(hint, np.float64))
    rows = np.flatnonzero(~known.any(axis=1))
    if len(rows) and (body is None or len(body.faces) == 0):
        raise InvalidArrayError(
            f"{len(points)} taxels that span no surface: no normals there; write them in the table"
        )
    if len(rows) and body is not None:
        distance, face, closest = closest_on_mesh(points[rows], body.vertices, body.faces)
        own = unit(face_normals(body.vertices, body.faces)[face])
        away = unit(points[rows] - closest)
        # A taxel above the face shows the side; where it lies on it, the face does.
        above = (np.einsum("ij,ij->i", own, away) < 0) & (distance > CLOSE)
        own[above] *= -1
        known[rows] = own
    return known

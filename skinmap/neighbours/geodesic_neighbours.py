"""Neighbourhoods along the skin: what lies across a fold is as far as the way round it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.log_map import log_map
from skinmap.geometry.proximity import edge_graph
from skinmap.geometry.triangles import unit
from skinmap.neighbours.offsets import BAND, Neighbourhoods, gathered, reference_frames
from skinmap.surface.surface_mesh import SurfaceMesh

DETOUR = 1.5  # ways along edges are longer than straight ones by less


def geodesic_neighbourhoods(
    mesh: SurfaceMesh, reference: FloatArray, *, radius: float, band: float = BAND
) -> Neighbourhoods:
    """Neighbours of each taxel within a soft radius along the surface mesh.

    Lengths are exact geodesics on the mesh, directions those of the discrete exponential map.
    On flat skin both are the straight ones; taxels of another patch are no neighbours.

    Parameters
    ----------
    mesh : SurfaceMesh
    reference : (n, 3) array of float
        A direction in each tangent plane that offsets are measured from (the second axis).
    radius, band : float
        Neighbours up to radius + band count; beyond radius - band they are optional [m].

    References
    ----------
    Mitchell, Mount and Papadimitriou, SIAM Journal on Computing 16(4), 1987, through libigl.
    """
    points, normals = mesh.vertices, mesh.skin.normals
    frames = np.stack(reference_frames(normals, reference), axis=1)
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    graph = edge_graph(points, edges)
    # No way along the skin is shorter than the straight line: all neighbours are among these.
    pairs = cKDTree(points).query_pairs(radius + band, output_type="ndarray")
    source, target = np.concatenate([pairs, pairs[:, ::-1]]).T
    order = np.argsort(source, kind="stable")
    source, target = source[order], target[order]
    ends = np.searchsorted(source, np.arange(len(points) + 1))
    tree = cKDTree(points[mesh.faces].mean(axis=1)) if len(mesh.faces) else None
    longest = float(graph.data.max(initial=0.0))
    offsets = np.zeros((len(source), 2))
    length = np.full(len(source), np.inf)
    for taxel in np.flatnonzero(np.diff(ends)):
        own = slice(ends[taxel], ends[taxel + 1])
        here, there = int(mesh.representative[taxel]), mesh.representative[target[own]]
        near = [] if tree is None else tree.query_ball_point(points[here], radius + band + longest)
        length[own] = _lengths(points, mesh.faces[np.sort(near).astype(np.int64)], here, there)
        reach = DETOUR * (radius + band)
        uv, _ = log_map(points, normals, graph, here, reach, frame=frames[taxel])
        straight = (points[there] - points[here]) @ frames[taxel].T
        offsets[own] = np.where(np.isfinite(uv[there]), uv[there], straight)
    keep = length <= radius + band
    flat = unit(offsets[keep]) * length[keep, None]
    return gathered(len(points), source[keep], target[keep], flat, radius=radius, band=band)


def _lengths(points: FloatArray, faces: IntArray, here: int, there: IntArray) -> FloatArray:
    """(t,) geodesic lengths [m] over some faces from one vertex to others; inf where none leads."""
    import igl

    used, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    start = int(np.searchsorted(used, here))
    if start == len(used) or used[start] != here:
        return np.where(there == here, 0.0, np.inf)
    none = np.zeros(0, np.int64)
    length = igl.exact_geodesic(
        points[used], local, np.array([start]), none, np.arange(len(used)), none
    )
    length = np.where(np.isfinite(length) & (length >= 0), length, np.inf)
    length[(length == 0) & (np.arange(len(used)) != start)] = np.inf
    at = np.minimum(np.searchsorted(used, there), len(used) - 1)
    return np.where(used[at] == there, length[at], np.inf)

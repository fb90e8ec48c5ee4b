"""Seams that bring a chart's distortion below a bound: slits from its border to where it is worst.

A conformal map shrinks most at the tips of what bulges, so that the extremes of its scale factor
are where a slit takes off most curvature (Ben-Chen et al. 2008 put their cones there). Where the
chart has no such place left, the slit goes to the worst region of the map itself (Gu et al. 2002).
Of the two the better one stays. Slits keep the chart one disc.

References
----------
Ben-Chen, Gotsman and Bunin, "Conformal flattening by curvature prescription and metric scaling",
Computer Graphics Forum 27(2), 2008. Gu, Gortler and Hoppe, "Geometry images", SIGGRAPH 2002. Li,
Kaufman, Kim, Solomon and Sheffer, "OptCuts", ACM Transactions on Graphics 37(6), 2018: the bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.disc import Disc
from skinmap.flat.disc_map import DiscMap
from skinmap.flat.distortion import measure_distortion
from skinmap.flat.seams import CutMesh, path_from_border, split_along
from skinmap.geometry.topology import boundary_loops, loop_length

MAX_ROUNDS = 40  # each flattens the chart twice; a chart that needs more is no skin
MAX_AT_ONCE = 8  # slits in one round, far from the bound
APART = 0.1  # of the surface's size: slits of one round end no closer to each other
AGAIN = 12  # times that the energy is spread to neighbours before its worst place is sought
PROGRESS = 1e-4  # of the excess energy: a round that gains less has stalled
STALLED = 3  # such rounds in a row end it: some curvature takes two slits


@dataclass(frozen=True, eq=False, slots=True)
class _Laid:
    """A chart and its map, which may lie over itself: trials are not mended."""

    cut: CutMesh
    flat: DiscMap
    energy: float


def add_seams(
    vertices: FloatArray,
    cut: CutMesh,
    lay_flat: Callable[[FloatArray, IntArray], DiscMap],
    bound: float,
    price: Callable[[IntArray], FloatArray],
) -> CutMesh:
    """Slit a chart until its mean symmetric Dirichlet energy is at most a bound.

    Parameters
    ----------
    vertices : (n, 3) array of float
        Of the uncut surface [m].
    cut : CutMesh
        A disc but for small holes.
    lay_flat : callable
        From vertices (k, 3) [m] and faces to a map.
    bound : float
        Above 4.
    price : callable
        From edges (e, 2) of the uncut surface to what cutting them costs.
    """
    now = _laid(vertices, cut, lay_flat)
    stalled = 0
    for _ in range(MAX_ROUNDS):
        if now.energy <= bound or stalled == STALLED:
            break
        count = int(np.clip((now.energy - 4.0) / (bound - 4.0) / 4.0, 1, MAX_AT_ONCE))
        tips = _tips(vertices, now, count)
        tried = [
            _laid(vertices, slit, lay_flat)
            for slit in (_slit(vertices, now.cut, ends, price) for ends in tips)
            if slit is not None
        ]
        if not tried:
            break
        best = min(tried, key=lambda one: one.energy)
        gained = now.energy - best.energy > PROGRESS * (now.energy - 4.0)
        stalled = 0 if gained else stalled + 1
        now = best
    return now.cut


def _laid(
    vertices: FloatArray, cut: CutMesh, lay_flat: Callable[[FloatArray, IntArray], DiscMap]
) -> _Laid:
    own = vertices[cut.origin]
    flat = lay_flat(own, cut.faces)
    found = measure_distortion(own, cut.faces, flat.uv)
    return _Laid(cut, flat, found.mean_energy)


def _tips(vertices: FloatArray, now: _Laid, count: int) -> list[list[int]]:
    """Chart vertices that slits may lead to: tips of curvature, and the worst place of the map."""
    own, faces = vertices[now.cut.origin], now.cut.faces
    size = float(np.ptp(own, axis=0).max())
    loops = sorted(boundary_loops(faces), key=lambda loop: -loop_length(own, loop))
    inside = np.ones(len(own), bool)
    inside[np.concatenate(loops)] = False
    if not inside.any():
        return []
    found = measure_distortion(own, faces, now.flat.uv)
    energy = _spread(faces, np.minimum(found.symmetric_dirichlet, 1e6) - 4.0, found.face_areas)
    scale = np.zeros(len(own))
    if len(loops) == 1:
        scale = np.abs(Disc(own / size, faces, loops[0]).scale)
    return [
        _peaks(own, np.where(inside, height, -1.0), count, APART * size)
        for height in (scale, energy)
        if height[inside].max() > 0.0
    ]


def _peaks(points: FloatArray, height: FloatArray, count: int, apart: float) -> list[int]:
    """The highest places, none near a higher one."""
    height = height.copy()
    found: list[int] = []
    while len(found) < count:
        top = int(np.argmax(height))
        if height[top] <= 0.0:
            break
        found.append(top)
        height[np.linalg.norm(points - points[top], axis=1) <= apart] = -1.0
    return found


def _spread(faces: IntArray, values: FloatArray, areas: FloatArray) -> FloatArray:
    """(n,) means of the values of faces over the neighbourhood of each vertex."""
    n = int(faces.max()) + 1
    rows = faces.ravel()
    columns = np.repeat(np.arange(len(faces)), 3)
    weights = np.repeat(areas, 3)
    at = coo_array((weights, (rows, columns)), shape=(n, len(faces))).tocsr()
    total = at @ np.ones(len(faces))
    means = values
    for _ in range(AGAIN):
        vertex = (at @ means) / total
        means = vertex[faces].mean(axis=1)
    return np.asarray(vertex)


def _slit(
    vertices: FloatArray, cut: CutMesh, ends: list[int], price: Callable[[IntArray], FloatArray]
) -> CutMesh | None:
    """The chart with slits from its border to some vertices."""
    own = vertices[cut.origin]
    ways = path_from_border(cut.faces, np.array(ends), lambda pairs: price(cut.origin[pairs]))
    if len(ways) == 0:
        return None
    opened, origin = split_along(cut.faces, ways)
    length = float(np.linalg.norm(own[ways[:, 0]] - own[ways[:, 1]], axis=1).sum())
    return CutMesh(opened, cut.origin[origin], cut.seam_length + length)

"""Geodesic stress: how far straight lines of the flat map are from shortest ways on the skin."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.topology import half_edges
from skinmap.geometry.triangles import cross_2d, face_areas, signed_areas

SAMPLES = (np.arange(16) + 0.37) / 16.0  # off the lattice of regular boards
SOURCES = 20  # vertices that distances are measured from: more change the third digit


def geodesic_stress(
    vertices: FloatArray, faces: IntArray, uv: FloatArray, *, sources: int = SOURCES
) -> float:
    """Kruskal's stress-1 of plane distances against exact geodesics on the mesh.

    Only pairs whose straight segment stays inside the map count: round a notch the shortest way
    is longer than the line, on the most perfect map too. The size of the map does not count.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m].
    faces : (m, 3) array of int
        One component, cut open.
    uv : (n, 2) array of float
    sources : int
        How many vertices, evenly taken, are measured from.

    Returns
    -------
    float
        0 for an isometry; NaN where no pair has a free line.

    References
    ----------
    Zigelman, Kimmel and Kiryati, "Texture mapping using surface flattening via multidimensional
    scaling", IEEE Transactions on Visualization and Computer Graphics 8(2), 2002. Geodesics:
    Mitchell, Mount and Papadimitriou, SIAM Journal on Computing 16(4), 1987, through libigl.
    """
    import igl

    # The exact search has tolerances of its own: at other sizes than about 1 it may not end.
    size = float(np.ptp(vertices, axis=0).max())
    vertices, uv = (vertices - vertices.mean(axis=0)) / size, (uv - uv.mean(axis=0)) / size
    everyone, none = np.arange(len(vertices)), np.zeros(0, np.int64)
    chosen = np.unique(np.linspace(0, len(vertices) - 1, sources).astype(np.int64))
    around = np.array(
        [igl.exact_geodesic(vertices, faces, np.array([k]), none, everyone, none) for k in chosen]
    )
    area = np.abs(signed_areas(uv, faces)).sum()
    scaled = uv * np.sqrt(face_areas(vertices, faces).sum() / area)
    straight = np.linalg.norm(scaled[chosen][:, None] - scaled[None], axis=2)
    free = np.array([_inside(uv, faces, int(k)) for k in chosen])
    free &= (around > 0) & np.isfinite(around)
    if not free.any():
        return float("nan")
    gap, length = (straight - around)[free], around[free]
    return float(np.sqrt((gap**2).sum() / (length**2).sum()))


def _inside(uv: FloatArray, faces: IntArray, source: int) -> BoolArray:
    """(n,) whether the straight segment from a vertex to each other one stays inside the map."""
    directed = half_edges(faces)
    n = len(uv)
    key, twin = directed @ [n, 1], directed[:, ::-1] @ [n, 1]
    border = directed[~np.isin(key, twin)]
    a, b = uv[border[:, 0]][None], uv[border[:, 1]][None]
    start, end = uv[source], uv[:, None]
    ends_differ = cross_2d(b - a, start - a) * cross_2d(b - a, end - a)
    edge_differs = cross_2d(end - start, a - start) * cross_2d(end - start, b - start)
    size = float(np.ptp(uv, axis=0).max())
    # Products of two areas: rounding of segments that only touch the border stays below this.
    touch = -1e-12 * size**4
    crosses = ((ends_differ < touch) & (edge_differs < touch)).any(axis=1)
    inside: BoolArray = np.asarray(~crosses)
    for share in SAMPLES:  # segments through corners of the border cross no edge of it
        inside[inside] = _contains(a[0], b[0], (start + share * (uv - start))[inside])
    return inside


def _contains(a: FloatArray, b: FloatArray, points: FloatArray) -> BoolArray:
    """(n,) whether points lie inside border edges a > b, by counting crossings to the right."""
    x, y = points[:, :1], points[:, 1:]
    spans = (a[None, :, 1] > y) != (b[None, :, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    at = a[None, :, 0] + (y - a[None, :, 1]) * ((b[:, 0] - a[:, 0]) / rise)[None]
    # A border edge is its own midpoint's edge: points on it count as inside.
    along = np.abs(cross_2d(b[None] - a[None], points[:, None] - a[None]))
    length = np.linalg.norm(b - a, axis=1)[None]
    within = ((points[:, None] - a[None]) * (points[:, None] - b[None])).sum(axis=2) <= 0
    on_border = (within & (along <= 1e-9 * length**2)).any(axis=1)
    return ((spans & (x < at)).sum(axis=1) % 2 == 1) | on_border

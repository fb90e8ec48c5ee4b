"""Writing flat maps for other programs: meshes with texture coordinates, seams opened.

Vertices keep the order of the taxels; a vertex on a seam has a texture coordinate for each copy.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.flat_map import FlatMap


def write_flat_obj(flat: FlatMap, path: Path) -> None:
    """OBJ of a part: taxels in their order, faces with the corners of the charts as vt."""
    start = np.cumsum([0, *(len(chart.taxels) for chart in flat.charts)])
    faces = np.concatenate([chart.taxels[chart.faces] for chart in flat.charts])
    corners = np.concatenate(
        [chart.faces + at for chart, at in zip(flat.charts, start, strict=False)]
    )
    uv = np.concatenate([chart.uv for chart in flat.charts])
    write_obj_with_uv(path, flat.mesh.vertices, faces, uv, corners)


def write_obj_with_uv(
    path: Path, vertices: FloatArray, faces: IntArray, uv: FloatArray, corners: IntArray
) -> None:
    """Write a Wavefront OBJ.

    Parameters
    ----------
    path : Path
    vertices : (n, 3) array of float
        In the order of the taxels [m].
    faces : (m, 3) array of int
        Over them.
    uv : (k, 2) array of float
        Texture coordinates, those of a seam doubled [m].
    corners : (m, 3) array of int
        Row of `uv` of each corner of each face.
    """
    lines = ["# metres; vt are flat-map coordinates in metres, vertices in the order of the taxels"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v in uv.tolist()]
    pairs = np.stack([faces + 1, corners + 1], axis=2).reshape(-1, 6)
    lines += [f"f {a}/{b} {c}/{d} {e}/{f}" for a, b, c, d, e, f in pairs.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")

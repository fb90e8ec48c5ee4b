"""Flat maps of bare triangle meshes: any component of any file, not only skins."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.cutting import open_surface
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.flat_map import DEFAULT, HOLE_SHARE, flatten_disc
from skinmap.flat.methods import flatteners
from skinmap.geometry.topology import check_surface, face_components


@dataclass(frozen=True, eq=False, slots=True)
class MeshChart:
    """The flat map of one component of a bare mesh; see `flat_map.Chart` for the words."""

    vertices: IntArray
    faces: IntArray
    uv: FloatArray
    distortion: Distortion
    method: str
    fallback: bool
    holes: int
    seam_length: float
    seconds: float


def flatten_mesh(
    vertices: FloatArray, faces: IntArray, *, method: str = DEFAULT
) -> tuple[MeshChart, ...]:
    """Lay each connected component of any triangle mesh flat, cut open where it must be.

    Parameters
    ----------
    vertices : (n, 3) array of float
        Coincident ones are merged, unused ones ignored.
    faces : (m, 3) array of int
    method : str
        One of `flatteners.names()`.

    Raises
    ------
    UnknownNameError, InvalidMeshError, FlatteningError
        No such method, a mesh that is no surface, or one that no method lays flat.
    """
    flatteners.get(method)
    points, number = np.unique(vertices, axis=0, return_inverse=True)
    merged = number.ravel()[faces]
    original = np.zeros(len(points), np.int64)
    original[number.ravel()] = np.arange(len(vertices))
    check_surface(merged)
    charts = []
    label = face_components(merged)
    for component in range(int(label.max(initial=-1)) + 1):
        used, compact = np.unique(merged[label == component], return_inverse=True)
        started = time.process_time()
        cut = open_surface(points[used], compact.reshape(-1, 3), hole_share=HOLE_SHARE)
        place = used[cut.origin]
        where = f"component {component}"
        uv, name, holes = flatten_disc(points[place], cut.faces, method=method, where=where)
        seconds = time.process_time() - started
        distortion = measure_distortion(points[place], cut.faces, uv)
        charts.append(
            MeshChart(
                original[place],
                cut.faces,
                uv,
                distortion,
                name,
                name != method,
                holes,
                cut.seam_length,
                seconds,
            )
        )
    return tuple(charts)

"""The surface that a patch is laid on: a link's mesh, wrapped so that it is closed and clean."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.triangles import unit, vertex_normals

ALPHA = 15e-3  # openings narrower than this are closed [m]
OFFSET = 0.3e-3  # of the wrap from the mesh [m]
DETAIL = 4e-3  # longest edge of the wrap: a facet's sagitta stays below 0.1 mm on a wrist [m]
# Vertices are rounded before the wrap, whose triangles change altogether with the last bit of a
# vertex: so a mesh read in metres and in millimetres gives one target (but where a coordinate lies
# within a float32's rounding of a step: 1 mesh in 30 of a thousand vertices). Taxels stray ten
# times as far.
ROUNDING = 0.1e-3  # [m]
KEPT = 8  # wraps kept in memory: one a link that is worked on

_wraps: OrderedDict[str, tuple[FloatArray, IntArray]] = OrderedDict()


@dataclass(eq=False)
class Target:
    """A closed surface with normals, ready to be asked for closest points.

    Attributes
    ----------
    vertices : (n, 3) float
        [m].
    faces : (m, 3) int
    normals : (n, 3) float
        Unit vertex normals, outward.
    """

    vertices: FloatArray
    faces: IntArray
    normals: FloatArray
    _tree: Any

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Closest points (k, 3) [m] and unit normals (k, 3), interpolated inside each face."""
        _, face, closest = self._tree.squared_distance(self.vertices, self.faces, points)
        corner = self.faces[np.asarray(face)]
        weights = _barycentric(closest, self.vertices[corner])
        return closest, unit(np.einsum("kc,kcd->kd", weights, self.normals[corner]))


def make_target(vertices: FloatArray, faces: IntArray, *, alpha: float = ALPHA) -> Target:
    """Wrap a link's mesh (n, 3) [m], (m, 3): closed, without inner sheets, faces outward.

    Visual meshes are no targets as they are: open, with inner sheets and faces that point
    inward, so that the closest point jumps from sheet to sheet. The wrap (Portaneri et al.,
    "Alpha Wrapping with an Offset", ACM Transactions on Graphics 41(4), 2022, through
    pymeshlab) has neither, and is kept for the next call with the same mesh.
    """
    import igl

    vertices, faces = _wrapped(vertices, faces, alpha)
    tree = igl.AABB()
    tree.init(vertices, faces)
    return Target(vertices, faces, vertex_normals(vertices, faces), tree)


def _wrapped(vertices: FloatArray, faces: IntArray, alpha: float) -> tuple[FloatArray, IntArray]:
    rounded = np.round(vertices / ROUNDING) * ROUNDING + 0.0  # no -0.0: it is another bit
    key = hashlib.sha256(rounded.tobytes() + faces.tobytes() + repr(alpha).encode()).hexdigest()
    if key not in _wraps:
        import pymeshlab

        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(rounded, faces))
        length = pymeshlab.PureValue
        meshes.generate_alpha_wrap(alpha=length(alpha), offset=length(OFFSET))
        meshes.meshing_surface_subdivision_midpoint(iterations=6, threshold=length(DETAIL))
        made = meshes.current_mesh()
        _wraps[key] = (made.vertex_matrix(), made.face_matrix().astype(np.int64))
        while len(_wraps) > KEPT:
            _wraps.popitem(last=False)
    _wraps.move_to_end(key)
    return _wraps[key]


def _barycentric(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Weights (k, 3) of points (k, 3) on triangles (k, 3, 3); a corner where there is no area."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    square = np.einsum("kd,kd->k", normal, normal)
    safe = np.where(square > 0, square, 1.0)
    v = np.einsum("kd,kd->k", np.cross(points - a, c - a), normal) / safe
    w = np.einsum("kd,kd->k", np.cross(b - a, points - a), normal) / safe
    return np.column_stack([1.0 - v - w, v, w])

"""Surface mesh: triangles whose vertices are taxels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray, IntArray, check_faces, check_points, freeze
from skinmap.errors import InvalidMeshError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.topology import check_surface, face_components
from skinmap.geometry.triangles import vertex_areas
from skinmap.skin.skin import Skin
from skinmap.surface.holes import fill_holes
from skinmap.surface.merge import SLIVER, consensus
from skinmap.surface.stars import delaunay_stars

EDGE_LIMIT = 2.5  # in spacings: spans the gap between two modules, not the gap between patches
MERGE = 1e-2  # in spacings: closer taxels are one vertex


@dataclass(frozen=True, eq=False, slots=True)
class SurfaceMesh:
    """Triangles over the taxels of a skin.

    Attributes
    ----------
    skin : Skin
        The n taxels.
    faces : (m, 3) int
        Taxel indices, counter-clockwise seen from outside.
    representative : (n,) int
        The taxel that stands for each taxel in the mesh: itself but for near-coincident ones.
    face_patches : (m,) int
        Patch of each face, 0 first; the largest patch has number 0.
    """

    skin: Skin
    faces: IntArray
    representative: IntArray
    face_patches: IntArray

    def __post_init__(self) -> None:
        faces = check_faces(self.faces, len(self.skin))
        check_surface(faces)
        freeze(
            self,
            faces=faces,
            representative=np.asarray(self.representative, np.int64),
            face_patches=np.asarray(self.face_patches, np.int64),
        )

    @property
    def vertices(self) -> FloatArray:
        """(n, 3) taxel positions [m]."""
        return self.skin.positions

    @property
    def n_patches(self) -> int:
        """Number of connected patches."""
        return int(self.face_patches.max(initial=-1)) + 1

    @property
    def taxel_patches(self) -> IntArray:
        """(n,) patch of each taxel; -1 for a taxel that no face uses."""
        patch = np.full(len(self.skin), -1, np.int64)
        patch[self.faces.ravel()] = np.repeat(self.face_patches, 3)
        return patch[self.representative]

    @property
    def taxel_areas(self) -> FloatArray:
        """(n,) skin area that each taxel stands for [m2]: a third of its triangles.

        Taxels merged into one vertex share its area.
        """
        areas = vertex_areas(self.vertices, self.faces)
        share = np.bincount(self.representative, minlength=len(areas))
        return areas[self.representative] / share[self.representative]

    def patch_faces(self, patch: int) -> IntArray:
        """(k, 3) faces of one patch."""
        return self.faces[self.face_patches == patch]


def build_surface(skin: Skin, *, max_edge: float | None = None) -> SurfaceMesh:
    """Delaunay surface mesh over all taxels of a skin.

    Each taxel votes for the triangles of its own tangent-plane Delaunay star; triangles are
    taken greedily by votes while the mesh stays a manifold; small holes are closed.

    Parameters
    ----------
    skin : Skin
        Positions and outward normals.
    max_edge : float, optional
        Longest edge allowed [m]; 2.5 times the median spacing by default.

    Raises
    ------
    InvalidMeshError
        Fewer than three distinct taxels, or none that are close enough to be joined.
    """
    representative, vertices = merge_coincident(skin.positions)
    if len(vertices) < 3:
        raise InvalidMeshError(f"{len(vertices)} distinct taxels make no surface: at least 3")
    points, normals = skin.positions[vertices], skin.normals[vertices]
    spacing = median_spacing(points)
    limit = EDGE_LIMIT * spacing if max_edge is None else max_edge
    votes = delaunay_stars(points, normals, spacing, limit)
    faces = consensus(points, normals, votes, SLIVER * spacing)
    faces = fill_holes(points, normals, faces)
    if len(faces) == 0:
        raise InvalidMeshError(
            f"no three of {len(vertices)} taxels lie within {limit:.3g} m of each other "
            "without being in a row: no surface there"
        )
    return SurfaceMesh(skin, vertices[faces], representative, _by_size(faces))


def merge_coincident(positions: FloatArray) -> tuple[IntArray, IntArray]:
    """The taxel (n,) that stands for each one, and the taxels (k,) that stand for themselves."""
    points = check_points(positions, "positions")
    everyone = np.arange(len(points))
    distinct = np.unique(points, axis=0)
    tolerance = MERGE * median_spacing(distinct)
    pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray") if len(points) else []
    representative = everyone.copy()
    for low, high in sorted(map(tuple, np.asarray(pairs).reshape(-1, 2).tolist())):
        representative[high] = min(representative[high], representative[low])
    return representative, np.flatnonzero(representative == everyone)


def _by_size(faces: IntArray) -> IntArray:
    """(m,) patch of each face, the patch with the most faces first."""
    label = face_components(faces)
    order = np.argsort(-np.bincount(label), kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return rank[label]

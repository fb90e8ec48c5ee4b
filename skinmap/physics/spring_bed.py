"""The skin as a bed of springs, finer than its taxels, and what taxels feel of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidMeshError
from skinmap.geometry.proximity import bridged_graph, median_spacing
from skinmap.geometry.triangles import face_areas, face_normals, unit
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface

CELL = 3.4e-3  # no two springs are much further apart [m]: a fingertip stands on ten or more
PAD = 2e-3  # radius of a taxel's electrode [m], 4 mm wide as the iCub's
REACH = 3.0  # the spread of the foam is followed so many standard deviations


@dataclass(frozen=True, eq=False, slots=True)
class SpringBed:
    """c springs on the surface mesh of a skin.

    Attributes
    ----------
    skin : Skin
    places, normals : (c, 3) float
        Where springs stand [m] and their outward directions.
    area : float
        Skin that a spring speaks for, mean [m2].
    graph : (n, n) sparse
        Steps between taxels along the skin [m].
    spacing : float
        Of the taxels, median [m].
    """

    skin: Skin
    places: FloatArray
    normals: FloatArray
    area: float
    graph: csr_array
    spacing: float

    def spread(self, sigma: float) -> csr_array:
        """(n, c) pressure [Pa] on each taxel for a newton on each spring.

        A Gaussian of the foam's spread and the electrode's own size. What lies on the other side
        of a thin part feels nothing.
        """
        variance = sigma**2 + PAD**2 / 4.0  # of a disc along one direction
        reach = REACH * np.sqrt(variance)
        near = cKDTree(self.skin.positions).sparse_distance_matrix(
            cKDTree(self.places), reach, output_type="coo_matrix"
        )
        rows, columns = near.row, near.col
        squared = ((self.skin.positions[rows] - self.places[columns]) ** 2).sum(axis=1)
        weight = np.exp(-0.5 * squared / variance) / (2.0 * np.pi * variance)
        facing = np.einsum("ij,ij->i", self.skin.normals[rows], self.normals[columns]) > 0.0
        shape = (len(self.skin), len(self.places))
        return csr_array((weight * facing, (rows, columns)), shape=shape)


def spring_bed(skin: Skin, mesh: SurfaceMesh | None = None) -> SpringBed:
    """The springs of a skin: the middles of its triangles, each split alike into s * s.

    Raises
    ------
    InvalidMeshError
        Taxels that make no surface.
    """
    mesh = build_surface(skin) if mesh is None else mesh
    spacing = median_spacing(skin.positions)
    if len(mesh.faces) == 0:
        raise InvalidMeshError(f"the taxels of {skin.part!r} lie in a row: no surface to press on")
    corners = skin.positions[mesh.faces]
    weights = _middles(max(1, round(spacing / CELL)))
    places = np.einsum("kc,fcd->fkd", weights, corners).reshape(-1, 3)
    normals = unit(face_normals(skin.positions, mesh.faces))
    return SpringBed(
        skin,
        places,
        np.repeat(normals, len(weights), axis=0),
        float(face_areas(skin.positions, mesh.faces).sum()) / len(places),
        bridged_graph(skin.positions, 10, 2.5 * spacing),
        spacing,
    )


def _middles(splits: int) -> FloatArray:
    """(s * s, 3) barycentric coordinates of the middles of a triangle's s * s equal parts."""
    third = 1.0 / 3.0
    up = [(i + third, j + third) for i in range(splits) for j in range(splits - i)]
    down = [(i - third, j - third) for i in range(1, splits) for j in range(1, splits - i + 1)]
    first, second = np.array(up + down).T / splits
    return np.column_stack([first, second, 1.0 - first - second])

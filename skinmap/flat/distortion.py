"""What a flat map costs: distortion of each triangle, and summaries.

sigma_1 >= sigma_2 are the singular values of the map of one triangle to the plane, at the
global scale s with s^2 = sum A3D / sum A2D, so that the size of the map does not count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, Frozen, IntArray, check_faces, check_finite, check_points
from skinmap.flat.flat_rows import Distorted, Spread
from skinmap.geometry.topology import edges
from skinmap.geometry.triangles import (
    face_areas,
    jacobians,
    pair_lengths,
    signed_areas,
    singular_values,
)
from skinmap.summary import Summary


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Distortion(Frozen, Summary):
    """Distortion per triangle (m,) and per edge (e,).

    Attributes
    ----------
    quasi_conformal : (m,) float
        sigma_1 / sigma_2 >= 1; 1 keeps angles (Degener 2003).
    area : (m,) float
        sigma_1 sigma_2; 1 keeps areas; not positive where a triangle flips.
    symmetric_dirichlet : (m,) float
        sigma_1^2 + sigma_2^2 + sigma_1^-2 + sigma_2^-2 >= 4 (Smith and Schaefer 2015);
        inf where a triangle flips.
    stretch : (m,) float
        L2 texture stretch sqrt((sigma_1^-2 + sigma_2^-2) / 2) >= 1 in the mean (Sander 2001);
        inf where a triangle collapses.
    stretch_max : (m,) float
        Linf texture stretch 1 / sigma_2 >= 1 in the mean; inf where a triangle flips.
    arap : (m,) float
        (sigma_1 - 1)^2 + (sigma_2 - 1)^2, 0 for an isometry (Liu 2008).
    edge_strain : (e,) float
        Scaled flat length over length on the skin, minus 1.
    edge_lengths : (e,) float
        On the skin [m]: the weights of `edge_strain`.
    edges : (e, 2) int
    face_areas : (m,) float
        On the skin [m2]: the weights of the rest.
    flips : int
        Triangles turned over by the map.
    """

    quasi_conformal: FloatArray
    area: FloatArray
    symmetric_dirichlet: FloatArray
    stretch: FloatArray
    stretch_max: FloatArray
    arap: FloatArray
    edge_strain: FloatArray
    edge_lengths: FloatArray
    edges: IntArray
    face_areas: FloatArray
    flips: int

    @property
    def edge_rms(self) -> float:
        """Root mean square of the edge strain, edges weighted by their length."""
        return float(np.sqrt(np.average(self.edge_strain**2, weights=self.edge_lengths)))

    @property
    def mean_energy(self) -> float:
        """Mean symmetric Dirichlet energy, weighted by area; 4 for an isometry."""
        return float(np.average(self.symmetric_dirichlet, weights=self.face_areas))

    @property
    def area_sd(self) -> float:
        """Root mean square of ln(area distortion), weighted by area; inf with a flip."""
        if self.flips:
            return float("inf")
        return float(np.sqrt(np.average(np.log(self.area) ** 2, weights=self.face_areas)))

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "triangles": len(self.area),
            "edges": len(self.edges),
            "edge_rms": f"{self.edge_rms:.2%}",
            "flips": self.flips,
        }

    def summary(self) -> Distorted:
        """What the map costs in a few figures."""
        return Distorted(
            flips=self.flips,
            quasi_conformal=spread(self.quasi_conformal, self.face_areas),
            area=spread(self.area, self.face_areas),
            area_sd=self.area_sd,
            symmetric_dirichlet=spread(self.symmetric_dirichlet, self.face_areas),
            stretch=spread(self.stretch, self.face_areas),
            stretch_l2=float(np.sqrt(np.average(self.stretch**2, weights=self.face_areas))),
            stretch_linf=float(self.stretch_max.max()),
            arap=spread(self.arap, self.face_areas),
            arap_energy=float(np.average(self.arap, weights=self.face_areas)),
            edge_strain_percent=spread(100.0 * np.abs(self.edge_strain), self.edge_lengths),
            edge_rms_percent=100.0 * self.edge_rms,
        )

    def face_edge_strain(self, faces: IntArray) -> FloatArray:
        """(m,) root mean square of the strain of the three edges of each face."""
        n = int(self.edges.max()) + 1
        key = self.edges[:, 0] * n + self.edges[:, 1]
        sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 3, 2), axis=2)
        place = np.searchsorted(key, sides[..., 0] * n + sides[..., 1])
        return np.asarray(np.sqrt((self.edge_strain[place] ** 2).mean(axis=1)))


def spread(values: FloatArray, weights: FloatArray) -> Spread:
    """Weighted mean, weighted 95th percentile and maximum."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    p95 = values[order][np.searchsorted(total, 0.95 * total[-1])]
    mean = np.average(values, weights=weights)
    return Spread(mean=float(mean), p95=float(p95), max=float(values.max()))


def measure_distortion(vertices: ArrayLike, faces: ArrayLike, uv: ArrayLike) -> Distortion:
    """Distortion of a flat map.

    Parameters
    ----------
    vertices : (n, 3) array-like of float
        [m].
    faces : (m, 3) array-like of int
        At least one triangle.
    uv : (n, 2) array-like of float
        Flat coordinates, in any unit.

    Returns
    -------
    Distortion
    Of each triangle and of the whole map.

    Raises
    ------
    InvalidArrayError, InvalidMeshError
        Wrong shapes, values that are not finite, indices outside.

    Examples
    --------
    >>> from skinmap.flat import measure_distortion
    >>> square = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    >>> found = measure_distortion(square, [[0, 1, 2], [1, 3, 2]], [[0, 0], [1, 0], [0, 1], [1, 1]])
    >>> found.flips, round(found.edge_rms, 9)
    (0, 0.0)
    """
    points = check_points(vertices, "vertices")
    triangles = check_faces(faces, len(points))
    flat = check_finite(uv, "uv", (len(points), 2))
    weights = face_areas(points, triangles)
    signed = signed_areas(flat, triangles)
    scale = np.sqrt(weights.sum() / max(np.abs(signed).sum(), np.finfo(float).tiny))
    first, second = singular_values(jacobians(points, triangles, flat * scale))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(second != 0, first / np.abs(second), np.inf)
        inverse = 1.0 / first**2 + 1.0 / second**2
        dirichlet = np.where(second > 0, first**2 + second**2 + inverse, np.inf)
        largest = np.where(second > 0, 1.0 / second, np.inf)
    pairs = edges(triangles)
    strain, length = _edge_strain(points, flat * scale, pairs)
    return Distortion(
        ratio,
        first * second,
        dirichlet,
        np.sqrt(0.5 * inverse),
        largest,
        (first - 1.0) ** 2 + (second - 1.0) ** 2,
        strain,
        length,
        pairs,
        weights,
        int(np.count_nonzero(signed <= 0)),
    )


def edge_rms(vertices: FloatArray, faces: IntArray, uv: FloatArray) -> float:
    """The `Distortion.edge_rms` of a map alone, at a fifth of the cost of everything."""
    area = np.abs(signed_areas(uv, faces)).sum()
    scale = np.sqrt(face_areas(vertices, faces).sum() / max(area, np.finfo(float).tiny))
    strain, length = _edge_strain(vertices, uv * scale, edges(faces))
    return float(np.sqrt(np.average(strain**2, weights=length)))


def _edge_strain(
    vertices: FloatArray, uv: FloatArray, pairs: IntArray
) -> tuple[FloatArray, FloatArray]:
    """(e,) flat length over length minus 1, and the length [m]."""
    length = pair_lengths(vertices, pairs)
    flat = pair_lengths(uv, pairs)
    return flat / length - 1.0, length

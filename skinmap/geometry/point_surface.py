"""The smooth surface through oriented points, and straight or evenly bent ways along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.geometry.triangles import unit

NEAR = 10  # points that say where the surface is
STEP = 2e-3  # of a walk [m]
OFF = 1.25  # spacings from the nearest point: beyond is no skin


@dataclass(frozen=True, eq=False, slots=True)
class Way:
    """Points along a surface.

    Attributes
    ----------
    points : (p, 3) float
        `STEP` apart [m].
    headings, normals : (p, 3) float
        Unit directions of going and of the surface there.
    """

    points: FloatArray
    headings: FloatArray
    normals: FloatArray

    @property
    def length(self) -> float:
        """[m]."""
        return STEP * (len(self.points) - 1)


class PointSurface:
    """The surface that oriented points are samples of.

    Parameters
    ----------
    points, normals : (n, 3) float
        [m], and outward directions of length 1.
    spacing : float
        Between neighbours [m].
    """

    def __init__(self, points: FloatArray, normals: FloatArray, spacing: float) -> None:
        self.points, self.normals, self.spacing = points, normals, spacing
        self._tree = cKDTree(points)

    def nearest(self, point: FloatArray) -> int:
        """Row of the sample nearest to a point."""
        return int(self._tree.query(point)[1])

    def project(self, point: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """The surface's point and normal next to a point, and how far the nearest sample is [m].

        The distances from the samples' tangent planes are too large by as much as those from
        the plane of their mean are too small, where a surface bends; the mean of both is right to
        the second order.
        """
        place = point
        for _ in range(2):
            gap, near = self._tree.query(place, k=min(NEAR, len(self.points)))
            weight = np.exp(-0.5 * (gap / self.spacing) ** 2)
            weight /= weight.sum()
            normal = unit(weight @ self.normals[near])
            step = place - self.points[near]
            away = 0.5 * np.einsum("ij,ij->i", step, self.normals[near] + normal)
            place = place - (weight @ away) * normal
        return place, normal, float(gap[0])

    def walk(
        self, start: FloatArray, heading: FloatArray, length: float, *, bend: float = 0.0
    ) -> Way:
        """The way of a length [m] from a point, or as much of it as there is skin.

        Parameters
        ----------
        start, heading : (3,) float
            Where it begins [m] and in which direction.
        length : float
            [m].
        bend : float
            Geodesic curvature, left is positive [1/m]; 0 is a geodesic.
        """
        place, normal, _ = self.project(start)
        ahead = _along(heading, normal)
        found = [(place, ahead, normal)]
        c, s = np.cos(STEP * bend), np.sin(STEP * bend)
        for _ in range(int(np.ceil(length / STEP))):
            place, normal, gap = self.project(place + STEP * ahead)
            if gap > OFF * self.spacing:
                break
            ahead = _along(ahead, normal)
            ahead = c * ahead + s * np.cross(normal, ahead)
            found.append((place, ahead, normal))
        points, headings, normals = (np.array(one) for one in zip(*found, strict=True))
        return Way(points, headings, normals)


def _along(direction: FloatArray, normal: FloatArray) -> FloatArray:
    """What of a direction lies in the tangent plane, unit length."""
    return np.asarray(unit(direction - (direction @ normal) * normal))

"""The consensus recipe over one cloud: stars, votes, small holes; and the limits it works in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.surface.delaunay_stars import NEIGHBOURS, delaunay_stars
from skinmap.surface.holes import fill_holes
from skinmap.surface.surface_merge import consensus
from skinmap.surface.taxel_cloud import Cloud

EDGE_LIMIT = 2.5  # in local spacings: spans the gap between two modules, not between patches
SLIVER = 0.02  # in spacings: flatter triangles are three taxels in a row
BEYOND = 10.0  # times the size of the skin: longer than any length that is meant


@dataclass(frozen=True, eq=False, slots=True)
class Limits:
    """What a triangle and a hole may be, in the units of a cloud.

    Attributes
    ----------
    max_edge : (k,) float
        Of a triangle at each point: an edge is no longer than either end allows.
    least_altitude : float
        Of a triangle.
    largest_hole : int
        Vertices of the longest inner loop that is closed.
    """

    max_edge: FloatArray
    least_altitude: float
    largest_hole: int

    @classmethod
    def of(
        cls, cloud: Cloud, max_edge: float | None, least_altitude: float | None, largest_hole: int
    ) -> Limits:
        """Limits given [m], or else derived from the spacing of a cloud."""
        for name, value in (("max_edge", max_edge), ("least_altitude", least_altitude)):
            if value is not None and not (np.isfinite(value) and value >= 0):
                raise InvalidArrayError(f"{name} must be a length of 0 m or more, got {value}")
            size = cloud.unit * float(np.linalg.norm(np.ptp(cloud.points, axis=0)))
            if value is not None and value > BEYOND * size > 0.0:
                raise InvalidArrayError(
                    f"{name} of {value:g} m, on a skin of {size:.2g} m: is it in millimetres?"
                )
        return cls(
            EDGE_LIMIT * cloud.spacings
            if max_edge is None
            else np.full(len(cloud.points), max_edge / cloud.unit),
            SLIVER * cloud.spacing if least_altitude is None else least_altitude / cloud.unit,
            largest_hole,
        )


def consensus_faces(
    cloud: Cloud, limits: Limits, *, neighbours: int = NEIGHBOURS, compiled: bool | None = None
) -> IntArray:
    """Faces (m, 3) over the points of a cloud."""
    votes = delaunay_stars(
        cloud.points,
        cloud.normals,
        cloud.spacing,
        limits.max_edge,
        neighbours=neighbours,
        compiled=compiled,
    )
    faces = consensus(cloud.points, cloud.normals, votes, limits.least_altitude, compiled=compiled)
    return close_small_holes(cloud, limits, faces)


def close_small_holes(cloud: Cloud, limits: Limits, faces: IntArray) -> IntArray:
    """Faces (m, 3) with the inner loops closed that are small enough."""
    return fill_holes(
        cloud.points,
        cloud.normals,
        faces,
        limits.largest_hole,
        least_altitude=1e-3 * limits.least_altitude,
    )

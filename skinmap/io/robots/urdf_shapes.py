"""Boxes, cylinders and spheres of a URDF as meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray

SECTIONS = 48  # of a cylinder: 0.2 % of the radius off the round


def shape_mesh(geometry: Any) -> tuple[FloatArray, IntArray] | None:
    """Vertices [m] and faces of a URDF's `geometry`; None where it is no such shape."""
    from trimesh import creation

    if geometry.box is not None:
        mesh = creation.box(extents=geometry.box.size)
    elif geometry.cylinder is not None:
        shape = geometry.cylinder
        mesh = creation.cylinder(radius=shape.radius, height=shape.length, sections=SECTIONS)
    elif geometry.sphere is not None:
        mesh = creation.icosphere(subdivisions=3, radius=geometry.sphere.radius)
    else:
        return None
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)

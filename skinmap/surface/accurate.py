"""x"""

from __future__ import annotations

from skinmap.arrays import IntArray
from skinmap.geometry.mesh import TriangleMesh
from skinmap.surface.cloud import Cloud
from skinmap.surface.recipe import Limits


def accurate_faces(cloud: Cloud, limits: Limits, body: TriangleMesh) -> IntArray:
    """X"""
    raise NotImplementedError

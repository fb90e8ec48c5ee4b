"""Writing of a link's mesh: binary PLY, which shares vertices and so is a third of an STL."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinmap.geometry.mesh import TriangleMesh


def write_mesh(mesh: TriangleMesh, path: Path) -> None:
    """Write a mesh as binary PLY: single-precision vertices [m], then triangles."""
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment vertices in metres",
        f"element vertex {len(mesh.vertices)}",
        *(f"property float {name}" for name in "xyz"),
        f"element face {len(mesh.faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    faces = np.zeros(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    vertices = mesh.vertices.astype("<f4").tobytes()
    path.write_bytes("\n".join(header).encode("ascii") + b"\n" + vertices + faces.tobytes())

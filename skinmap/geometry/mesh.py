"""A triangle mesh: two arrays that travel together."""

from __future__ import annotations

from dataclasses import dataclass

from skinmap.arrays import FloatArray, IntArray, check_faces, check_points, freeze


@dataclass(frozen=True, eq=False, slots=True)
class TriangleMesh:
    """Vertices (n, 3) float [m] and faces (m, 3) int, counter-clockwise seen from outside.

    Attributes
    ----------
    vertices : (n, 3) float
    Positions [m].
    faces : (m, 3) int
    Counter-clockwise seen from outside.
    """

    vertices: FloatArray
    faces: IntArray

    def __post_init__(self) -> None:
        vertices = check_points(self.vertices, "vertices")
        freeze(self, vertices=vertices, faces=check_faces(self.faces, len(vertices)))

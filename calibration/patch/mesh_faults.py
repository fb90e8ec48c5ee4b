"""Faults of a link's mesh that wrapping it mends: open, not a manifold, inside out."""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray

NAMED = 5  # faces that are named


def mesh_notes(vertices: FloatArray, faces: IntArray) -> tuple[str, ...]:
    """One line for each fault of a mesh (v, 3) [m], (f, 3), with the first faces that have it.

    Vertices at one place count as one, as STL files repeat them.
    """
    _, same = np.unique(vertices, axis=0, return_inverse=True)
    corner = same.ravel()[faces]
    ends = np.sort(np.stack([corner, np.roll(corner, -1, axis=1)], axis=2), axis=2)
    _, edge, count = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
    sharing = count[edge.ravel()].reshape(-1, 3)
    notes = []
    for wrong, kind in ((sharing == 1, "open"), (sharing > 2, "not a manifold")):
        rows = np.flatnonzero(wrong.any(axis=1))
        if len(rows):
            notes.append(
                f"the mesh is {kind} at {int(wrong.sum())} edges of {_named(rows)}: wrapped first"
            )
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    if np.einsum("fd,fd->", a, np.cross(b, c)) < 0.0:
        notes.append(f"the mesh is inside out, all in all ({len(faces)} faces): wrapped first")
    return tuple(notes)


def _named(rows: IntArray) -> str:
    more = ", ..." if len(rows) > NAMED else ""
    return f"{len(rows)} faces ({', '.join(map(str, rows[:NAMED]))}{more})"

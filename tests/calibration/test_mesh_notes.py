"""Faults of a mesh are named with their faces, though the wrap mends them."""

from __future__ import annotations

import numpy as np
import trimesh

from calibration.patch.link_surface import mesh_notes


def box():
    made = trimesh.creation.box((0.1, 0.2, 0.3))
    return np.asarray(made.vertices, float), np.asarray(made.faces, np.int64)


def test_a_sound_mesh_has_no_fault_also_as_a_soup_of_triangles():
    vertices, faces = box()
    assert mesh_notes(vertices, faces) == ()
    assert mesh_notes(vertices[faces].reshape(-1, 3), np.arange(36).reshape(12, 3)) == ()


def test_open_doubled_and_turned_meshes_are_named():
    vertices, faces = box()
    (hole,) = mesh_notes(vertices, faces[1:])
    assert "open at 3 edges of 3 faces (" in hole
    fin = np.vstack([vertices, [[0.3, 0.0, 0.0]]])
    notes = mesh_notes(fin, np.vstack([faces, [*faces[0][:2], 8]]))
    assert "open at 2 edges of 1 faces (12)" in notes[0]
    assert "not a manifold at 3 edges" in notes[1]
    assert "12" in notes[1]
    (turned,) = mesh_notes(vertices, faces[:, ::-1])
    assert "inside out" in turned

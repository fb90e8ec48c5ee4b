"""Faults of a mesh are named with their faces, though the wrap mends them."""

from __future__ import annotations

import numpy as np
import trimesh

from calibration.patch.link_surface import mesh_notes, one_way


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


def test_an_open_sheet_has_no_inside():
    """A saddle is open all round: its faces may point either way."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 12), np.linspace(-0.1, 0.1, 12))
    vertices = np.column_stack([x.ravel(), y.ravel(), (4 * x * y).ravel()])
    corner = np.arange(11 * 12).reshape(11, 12)[:, :-1].ravel()
    faces = np.vstack([np.column_stack([corner, corner + 1, corner + 12]),
                       np.column_stack([corner + 1, corner + 13, corner + 12])])  # fmt: skip
    for turned in (faces, faces[:, ::-1]):
        (note,) = mesh_notes(vertices, turned)
        assert "open at 44 edges" in note
    vertices, faces = box()
    assert "inside out" in mesh_notes(*_holed(vertices, faces[:, ::-1]))[-1]


def _holed(vertices, faces):
    fine = trimesh.Trimesh(vertices, faces, process=False).subdivide().subdivide()
    return np.asarray(fine.vertices), np.asarray(fine.faces, np.int64)[1:]


def test_faces_of_a_sheet_that_point_both_ways_are_turned_as_most_of_them():
    made = trimesh.creation.box((0.1, 0.2, 0.3)).subdivide().subdivide()
    vertices, faces = np.asarray(made.vertices), np.asarray(made.faces, np.int64)[5:]
    assert one_way(vertices, faces) is faces
    mixed = faces.copy()
    mixed[::3] = mixed[::3, ::-1]
    normals = np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2)))
    for given, want in ((mixed, normals), (mixed[:, ::-1], -normals)):
        found = one_way(vertices, given)
        own = np.cross(*(vertices[found[:, k]] - vertices[found[:, 0]] for k in (1, 2)))
        assert (np.einsum("fd,fd->f", own, want) > 0.0).all()
    soup = vertices[mixed].reshape(-1, 3)
    found = one_way(soup, np.arange(len(soup)).reshape(-1, 3))
    own = np.cross(*(soup[found[:, k]] - soup[found[:, 0]] for k in (1, 2)))
    assert (np.einsum("fd,fd->f", own, normals) > 0.0).all()

from __future__ import annotations

import numpy as np
import pytest

from skinmap.arrays import check_faces, check_points
from skinmap.errors import InvalidArrayError, InvalidMeshError
from skinmap.geometry.topology import (
    boundary_loops,
    check_surface,
    edges,
    euler_number,
    face_components,
)


def test_euler_number_of_sphere_is_two(sphere):
    assert euler_number(sphere[1]) == 2


def test_euler_number_of_disc_is_one(square_grid):
    assert euler_number(square_grid(5)[1]) == 1


def test_edges_of_sphere_are_three_halves_of_its_faces(sphere):
    assert len(edges(sphere[1])) == 3 * len(sphere[1]) // 2


def test_boundary_loops_of_closed_surface_are_none(sphere):
    assert boundary_loops(sphere[1]) == []


def test_boundary_loop_of_grid_runs_counter_clockwise(square_grid):
    vertices, faces = square_grid(4)
    (loop,) = boundary_loops(faces)
    x, y = vertices[loop, 0], vertices[loop, 1]
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    assert len(loop) == 12
    assert area == pytest.approx(1.0)


def test_boundary_loops_refuse_two_fans_in_one_vertex():
    with pytest.raises(InvalidMeshError, match="meet in one vertex"):
        boundary_loops(np.array([[0, 1, 2], [0, 3, 4]]))


def test_face_components_separates_pieces(square_grid):
    faces = square_grid(3)[1]
    both = np.concatenate([faces, faces + 9])
    np.testing.assert_array_equal(face_components(both), np.repeat([0, 1], len(faces)))


def test_check_surface_refuses_three_faces_at_an_edge():
    with pytest.raises(InvalidMeshError, match=r"edge \(0, 1\) lies in 3 faces"):
        check_surface(np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))


def test_check_surface_refuses_a_reversed_face():
    with pytest.raises(InvalidMeshError, match="opposite ways"):
        check_surface(np.array([[0, 1, 2], [0, 1, 3]]))


def test_check_faces_names_face_and_index():
    with pytest.raises(InvalidMeshError, match=r"face 1 has index 9, vertices are 0\.\.3"):
        check_faces([[0, 1, 2], [1, 9, 3]], 4)


def test_check_faces_refuses_floats():
    with pytest.raises(InvalidMeshError, match="integers"):
        check_faces([[0.0, 1.0, 2.0]], 3)


def test_check_points_names_the_bad_row():
    with pytest.raises(InvalidArrayError, match="row 1"):
        check_points([[0, 0, 0], [0, np.nan, 0]])


def test_check_points_refuses_wrong_shape():
    with pytest.raises(InvalidArrayError, match=r"\(n, 3\), got \(2, 2\)"):
        check_points([[0, 0], [1, 1]])

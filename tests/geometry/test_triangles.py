from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from skinmap.geometry.triangles import (
    face_areas,
    face_normals,
    jacobians,
    signed_areas,
    singular_values,
    smallest_altitudes,
    vertex_areas,
)

# Rounding of a handful of double operations on numbers of order one.
EXACT = {"rtol": 0, "atol": 1e-12}


def test_face_areas_of_sphere_approach_four_pi(sphere):
    vertices, faces = sphere
    # The 320 facets cut 2.0 % off the sphere's area (closed form would be the limit).
    assert 0.97 < face_areas(vertices, faces).sum() / (4 * np.pi) < 1.0


def test_vertex_areas_sum_to_face_areas(sphere):
    vertices, faces = sphere
    total = face_areas(vertices, faces).sum()
    assert_allclose(vertex_areas(vertices, faces).sum(), total, rtol=1e-12, atol=0)


def test_face_normals_of_sphere_point_outward(sphere):
    vertices, faces = sphere
    middle = vertices[faces].mean(axis=1)
    normals = face_normals(vertices, faces)
    assert (np.einsum("ij,ij->i", normals, middle) > 0.9).all()


def test_smallest_altitude_of_right_triangle():
    vertices = np.array([[0.0, 0, 0], [4, 0, 0], [0, 3, 0]])
    assert_allclose(smallest_altitudes(vertices, np.array([[0, 1, 2]])), 12 / 5, **EXACT)


def test_smallest_altitude_of_collapsed_triangle_is_zero():
    assert smallest_altitudes(np.zeros((3, 3)), np.array([[0, 1, 2]])) == 0.0


def test_signed_area_changes_sign_with_a_mirror(square_grid):
    vertices, faces = square_grid(4)
    uv = vertices[:, :2]
    assert_allclose(signed_areas(uv, faces), -signed_areas(uv * [-1, 1], faces), **EXACT)


@given(arrays(float, (5, 2, 2), elements=st.floats(-100, 100)))
def test_singular_values_agree_with_svd(maps):
    first, second = singular_values(maps)
    expected = np.linalg.svd(maps, compute_uv=False)
    # The square root of a difference loses half of the digits near equal singular values.
    assert_allclose(np.stack([first, np.abs(second)], 1), expected, rtol=0, atol=1e-5)


@given(arrays(float, (5, 2, 2), elements=st.floats(-100, 100)))
def test_singular_values_carry_the_sign_of_the_determinant(maps):
    first, second = singular_values(maps)
    # Written out: numpy's det takes logarithms and warns for the smallest numbers there are.
    determinant = maps[:, 0, 0] * maps[:, 1, 1] - maps[:, 0, 1] * maps[:, 1, 0]
    assert_allclose(first * second, determinant, rtol=1e-9, atol=1e-9)


def test_jacobians_of_a_rotation_are_rotations(half_cylinder, rng):
    vertices, faces = half_cylinder
    # Each triangle laid flat by itself and turned: an isometry in its own plane.
    corners = vertices[faces]
    x = corners[:, 1] - corners[:, 0]
    length = np.linalg.norm(x, axis=1, keepdims=True)
    axis = x / length
    third = corners[:, 2] - corners[:, 0]
    along = np.einsum("ij,ij->i", third, axis)
    up = np.linalg.norm(third - along[:, None] * axis, axis=1)
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    flat = np.zeros((len(faces), 3, 2))
    flat[:, 1, 0], flat[:, 2, 0], flat[:, 2, 1] = length[:, 0], along, up
    uv = (flat @ turn.T).reshape(-1, 2)
    maps = jacobians(corners.reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), uv)
    assert_allclose(maps, np.broadcast_to(turn, maps.shape), **EXACT)

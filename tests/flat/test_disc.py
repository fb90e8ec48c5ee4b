from __future__ import annotations

import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinmap.flat.dirichlet import as_rigid_as_possible, closest_rotations
from skinmap.flat.disc import Disc
from skinmap.geometry.topology import boundary_loops
from skinmap.geometry.triangles import face_areas, jacobians, smallest_altitudes


@pytest.fixture
def cap(sphere, rng) -> Disc:
    """Most of a ball, dented."""
    vertices, faces = sphere
    kept = faces[(vertices[faces][:, :, 2] > -0.4).all(axis=1)]
    used, compact = np.unique(kept, return_inverse=True)
    points = vertices[used] * (1.0 + 0.05 * rng.normal(size=(len(used), 1)))
    disc = compact.reshape(-1, 3)
    return Disc(points, disc, boundary_loops(disc)[0])


def test_laplacian_and_angles_are_those_of_libigl(cap):
    theirs = -igl.cotmatrix(cap.vertices, cap.faces)
    # Cotangents of angles down to 20 degrees.
    assert abs(cap.laplacian - theirs).max() < 1e-12
    angles = igl.internal_angles(cap.vertices, cap.faces)
    sums = np.bincount(cap.faces.ravel(), angles.ravel())
    assert_allclose(cap.angle_sums, sums, atol=1e-12)


def test_laplacian_is_the_divergence_of_the_gradient(cap):
    product = cap.divergence @ (cap.gradient * np.repeat(cap.areas, 2)[:, None])
    assert abs(cap.laplacian - product).max() < 1e-12


def test_gradient_areas_and_altitudes_are_those_of_the_triangles(cap):
    uv = cap.conformal
    maps = (cap.gradient @ uv).reshape(-1, 2, 2).transpose(0, 2, 1)
    assert_allclose(maps, jacobians(cap.vertices, cap.faces, uv), atol=1e-11)
    assert_allclose(cap.areas, face_areas(cap.vertices, cap.faces), rtol=1e-12)
    altitudes = smallest_altitudes(cap.vertices, cap.faces)
    assert_allclose(cap.smallest_altitudes, altitudes, rtol=1e-9)


def test_arap_is_that_of_libigl(cap):
    data = igl.ARAPData()
    data.max_iter = 10
    igl.arap_precomputation(cap.vertices, cap.faces, 2, np.array([0], np.int32), data)
    start = cap.conformal - cap.conformal[0]  # both keep vertex 0 where it is
    theirs = np.asarray(igl.arap_solve(start[[0]], data, start))
    ours = as_rigid_as_possible(cap, start, iterations=10)
    assert_allclose(ours, theirs, atol=1e-9)


def test_closest_rotations_keep_rotations_and_ignore_scale():
    angle = np.array([0.3, 2.0])
    c, s = np.cos(angle), np.sin(angle)
    turns = np.stack([c, s, -s, c], axis=1).reshape(-1, 2, 2)
    assert_allclose(closest_rotations(3.0 * turns), turns, atol=1e-15)


def test_is_injective_refuses_flips_nan_and_other_shapes(cap):
    uv = cap.conformal
    assert cap.is_injective(uv)
    assert not cap.is_injective(uv * [1.0, -1.0])
    assert not cap.is_injective(uv[:-1])
    assert not cap.is_injective(np.where(np.arange(len(uv))[:, None] == 3, np.nan, uv))

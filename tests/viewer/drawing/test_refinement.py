import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinmap.geometry.topology import border_edges, check_surface, euler_number
from skinmap.geometry.triangles import face_normals
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import build_surface
from viewer.drawing.skin.skin_layer import FineSurface, split


@pytest.fixture(scope="module")
def plane(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return build_surface(skin_from_points(points, normals))


@pytest.mark.parametrize("levels", [0, 1, 2])
def test_refine_keeps_taxels_and_their_values_exactly(prepared, levels):
    mesh = prepared("torso").mesh
    fine = FineSurface(mesh, levels)
    values = np.random.default_rng(1).uniform(0, 255, len(mesh.skin))
    k = len(fine.taxels)
    # One product with the weight 1: no rounding, so no tolerance.
    assert np.array_equal((fine.smooth @ values)[:k], values[fine.taxels])
    assert np.array_equal(fine.positions[:k], mesh.vertices[fine.taxels])
    assert len(fine.faces) == 4**levels * len(mesh.faces)


@pytest.mark.parametrize("part", ["torso", "left_foot"])
def test_refine_weights_of_each_vertex_sum_to_one(prepared, part):
    fine = FineSurface(prepared(part).mesh, 2)
    ones = np.ones(fine.smooth.shape[1])
    # About 20 terms a row, each rounded to 1e-16.
    assert_allclose(fine.smooth @ ones, 1.0, rtol=0, atol=1e-12)
    assert_allclose(fine.linear @ ones, 1.0, rtol=0, atol=1e-12)


def test_refine_reproduces_linear_fields_on_a_plane(plane):
    fine = FineSurface(plane, 2)
    slope = np.array([3.0, -2.0, 0.0])
    for weights in (fine.smooth, fine.linear):
        assert_allclose(
            weights @ (plane.vertices @ slope), fine.positions @ slope, rtol=0, atol=1e-12
        )


def test_refine_is_nearer_to_a_smooth_bump_than_straight_edges(plane):
    def bump(points):
        return np.exp(-((points - plane.vertices.mean(axis=0)) ** 2).sum(axis=1) / 0.02**2)

    fine = FineSurface(plane, 1)
    inside = np.setdiff1d(np.arange(len(fine.positions)), border_edges(fine.faces))
    truth, values = bump(fine.positions), bump(plane.vertices)
    smooth, linear = (np.abs(w @ values - truth)[inside].max() for w in (fine.smooth, fine.linear))
    assert smooth < 0.5 * linear


def test_refine_follows_the_curve_of_a_cylinder():
    angle, height = np.meshgrid(np.arange(-8, 9) * 0.15, np.arange(12) * 6e-3)
    radius = 0.04
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1).reshape(-1, 3)
    points = radius * normals + height.reshape(-1, 1) * [0.0, 0.0, 1.0]
    fine = FineSurface(build_surface(skin_from_points(points, normals)), 1)
    away = np.linalg.norm(fine.positions[:, :2], axis=1) - radius
    # Chords of 0.15 rad (diagonals 0.15 too) sag by R (1 - cos(0.075)) = 0.11 mm; the cubic
    # leaves O(angle^4), some micrometres.
    assert np.abs(away).max() < 5e-6


def test_refine_stays_an_outward_surface_with_the_same_holes(prepared):
    mesh = prepared("torso").mesh
    fine = FineSurface(mesh, 1)
    check_surface(fine.faces)
    assert euler_number(fine.faces) == euler_number(mesh.faces)
    facing = np.einsum(
        "ij,ij->i", face_normals(fine.positions, fine.faces), fine.normals[fine.faces[:, 0]]
    )
    # A few triangles that close holes stand steep; none of the others is turned inwards.
    assert (facing > 0).mean() > 0.99


def test_split_numbers_each_edge_once():
    ends, faces = split(np.array([[0, 1, 2], [2, 1, 3]]))
    assert len(ends) == 5
    assert faces.shape == (8, 3)
    assert set(faces.ravel()) == set(range(9))

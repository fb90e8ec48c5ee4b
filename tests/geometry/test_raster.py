from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinmap.geometry import raster
from skinmap.geometry.raster import locate_pixels, pixel_coverage

ONE = np.array([[0, 1, 2]])


def upright(points):
    """The triangle's corners in the order that is counter-clockwise where y grows upwards."""
    (a, b, c) = points
    turn = (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]
    return points if turn < 0 else points[::-1]


def area(points):
    (a, b, c) = points
    return abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]) / 2


coordinates = st.floats(0.0, 6.0, allow_subnormal=False)
triangles = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=3)


@given(triangles)
def test_coverage_sums_to_the_area(corners):
    points = upright(np.array(corners))
    covered = pixel_coverage(points, ONE, (6, 6))
    # Sums of at most 36 pixels of size 1, each rounded a few times.
    assert covered.sum() == pytest.approx(area(points), abs=1e-12)


def test_coverage_of_a_half_square_is_known():
    points = np.array([[0.0, 0.0], [0.0, 3.0], [3.0, 3.0]])
    expected = np.tril(np.ones((3, 3)), -1) + 0.5 * np.eye(3)
    np.testing.assert_allclose(pixel_coverage(points, ONE, (3, 3)), expected, atol=1e-15)


def test_coverage_leaves_holes_empty(square_grid):
    vertices, faces = square_grid(7)
    points = 6.0 * vertices[:, :2] * [1, -1] + [0, 6]
    middle = points[faces].mean(axis=1)
    hole = (np.abs(middle - 3.0) < 1.0).all(axis=1)
    covered = pixel_coverage(points, faces[~hole], (6, 6))
    expected = np.ones((6, 6))
    expected[2:4, 2:4] = 0.0
    np.testing.assert_allclose(covered, expected, atol=1e-15)


@given(triangles)
def test_located_pixels_are_where_their_weights_say(corners):
    points = upright(np.array(corners))
    pixels, face, weights = locate_pixels(points, ONE, (6, 6))
    centres = np.column_stack([pixels % 6, pixels // 6]) + 0.5
    # A centre may lie 1e-9 of a triangle outside, and then goes to the edge: 6 pixels * 3e-9.
    np.testing.assert_allclose(
        np.einsum("ij,ijk->ik", weights, points[ONE[face]]), centres, atol=2e-8
    )
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-15)


def test_every_pixel_of_a_tiled_square_is_located_once(square_grid, monkeypatch):
    vertices, faces = square_grid(9)
    points = 40.0 * vertices[:, :2]  # centres lie on edges and diagonals of the tiling, too
    whole = locate_pixels(points, faces, (40, 40))
    np.testing.assert_array_equal(whole[0], np.arange(1600))
    monkeypatch.setattr(raster, "CHUNK", 50)
    for one, other in zip(whole, locate_pixels(points, faces, (40, 40)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_triangle_without_area_holds_no_pixel():
    points = np.array([[0.5, 0.5], [1.5, 1.5], [2.5, 2.5]])
    pixels, _, weights = locate_pixels(points, ONE, (3, 3))
    assert len(pixels) == len(weights) == 0

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinmap.errors import InvalidArrayError
from skinmap.geometry.log_maps import BLOCK, KEPT_POINTS, LogMaps, log_map
from skinmap.geometry.proximity import (
    MAX_COINCIDENT,
    bridged_graph,
    closest_on_mesh,
    median_spacing,
    nearest,
    path_distances,
    ray_hits,
)
from skinmap.geometry.rigid import check_transform, transform_points


def test_nearest_never_returns_the_point_itself(hexagons, rng):
    points = np.concatenate([hexagons, hexagons[:5]])  # five coincident pairs
    distance, index = nearest(points, 4)
    assert (index != np.arange(len(points))[:, None]).all()
    assert_allclose(distance[:5, 0], 0.0, atol=0)


def test_median_spacing_of_hexagons_is_the_pitch(hexagons):
    assert median_spacing(hexagons) == pytest.approx(6.5e-3, rel=1e-12)


def test_thousands_of_points_at_one_place_are_refused_not_searched(rng):
    plane = np.column_stack([np.zeros(3 * MAX_COINCIDENT), rng.random((3 * MAX_COINCIDENT, 2))])
    assert median_spacing(plane) > 0.0  # one x for all of them is no crowd
    crowd = np.concatenate([plane, np.tile(plane[:1], (MAX_COINCIDENT - 1, 1))])
    assert median_spacing(crowd) > 0.0
    with pytest.raises(InvalidArrayError, match=r"^1001 points at one place \(0, 0\.\d+, 0\.\d+\)"):
        median_spacing(np.concatenate([crowd, plane[:1]]))


def test_closest_on_mesh_finds_planted_points(half_cylinder, rng):
    vertices, faces = half_cylinder
    face = rng.integers(len(faces), size=30)
    weights = rng.dirichlet([1, 1, 1], size=30)
    planted = np.einsum("ij,ijk->ik", weights, vertices[faces[face]])
    distance, _, closest = closest_on_mesh(planted, vertices, faces)
    assert_allclose(distance, 0.0, atol=1e-12)
    assert_allclose(closest, planted, rtol=0, atol=1e-12)


def test_ray_hits_sphere_from_outside_only(sphere):
    vertices, faces = sphere
    origins = np.array([[3.0, 0.01, 0.02], [3.0, 0.01, 0.02]])
    hits = ray_hits(origins, np.array([[-1.0, 0, 0], [1.0, 0, 0]]), vertices, faces)
    np.testing.assert_array_equal(hits, [True, False])


def test_path_distances_on_hexagons_are_at_least_euclidean(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    paths = path_distances(bridged_graph(points, 18, 2.5 * 6.5e-3))
    straight = np.linalg.norm(points[:, None] - points[None], axis=2)
    ratio = paths[straight > 0] / straight[straight > 0]
    # Two rings of neighbours leave gaps of pi / 12 between directions: 1 / cos(pi / 24) at most
    # inside, a little more where the lattice ends.
    assert ratio.min() >= 1.0 - 1e-12
    assert ratio.max() < 1.08


def test_large_patches_are_joined_without_a_table_of_all_their_distances():
    row = np.stack(np.meshgrid(np.arange(100), np.arange(100)), -1).reshape(-1, 2) * 5e-3
    patch = np.column_stack([row, np.zeros(len(row))])
    tracemalloc.start()
    graph = bridged_graph(np.concatenate([patch, patch + [0.6, 0.0, 0.01]]), 10, 1.25e-2)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert graph[:10_000, 10_000:].data == pytest.approx([np.hypot(0.105, 0.01)])
    assert peak < 100e6  # all pairs are 1e8, with three differences each


def test_bridged_graph_joins_pieces_by_their_gap():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [10, 0, 0], [11, 0, 0]])
    paths = path_distances(bridged_graph(points, 2, 2.0))
    assert_allclose(paths[0], [0, 1, 10, 11], rtol=1e-12)


def test_log_map_of_a_plane_is_exact(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    graph = bridged_graph(points, 6, 0.01)
    uv, _ = log_map(points, normals, graph, 40, 1.0)
    step = points[:, :2] - points[40, :2]
    # A plane isometry: lengths and mutual angles are those of the lattice.
    assert_allclose(uv @ uv.T, step @ step.T, rtol=0, atol=1e-15)


def test_log_map_of_a_cylinder_keeps_lengths_round_the_bend(half_cylinder):
    vertices, _ = half_cylinder
    normals = np.column_stack(
        [-np.sin(angle := 3 * np.linspace(0, 1, 15)), 0 * angle, np.cos(angle)]
    )
    normals = np.tile(normals, (15, 1))
    uv, _ = log_map(vertices, normals, bridged_graph(vertices, 8, 0.2), 7 * 15 + 7, 2.0)
    flat = np.column_stack([np.tile(np.linspace(0, 1, 15), 15), vertices[:, 1]]) - 0.5
    # Chords of a bend of 3/14 rad are 0.2 % short of the arc, and a diagonal step turns by up to
    # (3/14)^2 / 8 = 0.6 % between two tangent planes: together below 2 % of the largest product.
    assert_allclose(uv @ uv.T, flat @ flat.T, rtol=0, atol=0.02 * 0.5)


def test_log_map_leaves_out_what_lies_beyond_reach(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    uv, length = log_map(points, normals, bridged_graph(points, 6, 0.01), 0, 0.02)
    far = length > 0.02
    assert far.any()
    assert np.isnan(uv[far]).all()
    assert np.isfinite(uv[~far]).all()


@pytest.mark.parametrize("kept", [True, False])
def test_log_maps_made_many_at_once_are_those_made_one_by_one(half_cylinder, rng, kept):
    vertices, _ = half_cylinder
    copies = 1 if kept else 1 + KEPT_POINTS // len(vertices)
    points = np.concatenate([vertices + [0.0, 2.0 * k, 0.0] for k in range(copies)])
    normals = rng.normal(0.0, 0.2, points.shape) + [0.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    graph = bridged_graph(points, 8, 0.2)
    maps = LogMaps(points, normals, graph, 0.7)
    assert len(vertices) > 2 * BLOCK
    for source in (0, BLOCK - 1, BLOCK, len(vertices) - 1, 0):
        alone, _ = log_map(points, normals, graph, source, 0.7)
        # To the bit: simulated touches, and what was trained on them, rest on these.
        np.testing.assert_array_equal(maps.around(source), alone)
        assert np.isfinite(alone).any(axis=1).sum() > 10


def test_transform_points_turns_then_shifts():
    transform = np.array([[0.0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    assert_allclose(transform_points(transform, np.array([[1.0, 0, 0]])), [[5, 1, 0]], atol=0)


@pytest.mark.parametrize("bad", [np.diag([1.0, 1, -1, 1]), 2 * np.eye(4), np.zeros((4, 4))])
def test_check_transform_refuses_what_is_not_rigid(bad):
    with pytest.raises(InvalidArrayError, match="not rigid"):
        check_transform(bad)

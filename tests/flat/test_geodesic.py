from __future__ import annotations

import numpy as np
import pytest

from skinmap.flat import costs
from skinmap.flat.costs import _Lines
from skinmap.flat.methods import flatten_disc
from skinmap.flat.seams import open_surface


def geodesic_stress(vertices, faces, uv, *, seed=0, exact=False):
    rng = np.random.default_rng(seed)
    return costs.geodesic_stress(vertices, faces, uv, rng=rng, exact=exact).value


def test_a_plane_has_no_stress(square_grid):
    vertices, faces = square_grid(7)
    # Exact geodesics are sums of square roots: half of the digits are left.
    assert geodesic_stress(vertices, faces, vertices[:, :2]) < 1e-7


def test_an_unrolled_cylinder_has_the_stress_of_its_facets(half_cylinder, square_grid):
    vertices, faces = half_cylinder
    flat, _ = square_grid(15)
    # Facets are 0.19 % short of the arc, and the diagonals bend once a facet.
    assert geodesic_stress(vertices, faces, flat[:, :2]) < 0.003


def test_a_notch_does_not_count(square_grid):
    vertices, faces = square_grid(11)
    middle = vertices[faces].mean(axis=1)
    notch = (np.abs(middle[:, 0] - 0.5) < 0.11) & (middle[:, 1] > 0.35)
    used, compact = np.unique(faces[~notch], return_inverse=True)
    points, horseshoe = vertices[used], compact.reshape(-1, 3)
    uv = points[:, :2]
    assert geodesic_stress(points, horseshoe, uv) < 1e-7
    corner = int(np.argmin(np.linalg.norm(uv - [0, 1], axis=1)))
    other = int(np.argmin(np.linalg.norm(uv - [1, 1], axis=1)))
    every = np.arange(len(uv))
    free = _Lines(uv, horseshoe).free(np.full(len(uv), corner), every)
    assert not free[other]
    assert free[int(np.argmin(np.linalg.norm(uv, axis=1)))]  # straight down along the border


def test_lines_across_a_seam_that_closes_on_the_map_do_not_count(square_grid):
    vertices, faces = square_grid(13)
    faces = faces[(np.abs(vertices[faces][:, :, :2] - 0.5) > 0.26).any(axis=(1, 2))]
    used, compact = np.unique(faces, return_inverse=True)
    points = vertices[used]
    cut = open_surface(points, compact.reshape(-1, 3), hole_share=0.1)
    assert cut.seam_length > 0.0
    own = points[cut.origin]
    assert geodesic_stress(own, cut.faces, own[:, :2], exact=True) < 1e-6
    everyone = np.arange(len(own))
    free = _Lines(own[:, :2], cut.faces).free(np.full(len(own), int(cut.faces[0, 0])), everyone)
    assert free.mean() > 0.3


def test_stress_of_a_stretch_has_its_closed_form(square_grid):
    vertices, faces = square_grid(5)
    uv = vertices[:, :2] * [2.0, 1.0]
    step = vertices[:, None, :2] - vertices[None, :, :2]
    real = np.linalg.norm(step, axis=2)
    flat = np.linalg.norm(step * [2**0.5, 0.5**0.5], axis=2)  # at the scale that keeps the area
    expected = np.sqrt(((flat - real) ** 2).sum() / (real**2).sum())
    assert geodesic_stress(vertices, faces, uv, exact=True) == pytest.approx(expected, rel=1e-6)


def test_stress_of_the_icub_is_small(prepared):
    flat = prepared("left_forearm").flat
    for chart in flat.charts:
        vertices = flat.mesh.vertices[chart.taxels]
        assert geodesic_stress(vertices, chart.faces, chart.uv) < 0.012


def test_stress_does_not_depend_on_scale_place_turn_or_order(square_grid, rng):
    vertices, faces = square_grid(7)
    vertices = vertices + [0, 0, 0.3] * np.sin(2 * vertices[:, :1])
    uv = vertices[:, :2] + rng.normal(scale=0.005, size=(len(vertices), 2))
    turn = np.array([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]])
    order = rng.permutation(len(vertices))
    place = np.argsort(order)
    one = geodesic_stress(vertices, faces, uv, exact=True)
    moved = 1e-3 * (vertices[order] + 7.0), place[faces], 50.0 * (uv[order] @ turn.T - 3.0)
    # Lines that touch the border within rounding may count once and not the other time.
    assert geodesic_stress(*moved, exact=True) == pytest.approx(one, rel=1e-3)


def bent(n):
    """A doubly bent sheet of n by n vertices."""
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)))
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = (
        number[i : n - 1 + i, j : n - 1 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
    )
    points = np.column_stack([np.cos(2 * x), np.sin(2 * x) * (1 + 0.2 * np.sin(3 * y)), y])
    return points, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def test_the_stated_error_covers_all_pairs():
    vertices, faces = bent(18)
    uv = flatten_disc(vertices, faces)[0]
    exact = geodesic_stress(vertices, faces, uv, exact=True)
    assert exact > 1e-3
    found = [
        costs.geodesic_stress(vertices, faces, uv, rng=np.random.default_rng(seed))
        for seed in range(20)
    ]
    # Intervals of 95 %: fewer than 16 of 20 come once in 380 times (binomial).
    assert sum(abs(one.value - exact) <= one.error for one in found) >= 16
    assert max(one.error for one in found) < exact


def test_pairs_on_a_large_mesh_agree_with_exact_distances_on_a_coarser_one():
    stresses = {}
    for n in (22, 44):  # exact distances from six vertices, and single pairs
        vertices, faces = bent(n)
        uv = flatten_disc(vertices, faces)[0]
        stresses[n] = costs.geodesic_stress(vertices, faces, uv, rng=np.random.default_rng(1))
    coarse, fine = stresses[22], stresses[44]
    assert fine.pairs <= costs.PAIRS[1] < coarse.pairs
    assert abs(coarse.value - fine.value) <= coarse.error + fine.error


def test_a_mesh_with_slivers_has_no_stress_instead_of_a_search_without_end(square_grid):
    vertices, faces = square_grid(9)
    vertices[vertices[:, 0] == 0.5, 0] = 0.375 + 1e-7  # a column of triangles
    assert np.isnan(geodesic_stress(vertices, faces, vertices[:, :2]))

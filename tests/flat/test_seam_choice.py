"""Seams chosen by touches, by a bound of distortion, by hand, or left out."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial import cKDTree

from skinmap.errors import FlatteningError, InvalidArrayError, InvalidMeshError, SkinWarning
from skinmap.flat.flat_map import flatten
from skinmap.flat.mesh_charts import mesh_surface
from skinmap.flat.seam_choice import seam_of_touches
from skinmap.flat.seams import divided_touches, open_surface, path_along

SHARE = 0.35


def tube(around, along, radius, length):
    """Vertices and faces of an open tube."""
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(around), np.arange(along)))
    angle = 2.0 * np.pi * i / around
    height = length * j / (along - 1)
    vertices = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    p = np.arange(around * (along - 1))
    q = p // around * around + (p + 1) % around
    lower = np.column_stack([p, q, p + around])
    return vertices, np.concatenate([lower, np.column_stack([q, q + around, p + around])])


def presses(vertices, places, rng, count, reach):
    """Round touches near habitual places, their taxels within a reach [m]."""
    tree = cKDTree(vertices)
    middles = places[rng.integers(0, len(places), count)] + rng.normal(0, reach / 2, (count, 3))
    return [
        np.array(found) for found in tree.query_ball_point(vertices[tree.query(middles)[1]], reach)
    ]


def surface(vertices, faces):
    return mesh_surface(vertices, faces, name="made")


def overlaps(chart):
    triangles = shapely.polygons(chart.uv[chart.faces])
    total = shapely.area(triangles).sum()
    return abs(shapely.union_all(triangles).area - total) > 1e-6 * total


@pytest.mark.parametrize("closed", [False, True])
def test_touches_not_used_for_choosing_are_divided_less(closed, sphere, rng):
    vertices, faces = sphere if closed else tube(24, 20, 1.0, 5.0)
    mesh = surface(vertices, faces)
    plain, counts = flatten(mesh), []
    for _ in range(3):
        half = np.flatnonzero(vertices @ rng.normal(size=3) > 0)
        places = vertices[rng.choice(half, 3)]
        known, others = (presses(mesh.vertices, places, rng, 100, 0.7) for _ in range(2))
        (wise,) = flatten(mesh, touches=known).charts
        (usual,) = plain.charts
        # The cost that is allowed: half a point of edge error.
        assert wise.distortion.edge_rms <= usual.distortion.edge_rms + 0.005
        assert not overlaps(wise)
        counts.append([divided_touches(c.faces, c.taxels, others) for c in (usual, wise)])
    usual, wise = np.sum(counts, axis=0)
    assert usual > 10
    assert wise <= 0.65 * usual


def test_touches_spread_evenly_keep_the_shortest_seam_of_a_tube(rng):
    vertices, faces = tube(24, 20, 1.0, 5.0)
    touches = presses(vertices, vertices, rng, 150, 0.7)
    cut, found = seam_of_touches(vertices, faces, touches, lambda _: 0.0, hole_share=SHARE)
    plain = open_surface(vertices, faces, hole_share=SHARE)
    np.testing.assert_array_equal(cut.faces, plain.faces)
    assert found.divided == found.divided_shortest > 5


def test_no_seam_is_taken_that_costs_more_edge_error(rng):
    vertices, faces = tube(24, 20, 1.0, 5.0)
    plain = open_surface(vertices, faces, hole_share=SHARE)
    seam = np.flatnonzero(np.bincount(plain.origin) > 1)
    touches = presses(vertices, vertices[seam[[4, 9, 14]]], rng, 100, 0.7)

    def error(cut):
        return 0.0 if np.array_equal(cut.faces, plain.faces) else 0.0051

    cut, found = seam_of_touches(vertices, faces, touches, error, hole_share=SHARE)
    np.testing.assert_array_equal(cut.faces, plain.faces)
    better, other = seam_of_touches(vertices, faces, touches, lambda _: 0.0, hole_share=SHARE)
    assert other.divided < found.divided
    assert not np.array_equal(better.faces, plain.faces)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("shape", ["straight", "bent", "noisy"])
def test_a_tube_laid_flat_uncut_repeats_itself(shape, turned, rng):
    vertices, faces = tube(24, 20, 1.0, 5.0)
    if shape == "bent":
        vertices = vertices + [0.4, 0, 0] * np.sin(vertices[:, 2:])
    if shape == "noisy":
        vertices = vertices + rng.normal(scale=0.05, size=vertices.shape)
    mesh = surface(vertices, faces[:, ::-1] if turned else faces)
    (chart,) = flatten(mesh, periodic=True).charts
    assert (chart.method, chart.seam_length, chart.distortion.flips) == ("periodic", 0.0, 0)
    assert chart.period is not None
    for taxel in np.flatnonzero(np.bincount(chart.taxels) > 1):
        one, other = chart.uv[chart.taxels == taxel]
        step = other - one
        np.testing.assert_allclose(step * np.sign(step @ chart.period), chart.period, atol=1e-9)
    # It and its repetition do not lie over each other.
    triangles = chart.uv[chart.faces]
    both = shapely.polygons(np.concatenate([triangles, triangles + chart.period]))
    total = shapely.area(both).sum()
    assert abs(shapely.union_all(both).area - total) < 1e-6 * total
    if shape == "straight":
        assert chart.distortion.edge_rms < 1e-6
        around = 24 * 2 * np.sin(np.pi / 24)  # the polygon's circumference, exactly
        assert np.linalg.norm(chart.period) == pytest.approx(around)


def test_no_place_of_a_periodic_map_distorts_for_the_seam(rng):
    """On a surface of revolution the map of least energy does not know where it is opened."""
    vertices, faces = tube(24, 20, 1.0, 5.0)
    vertices[:, :2] *= 1.0 + 0.2 * np.sin(vertices[:, 2:])
    (chart,) = flatten(surface(vertices, faces), periodic=True).charts
    energy = chart.distortion.symmetric_dirichlet.reshape(2, 19, 24)
    np.testing.assert_allclose(energy, energy[:, :, :1].repeat(24, axis=2), rtol=2e-3)


def test_what_is_no_tube_is_refused_without_a_seam(sphere, square_grid):
    with pytest.raises(FlatteningError, match="not a tube"):
        flatten(surface(*sphere), periodic=True)
    (chart,) = flatten(surface(*square_grid(6)), periodic=True).charts  # a disc needs no seam
    assert chart.period is None


@pytest.mark.parametrize("shape", ["sphere", "torus"])
def test_seams_bring_a_chart_below_its_bound(shape, sphere):
    if shape == "sphere":
        vertices, faces = sphere
    else:
        mesh = trimesh.creation.torus(1.0, 0.35, major_sections=40, minor_sections=20)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64)
    mesh = surface(vertices, faces)
    (free,) = flatten(mesh, method="dirichlet").charts
    (bound,) = flatten(mesh, method="dirichlet", max_distortion=4.06).charts
    assert free.distortion.mean_energy > 4.06 >= bound.distortion.mean_energy
    assert bound.seam_length > free.seam_length
    assert bound.distortion.flips == 0
    assert not overlaps(bound)


def test_a_bound_below_an_isometry_is_refused(sphere):
    with pytest.raises(InvalidArrayError, match="above 4"):
        flatten(surface(*sphere), max_distortion=4.0)


def test_a_seam_runs_where_it_is_told():
    vertices, faces = tube(24, 20, 1.0, 5.0)
    way = path_along(vertices, faces, np.array([7, 7 + 19 * 24]))
    (chart,) = flatten(surface(vertices, faces), cuts=way).charts
    on_seam = np.flatnonzero(np.bincount(chart.taxels) > 1)
    np.testing.assert_array_equal(on_seam, 7 + 24 * np.arange(20))


def test_a_seam_that_cuts_a_patch_into_pieces_is_refused():
    vertices, faces = tube(24, 20, 1.0, 5.0)
    ring = 24 * 9 + np.append(np.arange(24), 0)
    with pytest.raises(InvalidMeshError, match="into 2 pieces"):
        open_surface(
            vertices, faces, hole_share=SHARE, along=np.column_stack([ring[:-1], ring[1:]])
        )


def test_sheets_that_meet_at_an_edge_come_apart_where_they_bend():
    flat = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]]
    vertices = np.array([*flat, [1, 0, 1], [1, 1, 1]], float)
    faces = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [1, 6, 7], [1, 7, 4]])
    with pytest.warns(SkinWarning, match="mesh: 1 edges in three faces or more: taken apart"):
        mesh = mesh_surface(vertices, faces)
    # The ground goes on under the fin, the fin stands alone.
    assert sorted(np.bincount(mesh.face_patches)) == [2, 4]
    assert sorted(len(chart.taxels) for chart in flatten(mesh).charts) == [4, 6]


def test_counting_divided_touches_equals_counting_one_by_one(rng):
    vertices, faces = tube(24, 20, 1.0, 5.0)
    cut = open_surface(vertices, faces, hole_share=SHARE)
    tree = cKDTree(vertices)
    touches = [np.array(found) for found in tree.query_ball_point(vertices[::7], 0.8)]
    each = sum(divided_touches(cut.faces, cut.origin, [touch]) for touch in touches)
    assert divided_touches(cut.faces, cut.origin, touches) == each > 3

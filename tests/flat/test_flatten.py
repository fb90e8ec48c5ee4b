from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinmap.errors import (
    FlatteningError,
    InvalidArrayError,
    InvalidMeshError,
    SkinWarning,
    UnknownNameError,
)
from skinmap.flat.atlas import pack
from skinmap.flat.disc import Disc
from skinmap.flat.distortion import measure_distortion
from skinmap.flat.flat_map import flatten, flatten_disc
from skinmap.flat.methods import flatteners
from skinmap.geometry.topology import boundary_loops
from skinmap.geometry.triangles import face_areas, signed_areas

FREE = ["bff", "fast", "lscm", "arap", "balanced", "slim", "dirichlet", "accurate"]
FIXED = ["tutte", "harmonic"]


@pytest.mark.parametrize("method", FREE)
def test_every_free_method_flattens_a_plane_without_distortion(square_grid, method):
    vertices, faces = square_grid(8)
    turned = vertices @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    uv, used, holes = flatten_disc(turned, faces, method=method)
    d = measure_distortion(turned, faces, uv)
    assert (used, holes) == (method, 0)
    assert d.edge_rms < 1e-7  # LSCM's least squares leaves 1e-9, the others less
    assert signed_areas(uv, faces).sum() == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("method", FREE)
def test_every_free_method_unrolls_a_cylinder(half_cylinder, method):
    vertices, faces = half_cylinder
    uv, _, _ = flatten_disc(vertices, faces, method=method)
    # The facets bend a developable surface by (3/14)^2 / 24 = 0.2 %; conformal methods pay a
    # little more for it along the border.
    assert measure_distortion(vertices, faces, uv).edge_rms < 0.004


@pytest.mark.parametrize("method", FIXED + FREE)
def test_every_method_is_free_of_flips_on_a_cap(sphere, method):
    vertices, faces = sphere
    cap = faces[(vertices[faces][:, :, 2] > -0.3).all(axis=1)]
    used, compact = np.unique(cap, return_inverse=True)
    uv, _, _ = flatten_disc(vertices[used], compact.reshape(-1, 3), method=method)
    assert (signed_areas(uv, compact.reshape(-1, 3)) > 0).all()


def test_bff_keeps_the_lengths_of_the_border(sphere):
    vertices, faces = sphere
    cap = faces[(vertices[faces][:, :, 2] > 0.2).all(axis=1)]
    used, compact = np.unique(cap, return_inverse=True)
    points, disc = vertices[used], compact.reshape(-1, 3)
    (loop,) = boundary_loops(disc)
    uv = Disc(points, disc, loop).conformal
    length = np.linalg.norm(points[loop] - points[np.roll(loop, -1)], axis=1)
    flat = np.linalg.norm(uv[loop] - uv[np.roll(loop, -1)], axis=1)
    # Lengths change only as far as closing the discrete curve needs.
    assert_allclose(flat, length, rtol=0.02)


def test_bff_is_more_conformal_than_arap_and_arap_more_isometric(prepared):
    mesh = prepared("torso").mesh
    conformal, rigid = flatten(mesh, method="bff"), flatten(mesh, method="arap")
    one, other = conformal.charts[0].distortion, rigid.charts[0].distortion
    assert np.average(one.quasi_conformal, weights=one.face_areas) < np.average(
        other.quasi_conformal, weights=other.face_areas
    )
    assert other.edge_rms < one.edge_rms


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_flatten_disc_does_not_depend_on_scale(half_cylinder, scale):
    vertices, faces = half_cylinder
    one, _, _ = flatten_disc(vertices, faces)
    other, _, _ = flatten_disc(vertices * scale, faces)
    assert_allclose(other / scale, one, rtol=0, atol=1e-9)


def test_icub_is_flattened_without_flips_and_within_the_bounds(prepared, icub):
    maps = [prepared(part).flat for part in icub.parts]
    strain = [100 * chart.distortion.edge_rms for flat in maps for chart in flat.charts]
    assert len(strain) == 23
    assert sum(flat.flips for flat in maps) == 0
    assert np.median(strain) <= 0.5
    assert max(strain) <= 1.4
    assert not any(chart.fallback for flat in maps for chart in flat.charts)
    for flat in maps:
        assert np.isfinite(flat.uv).all()


def test_hole_of_the_torso_stays_open(prepared):
    (chart,) = prepared("torso").flat.charts
    assert chart.holes == 1
    assert len(boundary_loops(chart.faces)) == 2


def test_packed_charts_keep_their_size(prepared):
    flat = prepared("left_arm").flat
    for chart in flat.charts:
        packed = flat.uv[chart.taxels]
        shift = packed - chart.uv
        assert_allclose(shift, np.broadcast_to(shift[0], shift.shape), atol=1e-12)


def test_pack_places_every_chart_once(rng):
    charts = [rng.uniform(size=(5, 2)) * size for size in (1.0, 0.2, 0.4, 0.3)]
    placed = pack(charts, 0.1)
    for before, after in zip(charts, placed, strict=True):
        assert_allclose(np.ptp(before, axis=0), np.ptp(after, axis=0), rtol=1e-12)


def test_flatten_disc_falls_back_and_says_so(half_cylinder, monkeypatch):
    vertices, faces = half_cylinder
    monkeypatch.setitem(flatteners._own, "bad", lambda v, f, loop: v[:, :2] * [-1, 1])
    with pytest.warns(SkinWarning, match="bad flips or fails, bff is used"):
        _, used, _ = flatten_disc(vertices, faces, method="bad")
    assert used == "bff"


def test_flatten_disc_refuses_closed_tubes_and_flat_triangles(sphere, half_cylinder, square_grid):
    with pytest.raises(FlatteningError, match="closed"):
        flatten_disc(*sphere)
    _, faces = square_grid(12)
    angle = 2 * np.pi * (np.arange(144) % 12) / 12
    tube = np.column_stack([np.cos(angle), np.sin(angle), np.arange(144) // 12])
    seam = [[12 * i + 11, 12 * i, 12 * i + 23] for i in range(11)]
    seam += [[12 * i, 12 * i + 12, 12 * i + 23] for i in range(11)]
    with pytest.raises(FlatteningError, match="tube or has a wide hole"):
        flatten_disc(tube, np.concatenate([faces, seam]))
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    with pytest.raises(FlatteningError, match="without area"):
        flatten_disc(flat, np.array([[0, 1, 2]]))


def test_flatten_disc_refuses_reversed_faces(square_grid):
    vertices, faces = square_grid(3)
    faces = faces.copy()
    faces[0] = faces[0][::-1]
    with pytest.raises(InvalidMeshError, match="opposite ways"):
        flatten_disc(vertices, faces)


def test_flatten_names_the_methods(prepared):
    with pytest.raises(
        UnknownNameError,
        match="no flattening method 'best'; the flattening methods are: tutte, harmonic",
    ):
        flatten(prepared("left_hand").mesh, method="best")


def test_flatten_mesh_takes_every_component_of_a_soup(square_grid, sphere):
    from skinmap.flat.mesh_charts import flatten_mesh

    grid, faces = square_grid(6)
    ball, ball_faces = sphere
    # As a mesh file comes: every face with corners of its own, and a vertex that none uses.
    vertices = np.concatenate([grid[faces].reshape(-1, 3), ball[ball_faces].reshape(-1, 3) + 5.0])
    soup = np.arange(len(vertices)).reshape(-1, 3)
    vertices = np.concatenate([vertices, [[9.0, 9, 9]]])
    laid = flatten_mesh(vertices, soup)
    cut, flat = laid.charts  # the largest first
    assert (len(flat.taxels), flat.seam_length) == (36, 0.0)
    assert flat.distortion.edge_rms < 1e-7
    assert cut.distortion.flips == 0
    assert cut.seam_length > 0
    rows = laid.mesh.skin.channels[flat.taxels]
    assert face_areas(vertices[rows], flat.faces).sum() == pytest.approx(1.0)


def test_points_of_the_map_come_back_to_the_body(prepared, rng):
    flat = prepared("right_forearm").flat
    shown = np.isfinite(flat.uv[:, 0])
    back = flat.on_body(flat.uv[shown])
    np.testing.assert_allclose(back, flat.mesh.skin.positions[shown], atol=1e-9)
    chart = flat.charts[0]
    weights = rng.dirichlet([1, 1, 1], len(chart.faces))
    inside = np.einsum("mc,mcd->md", weights, chart.uv[chart.faces])
    planted = np.einsum("mc,mcd->md", weights, flat.mesh.vertices[chart.taxels[chart.faces]])
    np.testing.assert_allclose(flat.on_body(inside), planted, atol=1e-9)


def test_points_beside_the_map_are_nowhere_on_the_body(prepared):
    flat = prepared("right_forearm").flat
    assert np.isnan(flat.on_body([[9.0, 9.0]])).all()
    assert flat.on_body(np.zeros((0, 2))).shape == (0, 3)
    with pytest.raises(InvalidArrayError, match="points of the map"):
        flat.on_body([[np.nan, 0.0]])

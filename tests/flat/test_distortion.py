from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from skinmap.errors import InvalidArrayError
from skinmap.flat.distortion import edge_rms, measure_distortion, spread


def test_plane_to_itself_is_perfect(square_grid):
    vertices, faces = square_grid(6)
    d = measure_distortion(vertices, faces, vertices[:, :2])
    # Square roots of differences lose half of the digits: 1e-8 is rounding here.
    assert_allclose(d.quasi_conformal, 1.0, atol=1e-7)
    assert_allclose(d.area, 1.0, atol=1e-12)
    assert_allclose(d.symmetric_dirichlet, 4.0, atol=1e-12)
    assert_allclose(d.stretch, 1.0, atol=1e-12)
    assert_allclose(d.arap, 0.0, atol=1e-12)
    assert d.edge_rms < 1e-12
    assert d.area_sd < 1e-12
    assert d.flips == 0


def test_stretch_by_two_has_its_closed_form(square_grid):
    vertices, faces = square_grid(6)
    d = measure_distortion(vertices, faces, vertices[:, :2] * [2.0, 1.0])
    # At the global scale 1 / sqrt(2): sigma = sqrt(2) and 1 / sqrt(2).
    assert_allclose(d.quasi_conformal, 2.0, rtol=1e-9)
    assert_allclose(d.area, 1.0, rtol=1e-12)
    assert_allclose(d.symmetric_dirichlet, 5.0, rtol=1e-9)
    # sqrt((1/2 + 2) / 2), and (sqrt(2) - 1)^2 + (1/sqrt(2) - 1)^2.
    assert_allclose(d.stretch, np.sqrt(1.25), rtol=1e-9)
    assert_allclose(d.stretch_max, np.sqrt(2.0), rtol=1e-9)
    assert_allclose(d.arap, (2**0.5 - 1) ** 2 + (0.5**0.5 - 1) ** 2, rtol=1e-9)


def test_unrolled_cylinder_is_isometric_but_for_its_facets(half_cylinder, square_grid):
    vertices, faces = half_cylinder
    flat, _ = square_grid(15)
    d = measure_distortion(vertices, faces, flat[:, :2])
    # Chords of a bend of 3/14 rad are (3/14)^2 / 24 = 0.19 % short of the arc.
    assert d.edge_rms < 0.002
    assert d.quasi_conformal.max() < 1.002


def test_flips_are_counted_and_make_energies_infinite(square_grid):
    vertices, faces = square_grid(3)
    uv = vertices[:, :2].copy()
    uv[4] = [1.4, 1.4]  # the middle vertex pulled out of its ring
    d = measure_distortion(vertices, faces, uv)
    assert 0 < d.flips < len(faces)
    assert np.isinf(d.symmetric_dirichlet).sum() == d.flips
    assert np.isinf(d.stretch_max).sum() == d.flips
    assert d.area_sd == np.inf


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 1000),
    scale=st.floats(1e-6, 1e6),
    angle=st.floats(0, 6.28),
    shift=st.floats(-100, 100),
)
def test_distortion_does_not_depend_on_scale_place_turn_or_order(
    half_cylinder, seed, scale, angle, shift
):
    vertices, faces = half_cylinder
    rng = np.random.default_rng(seed)
    uv = vertices[:, :2] + rng.normal(scale=0.005, size=(len(vertices), 2))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    order = rng.permutation(len(vertices))
    place = np.argsort(order)
    one = measure_distortion(vertices, faces, uv)
    other = measure_distortion(
        scale * (vertices[order] + shift), place[faces], (uv[order] @ turn.T + shift) * scale
    )
    # The shift of 100 on coordinates of one leaves 14 digits; quotients near flips lose more.
    assert_allclose(other.edge_rms, one.edge_rms, rtol=1e-8)
    for name in PER_FACE:
        assert_allclose(getattr(other, name), getattr(one, name), rtol=1e-6, atol=1e-6)
    assert other.flips == one.flips
    same_numbers(asdict(other.summary()), asdict(one.summary()))


PER_FACE = ["quasi_conformal", "area", "symmetric_dirichlet", "stretch", "stretch_max", "arap"]


def same_numbers(one: dict, other: dict) -> None:
    """All numbers of two summaries, spreads included, but for rounding."""
    assert one.keys() == other.keys()
    for key, value in one.items():
        if isinstance(value, dict):
            same_numbers(value, other[key])
        else:
            assert_allclose(value, other[key], rtol=1e-6, atol=1e-6, err_msg=key)


def test_every_metric_has_mean_p95_and_max(half_cylinder, square_grid):
    vertices, faces = half_cylinder
    summary = asdict(measure_distortion(vertices, faces, square_grid(15)[0][:, :2]).summary())
    for name in ("quasi_conformal", "area", "symmetric_dirichlet", "stretch", "arap"):
        spread = summary[name]
        assert list(spread) == ["mean", "p95", "max"]
        assert spread["p95"] <= spread["max"]
    assert list(summary["edge_strain_percent"]) == ["mean", "p95", "max"]
    assert summary["stretch_l2"] <= summary["stretch_linf"]


def test_edge_rms_alone_is_that_of_the_distortion(half_cylinder, rng):
    vertices, faces = half_cylinder
    uv = vertices[:, :2] + rng.normal(scale=0.005, size=(len(vertices), 2))
    whole = measure_distortion(vertices, faces, uv).edge_rms
    assert edge_rms(vertices, faces, uv) == pytest.approx(whole, rel=1e-12)


def test_face_edge_strain_is_the_mean_of_its_edges(square_grid):
    vertices, faces = square_grid(3)
    uv = vertices[:, :2] * [1.3, 1.0]
    d = measure_distortion(vertices, faces, uv)
    by_edge = {
        tuple(edge): strain for edge, strain in zip(d.edges.tolist(), d.edge_strain, strict=True)
    }
    a, b, c = sorted(faces[0].tolist())
    expected = np.sqrt(np.mean([by_edge[pair] ** 2 for pair in ((a, b), (a, c), (b, c))]))
    assert d.face_edge_strain(faces)[0] == pytest.approx(expected, rel=1e-12)


def test_spread_weights_the_mean_and_the_percentile():
    values, weights = np.array([1.0, 2.0, 3.0]), np.array([0.0, 94.0, 6.0])
    assert asdict(spread(values, weights)) == {"mean": pytest.approx(2.06), "p95": 3.0, "max": 3.0}


def test_measure_distortion_refuses_nan(square_grid):
    vertices, faces = square_grid(3)
    uv = vertices[:, :2].copy()
    uv[2, 0] = np.nan
    with pytest.raises(InvalidArrayError, match="uv holds NaN or infinity, first in row 2"):
        measure_distortion(vertices, faces, uv)

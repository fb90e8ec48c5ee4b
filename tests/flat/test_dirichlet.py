from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinmap.flat import dirichlet as module
from skinmap.flat.dirichlet import (
    energy_and_gradient,
    largest_step,
    locally_injective_map,
    symmetric_dirichlet_descent,
)
from skinmap.flat.disc import Disc, uniform_on_circle
from skinmap.flat.methods import flatteners
from skinmap.geometry.topology import boundary_loops
from skinmap.geometry.triangles import signed_areas


def disc_of(vertices, faces) -> Disc:
    return Disc(vertices, faces, boundary_loops(faces)[0])


@pytest.fixture
def saddle(square_grid) -> Disc:
    vertices, faces = square_grid(30)
    x, y = 2 * vertices[:, 0] - 1, 2 * vertices[:, 1] - 1
    return disc_of(np.column_stack([x, y, x * y]), faces)


@pytest.fixture
def cap(sphere):
    """A function: the part of a ball above a height."""

    def make(height: float) -> Disc:
        vertices, faces = sphere
        kept = faces[(vertices[faces][:, :, 2] > height).all(axis=1)]
        used, compact = np.unique(kept, return_inverse=True)
        return disc_of(vertices[used], compact.reshape(-1, 3))

    return make


def test_energy_of_a_stretch_has_its_closed_form(square_grid):
    vertices, faces = square_grid(4)
    disc = disc_of(vertices, faces)
    energy, _ = energy_and_gradient(disc, vertices[:, :2] * [2.0, 0.5])
    # sigma 2 and 1/2 on an area of 1: 4 + 1/4 and their inverses.
    assert energy == pytest.approx(2 * (4 + 0.25), rel=1e-12)


def test_gradient_is_the_slope_of_the_energy(saddle, rng):
    uv, direction = saddle.conformal, rng.normal(size=saddle.conformal.shape)
    direction *= 1e-2 * largest_step(uv, direction, saddle.faces)
    _, gradient = energy_and_gradient(saddle, uv)
    h = 1e-4
    ahead, _ = energy_and_gradient(saddle, uv + h * direction)
    behind, _ = energy_and_gradient(saddle, uv - h * direction)
    slope = (ahead - behind) / (2 * h)
    # Central differences: an error of h^2, and rounding of the energy over h.
    assert slope == pytest.approx(float(np.vdot(gradient, direction)), rel=1e-5)


def test_energy_of_a_flipped_map_is_infinite(saddle):
    energy, _ = energy_and_gradient(saddle, saddle.conformal * [-1.0, 1.0])
    assert energy == np.inf


def test_largest_step_stops_at_the_first_flip(saddle, rng):
    uv = saddle.conformal
    direction = rng.normal(size=uv.shape)
    step = largest_step(uv, direction, saddle.faces)
    assert (signed_areas(uv + 0.999999 * step * direction, saddle.faces) > 0).all()
    assert (signed_areas(uv + 1.000001 * step * direction, saddle.faces) < 0).any()


def test_largest_step_of_a_turn_or_a_shift_is_unlimited():
    uv, faces = np.array([[0.0, 0], [1, 0], [0, 1]]), np.array([[0, 1, 2]])
    assert largest_step(uv, np.ones((3, 2)), faces) == np.inf
    turn = uv @ np.array([[0.0, 1], [-1, 0]])
    assert largest_step(uv, turn, faces) == np.inf
    # Shrinking to a point takes one whole step.
    assert largest_step(uv, -uv, faces) == pytest.approx(1.0)


def test_every_step_lowers_the_energy_and_flips_nothing(cap, monkeypatch):
    disc, energies = cap(-0.8), []
    search = module._line_search

    def watched(disc, *rest):
        result = search(disc, *rest)
        if result is not None:
            energies.append(result[1])
            assert disc.is_injective(result[0])
        return result

    monkeypatch.setattr(module, "_line_search", watched)
    start = uniform_on_circle(disc)
    symmetric_dirichlet_descent(disc, start)
    assert len(energies) > 5
    assert (np.diff([energy_and_gradient(disc, start)[0], *energies]) < 0).all()


def test_descent_needs_as_many_steps_on_a_fine_mesh_as_on_a_coarse_one(square_grid, monkeypatch):
    steps = []
    for n in (12, 48):
        vertices, faces = square_grid(n)
        x, y = 2 * vertices[:, 0] - 1, 2 * vertices[:, 1] - 1
        disc = disc_of(np.column_stack([x, y, x * y]), faces)
        count = []
        search = module._line_search
        monkeypatch.setattr(module, "_line_search", lambda *a: count.append(1) or search(*a))  # noqa: B023
        symmetric_dirichlet_descent(disc, disc.conformal)
        monkeypatch.setattr(module, "_line_search", search)
        steps.append(len(count))
    assert abs(steps[0] - steps[1]) <= 3


@pytest.mark.parametrize("height", [0.3, 0.0, -0.5])
def test_dirichlet_reaches_what_slim_reaches(cap, height):
    disc = cap(height)
    ours = energy_and_gradient(disc, locally_injective_map(disc))[0]
    uv = flatteners.get("slim")(disc.vertices, disc.faces, disc.loop)
    theirs = energy_and_gradient(disc, uv)[0]
    # Two independent descents on one energy: ours stops where a step gains 1e-5 of the excess.
    excess = theirs - 4.0 * disc.areas.sum()
    assert ours <= theirs + 1e-3 * excess


def test_start_does_not_matter_where_it_is_wild(cap):
    disc = cap(-0.9)
    one = locally_injective_map(disc)
    other = symmetric_dirichlet_descent(disc, uniform_on_circle(disc))
    area = disc.areas.sum()
    # A ball with a small opening: BFF's energy is far above, both ends lie in the same valley.
    assert energy_and_gradient(disc, one)[0] / area < 7.0
    assert_allclose(
        energy_and_gradient(disc, one)[0], energy_and_gradient(disc, other)[0], rtol=0.01
    )


def test_dirichlet_starts_convex_where_the_conformal_map_flips(saddle):
    saddle.__dict__["conformal"] = saddle.conformal * [-1.0, 1.0]
    uv = locally_injective_map(saddle)
    del saddle.__dict__["conformal"]
    assert saddle.is_injective(uv)
    reached = energy_and_gradient(saddle, uv)[0]
    assert reached == pytest.approx(
        energy_and_gradient(saddle, locally_injective_map(saddle))[0], rel=1e-4
    )

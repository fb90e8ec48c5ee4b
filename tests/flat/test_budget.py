from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, SkinWarning
from skinmap.flat import methods
from skinmap.flat.disc import Disc
from skinmap.flat.distortion import edge_rms
from skinmap.flat.flat_map import flatten
from skinmap.flat.methods import map_disc, predicted_seconds, within_budget
from skinmap.geometry.topology import boundary_loops


@pytest.fixture
def cap(sphere) -> Disc:
    """A bit more than half of a ball: 20 % edge error by BFF, 13 by ARAP."""
    vertices, faces = sphere
    kept = faces[(vertices[faces][:, :, 2] > -0.1).all(axis=1)]
    used, compact = np.unique(kept, return_inverse=True)
    disc = compact.reshape(-1, 3)
    return Disc(vertices[used], disc, boundary_loops(disc)[0])


def test_an_easy_bound_of_error_takes_the_cheapest_method(cap):
    choice = within_budget(cap, max_edge_rms=0.9)
    assert (choice.method, choice.met) == ("fast", True)
    assert choice.reason.endswith("tried fast")


def test_a_tighter_bound_of_error_goes_on_until_it_is_met(cap):
    conformal = edge_rms(cap.vertices, cap.faces, cap.conformal)
    choice = within_budget(cap, max_edge_rms=0.99 * conformal)
    assert (choice.method, choice.met) == ("balanced", True)
    assert edge_rms(cap.vertices, cap.faces, choice.uv) <= 0.99 * conformal


def test_a_bound_of_error_that_none_meets_gives_the_nearest(cap):
    choice = within_budget(cap, max_edge_rms=1e-6)
    assert not choice.met
    assert choice.reason.endswith("tried fast, balanced, dirichlet")
    others = [cap.conformal, methods.rigid_map(cap), methods.locally_injective_map(cap)]
    best = min(edge_rms(cap.vertices, cap.faces, uv) for uv in others)
    assert edge_rms(cap.vertices, cap.faces, choice.uv) == best


def test_time_decides_how_dear_a_method_may_be(cap, monkeypatch):
    clock = iter(np.arange(0.0, 100.0, 1.0))  # every look at the clock, a second has passed
    monkeypatch.setattr(methods.time, "process_time", lambda: float(next(clock)))
    prices = {"fast": 1.0, "balanced": 3.0, "dirichlet": 10.0}
    monkeypatch.setattr(methods, "predicted_seconds", lambda method, n: prices[method])
    taken = {}
    for limit in (2.0, 8.0, 40.0):
        taken[limit] = within_budget(cap, max_seconds=limit).method
    assert taken == {2.0: "fast", 8.0: "balanced", 40.0: "dirichlet"}


def test_a_slow_machine_is_noticed(cap, monkeypatch):
    prices = {"fast": 1e-9, "balanced": 1.0, "dirichlet": 2.0}
    monkeypatch.setattr(methods, "predicted_seconds", lambda method, n: prices[method])
    # `fast` took a million times what it should: so will the others.
    assert within_budget(cap, max_seconds=100.0).method == "fast"


def test_no_budget_takes_the_accurate_method_where_it_is_cheap(cap, monkeypatch):
    monkeypatch.setattr(methods, "predicted_seconds", lambda method, n: 1e9)
    monkeypatch.setattr(methods, "CHEAP", float("inf"))
    assert within_budget(cap).method == "dirichlet"
    monkeypatch.setattr(methods, "CHEAP", 0.0)
    assert within_budget(cap).method == "balanced"


def test_predicted_seconds_grow_with_size_and_with_accuracy():
    for n in (10, 1000, 100_000, 1_000_000):
        assert 0 < predicted_seconds("balanced", n) <= predicted_seconds("dirichlet", n)
    assert predicted_seconds("fast", 1_000_000) > 10 * predicted_seconds("fast", 100_000)


def test_flatten_keeps_a_budget_for_all_patches_and_says_why(prepared):
    flat = flatten(prepared("left_arm").mesh, method="auto", max_edge_rms=2.0, max_seconds=30)
    assert len(flat.charts) == 4
    for chart in flat.charts:
        assert chart.distortion.edge_rms <= 0.02
        assert not chart.fallback
        assert chart.method in ("fast", "balanced", "dirichlet")
        assert "edge rms" in chart.reason
        assert " s of " in chart.reason


def test_a_budget_that_cannot_be_met_is_said(cap):
    with pytest.warns(SkinWarning, match=r"no method keeps to the budget; \w+ comes nearest"):
        flat = map_disc(cap.vertices, cap.faces, method="auto", max_edge_rms=1e-6)
    assert not flat.fallback
    with pytest.warns(SkinWarning, match="no method keeps to the budget; fast comes nearest"):
        map_disc(cap.vertices, cap.faces, method="auto", max_seconds=1e-9)


@pytest.mark.parametrize("name", ["max_seconds", "max_edge_rms"])
def test_budgets_are_refused_where_nothing_follows_them(prepared, name):
    mesh = prepared("left_hand").mesh
    with pytest.raises(InvalidArrayError, match=f"{name} needs method 'auto', got 'balanced'"):
        flatten(mesh, **{name: 1.0})
    for value in (0.0, -1.0, float("nan")):
        with pytest.raises(InvalidArrayError, match=f"{name} must be above 0"):
            flatten(mesh, method="auto", **{name: value})


def test_auto_falls_back_where_nothing_can_be_solved(cap, monkeypatch):
    def singular(disc):
        raise ArithmeticError("the matrix of 3 unknowns is singular")

    monkeypatch.setattr("skinmap.flat.disc.boundary_first", singular)
    with pytest.warns(SkinWarning, match="auto flips or fails, bijective is used"):
        flat = map_disc(cap.vertices, cap.faces, method="auto")
    assert (flat.method, flat.fallback) == ("bijective", True)

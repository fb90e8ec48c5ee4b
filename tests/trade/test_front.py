"""The Pareto front and recommendations: laws, and a planted front."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinmap.errors import ImpossibleBudgetError
from skinmap.trade.front import Budget, excess, pareto, recommend
from skinmap.trade.points import Point

FIGURES = st.lists(
    st.tuples(st.sampled_from([1, 2, 3, 5, 8]), st.sampled_from([0, 1, 2, 4, 7])), min_size=1
)
# name: (seconds, error); time x error is 8, 10, 50 and 80, so the knee is the first of them.
PLANTED = {"low": (1.0, 8.0), "middle": (10.0, 1.0), "high": (100.0, 0.5), "silly": (20.0, 4.0)}


def point(seconds: float, error: float, name: str = "x") -> Point:
    return Point("toy", {"level": name}, seconds, error, "mm")


def planted() -> list[Point]:
    return [point(seconds, error, name) for name, (seconds, error) in PLANTED.items()]


def dominates(one: Point, other: Point) -> bool:
    return (
        one.seconds <= other.seconds
        and one.error <= other.error
        and (one.seconds, one.error) != (other.seconds, other.error)
    )


def test_the_planted_front_is_found():
    assert pareto(planted()) == [True, True, True, False]


@given(FIGURES)
def test_no_point_on_the_front_is_dominated_and_every_other_by_one_on_it(figures):
    points = [point(*pair) for pair in figures]
    front = [one for one, on in zip(points, pareto(points), strict=True) if on]
    rest = [one for one, on in zip(points, pareto(points), strict=True) if not on]
    assert front
    assert not any(dominates(other, one) for one in front for other in points)
    assert all(any(dominates(other, one) for other in front) for one in rest)


@given(FIGURES, st.floats(0.5, 10), st.floats(0.0, 8.0), st.integers(0, 3))
def test_a_recommendation_keeps_its_budget_and_none_that_keeps_it_is_better(figures, s, e, which):
    points = [point(*pair) for pair in figures]
    budget = Budget(s if which & 1 else None, e if which & 2 else None)
    fitting = [one for one in points if excess(one, budget) <= 0]
    if not fitting:
        with pytest.raises(ImpossibleBudgetError):
            recommend(points, budget)
        return
    chosen = recommend(points, budget)
    assert chosen in fitting
    # Nothing that keeps the budget is better in both, whatever was asked for.
    assert not any(dominates(other, chosen) for other in fitting)


@pytest.mark.parametrize(
    ("budget", "name"),
    [
        (Budget(), "low"),
        (Budget(seconds=20.0), "middle"),
        (Budget(seconds=1000.0), "high"),
        (Budget(error=1.5), "middle"),
        (Budget(error=100.0), "low"),
        (Budget(seconds=50.0, error=4.0), "middle"),
    ],
)
def test_budgets_choose_the_planted_setting(budget, name):
    assert recommend(planted(), budget).setting["level"] == name


def test_the_knee_is_where_twice_the_time_no_longer_halves_the_error():
    steep = [point(1, 80), point(2, 30), point(4, 10), point(8, 9), point(16, 8.9)]
    assert recommend(steep, Budget()).seconds == 4


def test_a_perfect_setting_is_the_knee_unless_it_costs_a_hundred_times_as_much():
    # An error of 0 counts as 1 % of the largest.
    assert recommend([point(1, 8), point(50, 0)], Budget()).seconds == 50
    assert recommend([point(1, 8), point(200, 0)], Budget()).seconds == 1
    assert recommend([point(3, 0), point(2, 0)], Budget()).seconds == 2


@pytest.mark.parametrize(
    ("budget", "message"),
    [
        (Budget(seconds=0.5), "no setting keeps to 500 ms; the nearest is level=low with 1e"),
        (Budget(error=0.1), "keeps to 0.1 mm; the nearest is level=high with 1e"),
        (
            Budget(seconds=2.0, error=0.9),
            "keeps to 2e.* ms and 0.9 mm; the nearest is level=middle",
        ),
        (Budget(error=0.0), "keeps to 0 mm; the nearest is level=high"),
    ],
)
def test_an_impossible_budget_names_the_nearest_setting(budget, message):
    with pytest.raises(ImpossibleBudgetError, match=message):
        recommend(planted(), budget)

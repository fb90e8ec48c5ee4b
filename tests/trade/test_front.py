"""The Pareto front and recommendations: laws, and a planted front."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinmap.errors import ImpossibleBudgetError
from skinmap.trade import Point
from skinmap.trade.measuring import SAMPLE, pareto, recommend

FIGURES = st.lists(
    st.tuples(st.sampled_from([1, 2, 3, 5, 8]), st.sampled_from([0, 1, 2, 4, 7])), min_size=1
)
# name: (seconds, error)
PLANTED = {"low": (1.0, 8.0), "middle": (10.0, 1.0), "high": (100.0, 0.5), "silly": (20.0, 4.0)}


def point(seconds: float, error: float, name: str = "x", **more) -> Point:
    return Point(
        task="toy", setting={"level": name}, seconds=seconds, error=error, unit="mm", **more
    )


def chosen(points: list[Point], seconds: float | None = None, default: str = "") -> Point:
    return recommend(points, {"level": default}, seconds)[0]


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


@given(FIGURES, st.floats(0.5, 10))
def test_a_recommendation_keeps_its_limit_and_none_that_keeps_it_is_better(figures, seconds):
    points = [point(*pair) for pair in figures]
    fitting = [one for one in points if one.seconds <= seconds]
    if not fitting:
        with pytest.raises(ImpossibleBudgetError):
            chosen(points, seconds)
        return
    found = chosen(points, seconds)
    assert found in fitting
    assert not any(dominates(other, found) for other in fitting)


@given(FIGURES, st.integers(0, 100), st.sampled_from([1e-3, 1e-2, 1.0]))
def test_without_a_limit_nothing_is_recommended_that_is_worse_than_the_default(
    figures, which, scale
):
    points = [
        point(scale * seconds, error, f"{number}")
        for number, (seconds, error) in enumerate(figures)
    ]
    default = points[which % len(points)]
    found = chosen(points, default=default.setting["level"])
    assert found.error <= default.error
    assert found.seconds <= max(SAMPLE, default.seconds)
    assert found is default or found.error < default.error


@pytest.mark.parametrize(("seconds", "name"), [(20.0, "middle"), (1000.0, "high"), (1.0, "low")])
def test_limits_choose_the_planted_setting(seconds, name):
    assert chosen(planted(), seconds).setting["level"] == name


@pytest.mark.parametrize(
    ("default", "name", "why"),
    [
        # 0.1, 1, 10 and 2 ms: all within one sample of a stream.
        (1e-4, "high", "least error within one sample of a stream (20 ms)"),
        # 1, 10, 100 and 20 ms.
        (1e-3, "middle", "least error within one sample of a stream (20 ms)"),
        # 10, 100, 1000 and 200 ms.
        (1e-2, "low", "the default: no other setting errs less for sure within one sample"),
        # 0.1, 1, 10 and 2 s.
        (1e-1, "low", "the default: no other setting errs less for sure within the time of the"),
    ],
)
def test_the_least_error_that_fits_the_time_there_is_is_recommended(default, name, why):
    points = [point(default * seconds, error, level) for level, (seconds, error) in PLANTED.items()]
    found, words = recommend(points, {"level": "low"})
    assert found.setting == {"level": name}
    assert words.startswith(why)


def test_a_quarter_of_the_time_does_not_pay_for_twenty_percent_more_errors():
    # What naming a touch costs on the right forearm of the iCub.
    quick, usual = point(1.1e-4, 32.0, "histogram"), point(2.98e-4, 12.0, "contact-geometry")
    assert chosen([quick, usual], default="contact-geometry") is usual
    # It is asked for by a limit alone.
    assert chosen([quick, usual], 2e-4, "contact-geometry") is quick


def test_a_difference_that_the_seeds_explain_leaves_the_default():
    usual = point(1e-3, 12.0, "usual", error_spread=2.0, runs=3)
    for error, spread, better in ((11.0, 2.0, False), (9.0, 2.0, True), (11.9, 0.0, False)):
        other = point(2e-3, error, "other", error_spread=spread, runs=3)
        assert (chosen([usual, other], default="usual") is other) == better
    # One that is surely better wins over one that may be lucky.
    lucky = point(2e-3, 8.0, "lucky", error_spread=9.0, runs=3)
    sure = point(2e-3, 9.0, "sure", error_spread=1.0, runs=3)
    assert chosen([usual, lucky, sure], default="usual") is sure


def test_a_difference_that_nobody_would_notice_leaves_the_default():
    # One iteration instead of five on the right forearm of the iCub; nothing is drawn by chance.
    usual, other = point(0.0166, 0.865, "usual"), point(0.0166, 0.864, "one")
    assert chosen([usual, other], default="usual") is usual
    assert chosen([usual, point(0.0166, 0.85, "better")], default="usual") is not usual


def test_a_default_that_was_not_measured_leaves_the_time_of_the_fastest():
    points = [point(3.0, 8.0), point(4.0, 1.0)]
    found, why = recommend(points, {"level": "gone"})
    assert found is points[0]
    assert why == "least error within the time of the fastest (3e+03 ms)"


def test_an_impossible_limit_names_the_nearest_setting():
    message = "no setting keeps to 500 ms; the nearest is level=low with 1e"
    with pytest.raises(ImpossibleBudgetError, match=message):
        chosen(planted(), 0.5)

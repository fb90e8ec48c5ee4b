"""Measuring: rounds, warm-up, spread, failures; time and memory of known work."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from skinmap.errors import ImpossibleBudgetError
from skinmap.trade import measuring, runner
from skinmap.trade.measuring import cpu_seconds, first_time, grown_mb, untimed
from skinmap.trade.runner import measure, pace_seconds, steps
from skinmap.trade.task import Knob, Outcome, around, product

SEEDS = range(3)


@pytest.mark.usefixtures("unwatched")
def test_planted_figures_come_out_with_their_spread(toys):
    found = measure(toys["planted"](), None, ("part",), seeds=SEEDS)
    assert not found.failures
    by_level = {point.setting["level"]: point for point in found.points}
    for level, (seconds, error) in toys["planted"].figures.items():
        point = by_level[level]
        assert point.seconds == pytest.approx(seconds)  # the pace never changed
        assert point.seconds_spread == pytest.approx(0.0, abs=1e-12)
        assert point.error == pytest.approx(1.1 * error)  # the mean of 1, 1.1 and 1.2
        # Over seeds, however often each ran.
        assert point.error_spread == pytest.approx(np.std([1.0, 1.1, 1.2], ddof=1) * error)
        assert (point.unit, point.memory_mb, point.beside) == ("mm", 1.0, {"extra": 7.0})


@pytest.mark.usefixtures("unwatched")
def test_a_round_a_seed_with_settings_in_an_order_drawn_anew(toys, monkeypatch):
    monkeypatch.setattr(runner, "QUICK", -1.0)
    task = toys["planted"]()
    found = measure(task, None, ("part",), seeds=range(5))
    levels = list(toys["planted"].figures)
    assert task.calls[0] == (levels[0], 0)  # loads what all need
    rounds = np.array(task.calls[1:]).reshape(5, len(levels), 2)
    assert rounds[0, :, 0].tolist() == levels
    for seed, turn in enumerate(rounds):
        assert set(turn[:, 1]) == {str(seed)}
        assert sorted(turn[:, 0]) == sorted(levels)
    assert len({tuple(turn[:, 0]) for turn in rounds}) > 1
    assert {point.runs for point in found.points} == {5}


@pytest.mark.usefixtures("unwatched")
def test_quick_settings_run_several_times_a_round_and_not_in_a_row(toys, monkeypatch):
    monkeypatch.setattr(runner, "QUICK", np.inf)
    task = toys["planted"]()
    found = measure(task, None, ("part",), seeds=SEEDS)
    assert {point.runs for point in found.points} == {runner.QUICK_TURNS * len(SEEDS)}
    for seed in SEEDS:
        turn = [level for level, number in task.calls if number == seed]
        # Were it done setting after setting, equal ones would stand together.
        apart = sum(one != other for one, other in itertools.pairwise(turn))
        assert apart >= len(toys["planted"].figures)


@pytest.mark.usefixtures("unwatched")
def test_the_chosen_setting_runs_more_often_until_it_stays_the_one(toys, monkeypatch):
    monkeypatch.setattr(runner, "QUICK", -1.0)
    task = toys["planted"]()
    turns: list[str] = []

    def choose(points):
        turns.append("low" if len(turns) == 0 else "high")  # another one turns out best
        return next(point for point in points if point.setting["level"] == turns[-1])

    found = measure(task, None, ("part",), seeds=SEEDS, choose=choose)
    runs = {point.setting["level"]: point.runs for point in found.points}
    assert turns == ["low", "high", "high"]
    assert runs == {"low": 12, "middle": 3, "high": 12, "silly": 3}
    # Each seed as often as the others, or the figures would lean to one.
    extra = task.calls[1 + 3 * len(task.figures) :]
    assert [seed for _, seed in extra] == [0, 1, 2] * 6


@pytest.mark.usefixtures("unwatched")
def test_nothing_to_choose_is_no_failure(toys):
    def choose(points):
        raise ImpossibleBudgetError("nothing keeps it")

    found = measure(toys["planted"](), None, ("part",), seeds=SEEDS, choose=choose)
    assert len(found.points) == 4
    assert not found.failures
    assert not measure(toys["empty"](), None, ("p",), seeds=SEEDS, choose=choose).points


def test_what_all_settings_load_is_no_memory_of_the_first(toys):
    kept = []

    class Loading(toys["planted"]):
        def run(self, prepared, setting, *, seed):
            if not kept:
                kept.append(np.ones((64, 2**17)))  # 64 MB, as a library would
            seconds, error = self.figures[setting["level"]]
            return Outcome(seconds, error)

    points = measure(Loading(), None, ("part",), seeds=[0]).points
    assert all(point.memory_mb < 32.0 for point in points)


@pytest.mark.usefixtures("unwatched")
def test_times_are_scaled_to_the_quietest_moment(toys, monkeypatch):
    paces = iter(np.tile([1e-3, 1e-3, 2e-3, 2e-3], 100).tolist())
    monkeypatch.setattr(runner, "pace_seconds", lambda: next(paces))
    [point] = measure(
        toys["planted"](), None, ("part",), seeds=[0], settings=[{"level": "high"}]
    ).points
    seconds = toys["planted"].figures["high"][0]
    assert point.pace == 1e-3
    # Of runs at once and at twice the usual cost of the fixed work, scaled alike.
    assert 0.5 * seconds <= point.seconds <= seconds


@pytest.mark.usefixtures("unwatched")
def test_a_failing_setting_is_reported_and_the_others_are_measured(toys):
    found = measure(toys["failing"](), None, ("part",), seeds=SEEDS)
    assert [point.setting["level"] for point in found.points] == ["low", "middle"]
    reasons = {one.setting["level"]: one.reason for one in found.failures}
    assert reasons == {"high": "no triangle to stand on", "silly": "ZeroDivisionError: by nought"}


@pytest.mark.usefixtures("unwatched")
@pytest.mark.parametrize(
    ("task", "reason"),
    [
        ("broken", "RuntimeError: nothing to prepare"),
        ("empty", "seconds must be a number from 0, the task gave nan"),
    ],
)
def test_a_task_that_cannot_be_measured_is_reported(toys, task, reason):
    found = measure(toys[task](), None, ("part",), seeds=SEEDS)
    assert not found.points
    assert {one.reason for one in found.failures} == {reason}


@pytest.mark.usefixtures("unwatched")
def test_an_unknown_knob_is_named(toys):
    found = measure(toys["planted"](), None, ("part",), seeds=SEEDS, settings=[{"depth": 3}])
    assert (
        "no knob of task 'planted' 'depth'; the knobs are: level, rounds"
        in found.failures[0].reason
    )


def test_an_interruption_is_no_failure_of_a_setting(toys):
    class Interrupted(toys["planted"]):
        def run(self, prepared, setting, *, seed):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(Interrupted(), None, ("part",), seeds=SEEDS)


@pytest.mark.usefixtures("unwatched")
def test_progress_is_reported_as_often_as_announced(toys):
    said: list[str] = []
    measure(toys["planted"](), None, ("part",), seeds=SEEDS, progress=said.append)
    assert len(said) == steps(len(toys["planted"].figures), len(SEEDS))
    assert said[0] == "planted: level=low"


def clock_of(monkeypatch, times: list[float]) -> None:
    """CPU times of the calls that follow."""
    ticks = iter([tick for time in times for tick in (0.0, time)])
    monkeypatch.setattr(measuring.time, "process_time", lambda: next(ticks))


def test_cpu_seconds_warms_up_once_and_takes_the_least(monkeypatch):
    clock_of(monkeypatch, [0.1, 0.04, 0.08, 0.05])
    calls: list[int] = []
    seconds, result = cpu_seconds(lambda: calls.append(1) or len(calls))
    assert seconds == 0.04
    assert result == len(calls) == 1 + measuring.CALLS


def test_slow_and_untimed_work_is_called_once_and_slow_work_twice_at_first(monkeypatch):
    clock_of(monkeypatch, [3.0, 0.001, 3.0, 2.0])
    calls: list[int] = []
    assert cpu_seconds(lambda: calls.append(1))[0] == 3.0
    with untimed():
        cpu_seconds(lambda: calls.append(1))
    assert len(calls) == 2
    with first_time():
        assert cpu_seconds(lambda: calls.append(1))[0] == 2.0
    assert len(calls) == 4


def test_grown_mb_sees_an_array_of_known_size():
    grown, shape = grown_mb(lambda: np.ones((64, 2**17)).shape)  # 64 MB, gone when it returns
    assert shape == (64, 2**17)
    assert 60.0 < grown < 90.0  # pages, and what else grew meanwhile


def test_the_traced_way_agrees(monkeypatch):
    monkeypatch.setattr(measuring, "_reset_peak", lambda: False)
    grown, _ = grown_mb(lambda: np.ones((64, 2**17)).shape)
    assert 63.9 < grown < 66.0


def test_the_fixed_piece_of_work_takes_time():
    assert 0.0 < pace_seconds() < 10.0


def test_around_and_product_name_each_combination_once():
    knobs = (Knob("a", (1, 2, 3), 2, ""), Knob("b", ("x", "y"), "x", ""))
    assert around(knobs) == [
        {"a": 2, "b": "x"},
        {"a": 1, "b": "x"},
        {"a": 3, "b": "x"},
        {"a": 2, "b": "y"},
    ]
    assert len({tuple(one.items()) for one in product(knobs)}) == 6

"""Measuring: rounds, warm-up, spread, failures; time and memory of known work."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.trade import measuring, runner
from skinmap.trade.measuring import cpu_seconds, grown_mb, untimed
from skinmap.trade.pace import pace_seconds
from skinmap.trade.runner import measure, steps
from skinmap.trade.task import Knob, around, product

SEEDS = range(3)


def test_planted_figures_come_out_with_their_spread(toys):
    found = measure(toys["planted"](), None, ("part",), seeds=SEEDS)
    assert not found.failures
    by_level = {point.setting["level"]: point for point in found.points}
    for level, (seconds, error) in toys["planted"].figures.items():
        point = by_level[level]
        assert point.seconds == pytest.approx(seconds)  # the pace never changed
        assert point.seconds_spread == pytest.approx(0.0, abs=1e-12)
        assert point.error == pytest.approx(1.1 * error)  # the mean of 1, 1.1 and 1.2
        assert point.error_spread > 0
        assert (point.unit, point.memory_mb, point.beside) == ("mm", 1.0, {"extra": 7.0})


def test_rounds_interleave_settings_after_one_to_warm_up(toys):
    task = toys["planted"]()
    measure(task, None, ("part",), seeds=SEEDS)
    size = len(toys["planted"].figures)
    assert sorted(level for level, _ in task.calls[:size]) == sorted(toys["planted"].figures)
    turns = np.array(task.calls[size:]).reshape(len(SEEDS), -1, 2)
    for seed, turn in zip(SEEDS, turns, strict=True):
        assert set(turn[:, 1]) == {str(seed)}
        levels, counts = np.unique(turn[:, 0], return_counts=True)
        assert len(levels) == size
        assert len(set(counts)) == 1
        # Were it done setting after setting, equal ones would stand together.
        assert (turn[1:, 0] != turn[:-1, 0]).sum() >= size
    assert len({tuple(turn[:, 0]) for turn in turns}) > 1


def test_the_first_run_of_dear_settings_counts(toys, monkeypatch):
    monkeypatch.setattr(runner, "DEAR", -1.0)
    monkeypatch.setattr(runner, "QUICK", -1.0)
    task = toys["planted"]()
    found = measure(task, None, ("part",), seeds=range(5))
    assert {point.runs for point in found.points} == {5}
    assert len(task.calls) == 5 * len(task.figures)


def test_times_are_scaled_to_the_quietest_moment(toys, monkeypatch):
    paces = iter(np.tile([1e-3, 1e-3, 2e-3, 2e-3], 100).tolist())
    monkeypatch.setattr(runner, "pace_seconds", lambda: next(paces))
    [point] = measure(
        toys["planted"](), None, ("part",), seeds=[0], settings=[{"level": "high"}]
    ).points
    seconds = toys["planted"].figures["high"][0]
    assert point.pace == 1e-3
    assert {0.5 * seconds, seconds} >= {point.seconds}


def test_a_failing_setting_is_reported_and_the_others_are_measured(toys):
    found = measure(toys["failing"](), None, ("part",), seeds=SEEDS)
    assert [point.setting["level"] for point in found.points] == ["low", "middle"]
    reasons = {one.setting["level"]: one.reason for one in found.failures}
    assert reasons == {"high": "no triangle to stand on", "silly": "ZeroDivisionError: by nought"}


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


def test_an_unknown_knob_is_named(toys):
    found = measure(toys["planted"](), None, ("part",), seeds=SEEDS, settings=[{"depth": 3}])
    assert "no knob of task 'planted' 'depth'; there is: level, rounds" in found.failures[0].reason


def test_an_interruption_is_no_failure_of_a_setting(toys):
    class Interrupted(toys["planted"]):
        def run(self, prepared, setting, *, seed):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(Interrupted(), None, ("part",), seeds=SEEDS)


def test_progress_is_reported_as_often_as_announced(toys):
    said: list[str] = []
    measure(toys["planted"](), None, ("part",), seeds=SEEDS, progress=said.append)
    assert len(said) == steps(len(toys["planted"].figures), len(SEEDS))
    assert said[0] == "planted: level=low"


def test_cpu_seconds_warms_up_once_and_takes_the_least(monkeypatch):
    clock = iter([0.0, 0.1, *np.cumsum([0.0, 0.1, 0, 0.04, 0, 0.08, 0, 0.05, 0, 0.06, 0, 0.07])])
    monkeypatch.setattr(measuring.time, "process_time", lambda: next(clock))
    calls: list[int] = []
    seconds, result = cpu_seconds(lambda: calls.append(1) or len(calls))
    assert seconds == pytest.approx(0.04)  # of 100, 40, 80, 50 and 60 ms
    assert result == len(calls) == 1 + measuring.CALLS


def test_slow_and_untimed_work_is_called_once(monkeypatch):
    clock = iter([0.0, 3.0, 0.0, 0.001])
    monkeypatch.setattr(measuring.time, "process_time", lambda: next(clock))
    calls: list[int] = []
    assert cpu_seconds(lambda: calls.append(1))[0] == 3.0
    with untimed():
        cpu_seconds(lambda: calls.append(1))
    assert len(calls) == 2


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

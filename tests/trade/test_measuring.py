"""Measuring: rounds in an order drawn anew, spread, failures, and the time of known work."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.trade import Outcome, cpu_seconds, measure, measuring

SEEDS = range(3)


def test_planted_figures_come_out_with_their_spread(toys):
    points, failed = measure(toys["planted"](), None, ("part",), seeds=SEEDS)
    assert not failed
    by_level = {point.setting["level"]: point for point in points}
    for level, (seconds, error) in toys["planted"].figures.items():
        point = by_level[level]
        assert point.seconds == seconds
        assert point.seconds_spread == pytest.approx(0.0, abs=1e-12)
        assert point.error == pytest.approx(1.1 * error)  # the mean of 1, 1.1 and 1.2
        assert point.error_spread == pytest.approx(np.std([1.0, 1.1, 1.2], ddof=1) * error)
        assert (point.unit, point.runs, point.beside) == ("mm", 3, {"extra": 7.0})


def test_one_seed_has_no_spread(toys):
    points, _ = measure(toys["planted"](), None, ("part",), seeds=[4])
    assert {(point.seconds_spread, point.error_spread) for point in points} == {(None, None)}


def test_a_round_a_seed_with_settings_in_an_order_drawn_anew(toys):
    task = toys["planted"]()
    measure(task, None, ("part",), seeds=range(5))
    levels = list(toys["planted"].figures)
    rounds = np.array(task.calls).reshape(5, len(levels), 2)
    for seed, turn in enumerate(rounds):
        assert set(turn[:, 1]) == {str(seed)}
        assert sorted(turn[:, 0]) == sorted(levels)
    assert len({tuple(turn[:, 0]) for turn in rounds}) > 1


def test_one_slow_moment_does_not_count(toys):
    class Slow(toys["planted"]):
        def run(self, prepared, setting, *, seed):
            seconds, error = self.figures[setting["level"]]
            return Outcome(seconds * (100.0 if seed == 1 else 1.0), error)

    points, _ = measure(Slow(), None, ("part",), seeds=SEEDS)
    assert [point.seconds for point in points] == [s for s, _ in Slow.figures.values()]


def test_a_failing_setting_is_reported_and_the_others_are_measured(toys):
    points, failed = measure(toys["failing"](), None, ("part",), seeds=SEEDS)
    assert [point.setting["level"] for point in points] == ["low", "middle"]
    reasons = {one.setting["level"]: one.reason for one in failed}
    assert reasons == {"high": "no triangle to stand on", "silly": "ZeroDivisionError: by nought"}


def test_a_task_that_cannot_be_measured_is_reported(toys):
    points, failed = measure(toys["broken"](), None, ("part",), seeds=SEEDS)
    assert not points
    assert {one.reason for one in failed} == {"RuntimeError: nothing to prepare"}


def test_an_interruption_is_no_failure_of_a_setting(toys):
    class Interrupted(toys["planted"]):
        def run(self, prepared, setting, *, seed):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(Interrupted(), None, ("part",), seeds=SEEDS)


def test_progress_is_reported_for_each_setting_of_each_round(toys):
    said: list[str] = []
    measure(toys["failing"](), None, ("part",), seeds=SEEDS, progress=said.append)
    assert len(said) == len(toys["failing"].figures) * len(SEEDS)
    assert set(said) == {f"failing: level={level}" for level in toys["failing"].figures}


def clock_of(monkeypatch, times: list[float]) -> None:
    """CPU times of the calls that follow."""
    ticks = iter([tick for time in times for tick in (0.0, time)])
    monkeypatch.setattr(measuring.time, "process_time", lambda: next(ticks))


def test_cpu_seconds_warms_up_once_and_takes_the_least(monkeypatch):
    clock_of(monkeypatch, [0.04, 0.08, 0.05])
    calls: list[int] = []
    seconds, result = cpu_seconds(lambda: calls.append(1) or len(calls))
    assert seconds == 0.04
    assert result == len(calls) == 1 + measuring.CALLS


def test_slow_work_is_warmed_up_and_timed_once(monkeypatch):
    clock_of(monkeypatch, [3.0])
    calls: list[int] = []
    assert cpu_seconds(lambda: calls.append(1))[0] == 3.0
    assert len(calls) == 2

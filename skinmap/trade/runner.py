"""Measuring a task: all settings once for each seed, interleaved, on one thread."""

from __future__ import annotations

import contextlib
import itertools
import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from skinmap.errors import BrokenPluginError, SkinError, UnknownNameError
from skinmap.trade.measuring import first_time, grown_mb, untimed
from skinmap.trade.points import Failure, Point, describe
from skinmap.trade.task import Outcome, Setting, TradeTask

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot
from functools import cache

QUICK = 0.3  # seconds: a setting whose run takes less is measured
QUICK_TURNS = 2  # times a round
RUNS = 12  # of the setting that is chosen, or
RUNS_SECONDS = 4.0  # of runs beyond its rounds
CHOICES = 3  # how often another one may turn out best after that
logger = logging.getLogger(__name__)
Progress = Callable[[str], None]
Choose = Callable[[Sequence[Point]], Point]
CALLS = 3
SIDE = 24  # of the grid whose Laplacian is factorised
WORDS = 4000  # counted one by one, as Python does


@dataclass(frozen=True, slots=True)
class Sample:
    """What one run gave, with which seed, and the pace of the machine round it."""

    outcome: Outcome
    seed: int
    pace: float


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """Result of one task."""

    points: list[Point] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)


def steps(settings: int, seeds: int) -> int:
    """How often progress is reported for a task."""
    return settings * seeds


def measure(
    task: TradeTask,
    robot: Robot,
    parts: tuple[str, ...],
    *,
    seeds: Sequence[int],
    settings: Sequence[Setting] | None = None,
    choose: Choose | None = None,
    progress: Progress | None = None,
) -> Measured:
    """Measure settings of a task.

    The first setting runs once untimed, so that what all settings load is not counted as the
    first one's memory. Then comes one round a seed. The first round has the settings in their
    order, each with an eye on memory; later ones in an order drawn anew, so that no setting
    always meets the machine in the same state. The setting that is chosen then runs more often:
    the quickest of many is often one that was lucky. A setting that fails is left out of later
    rounds and reported; so is a task that fails as a whole. Times are scaled to the pace of the
    machine at the quietest moment of the measurement (`skinmap.trade.runner`).

    Parameters
    ----------
    task : TradeTask
    robot : Robot
    parts : tuple of str
    seeds : sequence of int
        One repetition each.
    settings : sequence of mapping, optional
        Other ones than the task's own.
    choose : callable, optional
        Given the points, the one that matters; a `SkinError` says that there is none.
    progress : callable, optional
        Called `steps` times with what comes next.
    """
    from threadpoolctl import threadpool_limits

    report = progress or (lambda _: None)
    with threadpool_limits(1):
        try:
            chosen = [
                _ordered(task, setting)
                for setting in (task.settings() if settings is None else settings)
            ]
            rounds = _Rounds(task, chosen, report)
            kept = []
            for place, seed in enumerate(seeds):
                prepared = task.prepare(robot, parts, seed=seed)
                kept.append((seed, prepared))
                if place == 0:
                    rounds.load(prepared, seed)
                rounds.measure(prepared, seed, place)
            if choose is not None:
                rounds.confirm(kept, choose)
            return Measured(rounds.points(), list(rounds.failures.values()))
        except Exception as error:
            logger.info("task %s failed", task.name, exc_info=True)
            return Measured(failures=[Failure(task.name, None, reason(error))])


class _Rounds:
    """The measurement of one task: what was found so far."""

    def __init__(self, task: TradeTask, settings: Sequence[Setting], report: Progress) -> None:
        self.task, self.settings, self.report = task, settings, report
        self.found: list[list[Sample]] = [[] for _ in settings]
        self.memory = [float("nan")] * len(settings)
        self.cost = [0.0] * len(settings)  # CPU seconds of a run, training and all
        self.failures: dict[int, Failure] = {}

    def load(self, prepared: Any, seed: int) -> None:
        """Run the first setting that works, for what it loads; those that fail are met again."""
        for setting in self.settings:
            with untimed(), contextlib.suppress(Exception):
                self.task.run(prepared, setting, seed=seed)
                return

    def measure(self, prepared: Any, seed: int, place: int) -> None:
        """One round: every setting, quick ones several times."""
        numbers = list(range(len(self.settings)))
        told = set()
        if place == 0:
            for number in numbers:
                self._first(prepared, number, seed)
            turns, told = [], set(numbers)
        else:
            turns = list(numbers)
        quick = [number for number in numbers if self.cost[number] < QUICK]
        turns += quick * (QUICK_TURNS - 1)
        for number in np.random.default_rng([seed, place]).permutation(turns).tolist():
            if number not in told:
                told.add(number)
                self._say(number)
            self._attempt(prepared, number, seed)

    def confirm(self, kept: Sequence[tuple[int, Any]], choose: Choose) -> None:
        """Run the chosen setting more often, and what is chosen instead after that."""
        done: set[int] = set()
        while len(done) < CHOICES and len(self.failures) < len(self.settings):
            try:
                point = choose(self.points())
            except SkinError:  # no setting will do, which whoever chooses will say
                return
            number = self.settings.index(point.setting)
            if number in done:
                return
            done.add(number)
            self._repeat(number, kept)

    def _repeat(self, number: int, kept: Sequence[tuple[int, Any]]) -> None:
        started = time.process_time()
        for seed, prepared in itertools.cycle(kept):
            spent = time.process_time() - started
            if len(self.found[number]) >= RUNS or spent >= RUNS_SECONDS or number in self.failures:
                return
            self._attempt(prepared, number, seed)

    def _first(self, prepared: Any, number: int, seed: int) -> None:
        """Run a setting for the first time; notes its memory and what a run costs."""
        self._say(number)
        started = time.process_time()
        with first_time():
            self._attempt(prepared, number, seed, watch=True)
        self.cost[number] = time.process_time() - started

    def _say(self, number: int) -> None:
        self.report(f"{self.task.name}: {describe(self.settings[number])}")

    def _attempt(self, prepared: Any, number: int, seed: int, *, watch: bool = False) -> None:
        if number in self.failures:
            return
        setting = self.settings[number]

        def run() -> Outcome:
            return self.task.run(prepared, setting, seed=seed)

        try:
            before = pace_seconds()
            if watch:
                grown, outcome = grown_mb(run)
                self.memory[number] = grown if outcome.memory_mb is None else outcome.memory_mb
            else:
                outcome = run()
            _check(outcome)
            self.found[number].append(Sample(outcome, seed, 0.5 * (before + pace_seconds())))
        except Exception as error:  # the other settings still run
            logger.info("%s %s failed", self.task.name, describe(setting), exc_info=True)
            self.failures[number] = Failure(self.task.name, setting, reason(error))

    def points(self) -> list[Point]:
        """What was measured of the settings that never failed."""
        paces = [one.pace for samples in self.found for one in samples]
        return [
            _point(self.task, self.settings[number], samples, self.memory[number], min(paces))
            for number, samples in enumerate(self.found)
            if number not in self.failures
        ]


def _check(outcome: Outcome) -> None:
    """Refuse figures that mean nothing.

    Raises
    ------
    BrokenPluginError
    """
    for name in ("seconds", "error"):
        value = float(getattr(outcome, name))
        if not 0.0 <= value < np.inf:
            raise BrokenPluginError(f"{name} must be a number from 0, the task gave {value}")


def _ordered(task: TradeTask, setting: Setting) -> Setting:
    """The setting with its knobs in the order of the task's.

    Raises
    ------
    UnknownNameError
        A knob that the task does not name.
    """
    names = [knob.name for knob in task.knobs]
    for name in setting:
        if name not in names:
            raise UnknownNameError(f"knob of task {task.name!r}", name, names)
    return {name: setting[name] for name in sorted(setting, key=names.index)}


def _point(
    task: TradeTask, setting: Setting, samples: Sequence[Sample], memory_mb: float, pace: float
) -> Point:
    # What the runs would have taken at the quietest moment of the measurement.
    seconds = [one.outcome.seconds * pace / one.pace for one in samples]
    seeds = [one.seed for one in samples]
    times = _by_seed(seconds, seeds)
    errors = _by_seed([one.outcome.error for one in samples], seeds)
    return Point(
        task.name,
        dict(setting),
        float(np.mean(times)),
        float(np.mean(errors)),
        task.unit,
        float(np.std(seconds, ddof=1)) if len(seconds) > 1 else 0.0,
        float(np.std(errors, ddof=1)) if len(errors) > 1 else 0.0,
        memory_mb,
        len(samples),
        pace,
        {
            name: float(np.median([one.outcome.beside[name] for one in samples]))
            for name in samples[0].outcome.beside
        },
    )


def _by_seed(values: Sequence[float], seeds: Sequence[int]) -> list[float]:
    """The median of each seed's values: some seeds ran more often than others."""
    pairs = list(zip(seeds, values, strict=True))
    return [float(np.median([v for s, v in pairs if s == seed])) for seed in dict.fromkeys(seeds)]


def reason(error: Exception) -> str:
    """One line on an error; its type too where it is none of ours."""
    text = " ".join(str(error).split())
    return text if isinstance(error, SkinError) else f"{type(error).__name__}: {text}"


def pace_seconds() -> float:
    """CPU time of the fixed piece of work, the least of a few calls."""
    return min(_timed() for _ in range(CALLS))


def _timed() -> float:
    grid, points = _fixed()
    started = time.process_time()
    _work(grid, points)
    return time.process_time() - started


def _work(grid: Any, points: Any) -> float:
    """What the tasks are made of: interpreted loops, small arrays, a sparse factorisation."""
    from scipy.sparse.linalg import splu

    counts: dict[int, int] = {}
    for number in range(WORDS):
        counts[number % 97] = counts.get(number % 97, 0) + number
    found = 0.0
    for start in range(0, len(points) - 400, 100):
        part = points[start : start + 400]
        order = np.argsort(part[:, 0])
        found += float(np.linalg.norm(part[order] - part, axis=1).sum())
    solution = splu(grid).solve(points[: grid.shape[0]])
    return found + float(np.sort(solution, axis=0)[0, 0]) + counts[0]


@cache
def _fixed() -> tuple[Any, Any]:
    """A grid's Laplacian and points, always the same."""
    from scipy.sparse import csc_array, diags_array, eye_array, kron

    line = diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(SIDE, SIDE))
    one = eye_array(SIDE)
    grid = csc_array(kron(line, one) + kron(one, line) + 0.1 * eye_array(SIDE * SIDE))
    points = np.random.default_rng(0).random((4000, 3))
    return grid, points

"""Measuring a task: each setting once for each seed, in an order drawn anew, on one thread."""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from skinmap.errors import BrokenPluginError, SkinError, UnknownNameError
from skinmap.trade.measured import Point, Unmeasured, describe
from skinmap.trade.task import Outcome, Setting, TradeTask

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

T = TypeVar("T")
CALLS, CALLS_MOST = 3, 200  # timed calls of quick work, and
LEAST = 0.05  # seconds of them at least
SLOW = 0.15  # seconds of one call that is timed once
logger = logging.getLogger(__name__)


def cpu_seconds(work: Callable[[], T], *, least: float = LEAST) -> tuple[float, T]:
    """CPU time of one call, the least of several after one to warm up, and what it returned.

    What others do on the machine only ever adds to the time of a call (caches, a shared core's
    clock), so the least of several calls says most about the work itself.

    Parameters
    ----------
    work : callable
        Without arguments; does the same each time.
    least : float
        Seconds of timed calls at least; more where single calls differ much.

    Returns
    -------
    seconds : float
        [s].
    result : object

    Examples
    --------
    >>> from skinmap.trade import cpu_seconds
    >>> seconds, result = cpu_seconds(lambda: sum(range(1000)))
    >>> result, seconds < 1.0
    (499500, True)
    """
    result = work()
    times: list[float] = []
    collecting = gc.isenabled()
    gc.disable()  # a collection belongs to no call more than to another
    try:
        while len(times) < CALLS_MOST:
            started = time.process_time()
            result = work()
            times.append(time.process_time() - started)
            enough = len(times) >= CALLS and sum(times) >= least
            if enough or min(times) > SLOW:
                break
    finally:
        if collecting:
            gc.enable()
    return min(times), result


def measure(
    task: TradeTask,
    robot: Robot,
    parts: tuple[str, ...],
    *,
    seeds: Sequence[int],
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[Point], list[Unmeasured]]:
    """Measure all settings of a task.

    One round a seed, each in an order of its own, so that no setting always meets the machine in
    the same state. A setting that fails is left out of later rounds and reported; so is a task
    that fails as a whole.

    Parameters
    ----------
    task : TradeTask
    robot : Robot
    parts : tuple of str
    seeds : sequence of int
        One repetition each.
    progress : callable, optional
        Called for each setting of each round with what comes next.

    Returns
    -------
    points : list of Point
        Of the settings that never failed, in the order of the task's.
    unmeasured : list of Unmeasured

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.trade import measure, tasks
    >>> robot = skinmap.load_robot("kaspar")
    >>> points, unmeasured = measure(tasks.get("flatten"), robot, ("right_hand",), seeds=[0])
    >>> len(points) > 5, points[0].unit
    (True, '%')
    """
    from threadpoolctl import threadpool_limits

    found: list[list[Outcome]] = []
    failed: dict[int, Unmeasured] = {}
    with threadpool_limits(1):
        try:
            settings = [_ordered(task, setting) for setting in task.settings()]
            found = [[] for _ in settings]
            for seed in seeds:
                prepared = task.prepare(robot, parts, seed=seed)
                for number in np.random.default_rng(seed).permutation(len(settings)).tolist():
                    progress(f"{task.name}: {describe(settings[number])}")
                    if number in failed:
                        continue
                    try:
                        outcome = task.run(prepared, settings[number], seed=seed)
                        found[number].append(_checked(outcome))
                    except Exception as error:  # noqa: BLE001 - the other settings still run
                        failed[number] = _unmeasured(task, settings[number], error)
        except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
            return [], [_unmeasured(task, None, error)]
    good = [number for number in range(len(settings)) if number not in failed]
    points = [_point(task, settings[number], found[number]) for number in good]
    return points, [failed[number] for number in sorted(failed)]


def _checked(outcome: Outcome) -> Outcome:
    """Refuse figures that mean nothing.

    Raises
    ------
    BrokenPluginError
    """
    for name in ("seconds", "error"):
        value = float(getattr(outcome, name))
        if not 0.0 <= value < np.inf:
            raise BrokenPluginError(f"{name} must be a number from 0, the task gave {value}")
    return outcome


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


def _unmeasured(task: TradeTask, setting: Setting | None, error: Exception) -> Unmeasured:
    """Why something was not measured, in one line; the error's type too where it is not ours."""
    logger.info("%s %s failed", task.name, setting, exc_info=True)
    text = " ".join(str(error).split())
    said = text if isinstance(error, SkinError) else f"{type(error).__name__}: {text}"
    return Unmeasured(task=task.name, setting=None if setting is None else {**setting}, reason=said)


def _point(task: TradeTask, setting: Setting, outcomes: Sequence[Outcome]) -> Point:
    seconds = [one.seconds for one in outcomes]
    errors = [one.error for one in outcomes]
    several = len(outcomes) > 1
    return Point(
        task=task.name,
        setting=dict(setting),
        seconds=float(np.median(seconds)),
        error=float(np.mean(errors)),
        unit=task.unit,
        seconds_spread=float(np.std(seconds, ddof=1)) if several else None,
        error_spread=float(np.std(errors, ddof=1)) if several else None,
        runs=len(outcomes),
        beside={
            name: float(np.median([one.beside[name] for one in outcomes]))
            for name in outcomes[0].beside
        },
    )

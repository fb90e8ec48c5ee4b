"""Measuring a task, each setting once for each seed, in an order drawn anew, on one thread.

Below it: the tasks with their knobs, the Pareto front of the settings with its picture, and the
result as Python and JSON have it.
"""

from __future__ import annotations

import gc
import logging
import math
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from skinmap import __version__
from skinmap.errors import ImpossibleBudgetError, SkinError
from skinmap.imports import installed
from skinmap.profile import Value
from skinmap.report.page import plain_figure, save_figure
from skinmap.report.result import MERGED

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

# Knob: value. A knob that a setting does not name stands at its default, or does not matter there.
Setting = Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Knob:
    """A knob that is turned.

    Attributes
    ----------
    name
        Name of the command's option, with underscores.
    meaning
        Effect of the option, in one line.
    values
        Values that were measured.
    default
        Default of the commands.
    """

    name: str
    values: tuple[Value, ...]
    default: Value
    meaning: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one run of a setting cost, and how wrong it was.

    Attributes
    ----------
    seconds : float
        CPU time of one unit of the task's work, warm.
    error : float
        In the task's unit; 0 is perfect.
    beside : mapping of str to float
        Other figures worth showing, such as `training_seconds`.
    """

    seconds: float
    error: float
    beside: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))


class TradeTask(Protocol):
    """Promises of a task.

    Attributes
    ----------
    name : str
        Also the group of its knobs in a profile.
    unit : str
        Of the error: "%", "mm".
    work : str
        What the seconds pay for: "one flat map of the part".
    truth : str
        What the errors are against.
    knobs : tuple of Knob
    """

    name: str
    unit: str
    work: str
    truth: str
    knobs: tuple[Knob, ...]

    def settings(self) -> Sequence[Setting]:
        """Which combinations are measured; see `around` and `product`."""

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> Any:
        """What all settings share, untimed; another seed is another repetition."""

    def run(self, prepared: Any, setting: Setting, *, seed: int) -> Outcome:
        """Measure one setting once; `skinmap.trade.measuring.cpu_seconds` takes the time."""


def defaults(knobs: Sequence[Knob]) -> dict[str, Value]:
    """Every knob at its default."""
    return {knob.name: knob.default for knob in knobs}


LIBRARIES = ("numpy", "scipy", "libigl", "scikit-learn", "numba")


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskRow:
    """A task that is measured.

    Attributes
    ----------
    task
        Name of the task.
    work
        Work that the seconds measure.
    unit, truth
        Of the errors, and what they are against.
    knobs
        Settings that are varied.
    """

    task: str
    work: str
    unit: str
    truth: str
    knobs: list[Knob]


@dataclass(frozen=True, kw_only=True, slots=True)
class Point:
    """One setting of a task.

    Attributes
    ----------
    task, setting
        Which: the value of each knob.
    seconds, seconds_spread
        CPU time of one unit of work, the median over the seeds, and its standard deviation; the
        latter null for one seed.
    error, error_spread, unit
        In the task's unit, the mean over the seeds, and its standard deviation; the latter null
        for one seed.
    runs
        Number of runs, one for each seed.
    pareto
        Whether no other setting is both faster and better.
    beside
        Further figures of the task, medians over the seeds: `training_seconds` or
        `unmeshed`.
    """

    task: str
    setting: dict[str, Value]
    seconds: float
    error: float
    unit: str
    seconds_spread: float | None = None
    error_spread: float | None = None
    runs: int = 1
    pareto: bool = False
    beside: dict[str, float | None] = field(default_factory=dict, metadata=MERGED)

    @property
    def cost(self) -> str:
        """Time and error in words."""
        return f"{self.seconds * 1e3:.3g} ms, {self.error:.3g} {self.unit}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Recommended:
    """The setting to take.

    Attributes
    ----------
    setting
        The value of each knob.
    seconds
        Time of the recommended setting.
    error
        Error of the recommended setting.
    unit
        Unit of the error.
    why
        The limit that it keeps.
    """

    setting: dict[str, Value]
    seconds: float
    error: float
    unit: str
    why: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Unmeasured:
    """A setting or task without a measurement.

    Attributes
    ----------
    task
        Name of the task.
    reason
        Reason for the missing measurement.
    setting
        The value of each knob; null: the whole task.
    """

    task: str
    setting: dict[str, Value] | None
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class TradeResult:
    """Time and error of each setting, with a recommendation.

    Attributes
    ----------
    robot, parts
        The robot as given.
    seed, seeds
        The first, and how many.
    machine
        Its processor and system.
    versions
        Versions of packages behind the figures; null where one is not installed.
    tasks
        Tasks with measured settings.
    points
        Every setting of every task.
    recommended
        Recommended settings by task.
    failed
        Settings and tasks without a measurement.
    profile
        File of the recommended settings; null without `--out`.
    files
        Names of the files inside `--out`.
    """

    robot: str
    parts: list[str]
    seed: int
    seeds: int
    machine: str = field(default_factory=lambda: machine())
    versions: dict[str, str | None] = field(default_factory=lambda: versions())
    tasks: list[TaskRow]
    points: list[Point]
    recommended: dict[str, Recommended]
    failed: list[Unmeasured]
    profile: str | None
    files: list[str] = field(default_factory=list)


def describe(setting: Setting) -> str:
    """A setting as `method=fast meshing=consensus`."""
    return " ".join(f"{name}={value}" for name, value in setting.items()) or "nothing to set"


def machine() -> str:
    """The processor and its system, in a few words."""
    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            models = [line.partition(":")[2] for line in lines if line.startswith("model name")]
    except OSError:  # not Linux
        models = []
    return f"{models[0].strip() if models else name}, {platform.system()}"


def versions() -> dict[str, str | None]:
    """Versions of what the figures depend on; None where it is not installed."""
    libraries = {name: installed(name) for name in LIBRARIES}
    return {"skinmap": __version__, "python": platform.python_version(), **libraries}


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
    >>> from skinmap.trade import measure
    >>> from skinmap.trade.tasks import flatten_task
    >>> robot = skinmap.load_robot("kaspar")
    >>> points, unmeasured = measure(flatten_task, robot, ("right_hand",), seeds=[0])
    >>> len(points) > 5, points[0].unit
    (True, '%')
    """
    from threadpoolctl import threadpool_limits

    found: list[list[Outcome]] = []
    failed: dict[int, Unmeasured] = {}
    with threadpool_limits(1):
        try:
            settings = task.settings()
            found = [[] for _ in settings]
            for seed in seeds:
                prepared = task.prepare(robot, parts, seed=seed)
                for number in np.random.default_rng(seed).permutation(len(settings)).tolist():
                    progress(f"{task.name}: {describe(settings[number])}")
                    if number in failed:
                        continue
                    try:
                        found[number].append(task.run(prepared, settings[number], seed=seed))
                    except Exception as error:  # noqa: BLE001 - the other settings still run
                        failed[number] = _unmeasured(task, settings[number], error)
        except Exception as error:  # noqa: BLE001 - the other tasks still run
            return [], [_unmeasured(task, None, error)]
    good = [number for number in range(len(settings)) if number not in failed]
    points = [_point(task, settings[number], found[number]) for number in good]
    return points, [failed[number] for number in sorted(failed)]


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


SAMPLE = 0.02  # seconds from one sample of a stream to the next at 50 Hz
SHARE = 0.01  # of the default's error, from which a difference is worth another setting


def pareto(points: Sequence[Point]) -> list[bool]:
    """Whether each is on the front: no other is at least as good in both and better in one.

    Parameters
    ----------
    points : sequence of Point
        Of one task.

    Returns
    -------
    list of bool

    Examples
    --------
    >>> from skinmap.trade import Point, pareto
    >>> costs = [(1e-3, 8.0), (1e-2, 1.0), (2e-2, 4.0)]
    >>> pareto([Point(task="x", setting={}, seconds=s, error=e, unit="%") for s, e in costs])
    [True, True, False]
    """
    costs = np.array([(point.seconds, point.error) for point in points]).reshape(-1, 2)
    no_worse = (costs[:, None] <= costs).all(axis=2)
    better = (costs[:, None] < costs).any(axis=2)
    return [not beaten for beaten in np.logical_or.reduce(no_worse & better)]


def recommend(
    points: Sequence[Point], default: Setting, seconds: float | None = None
) -> tuple[Point, str]:
    """The point to take, and why in words: the least error within the time there is.

    That is one sample of a stream or, where the default takes longer, its time. The default stays
    unless another one errs less by a hundredth, and by more than the spread over the seeds may
    explain.

    Parameters
    ----------
    points : sequence of Point
        Of one task, at least one.
    default : mapping of str to value
        All knobs as the commands have them.
    seconds : float, optional
        Another limit of time [s].

    Returns
    -------
    point : Point
    why : str
        The limit that it keeps.

    Raises
    ------
    ImpossibleBudgetError
        No point keeps the limit; names the nearest.

    Examples
    --------
    >>> from skinmap.trade import Point, recommend
    >>> costs = {"low": (1e-3, 8.0), "middle": (1e-2, 1.0), "high": (0.1, 0.5)}
    >>> points = [
    ...     Point(task="x", setting={"level": name}, seconds=seconds, error=error, unit="%")
    ...     for name, (seconds, error) in costs.items()
    ... ]
    >>> point, why = recommend(points, {"level": "low"})
    >>> point.setting, why
    ({'level': 'middle'}, 'least error within one sample of a stream (20 ms)')
    """
    usual = next((point for point in points if _stands(point, default)), None)
    least = min(points, key=lambda point: (point.seconds, point.error))
    most = max(SAMPLE, (usual or least).seconds) if seconds is None else seconds
    fitting = [point for point in points if point.seconds <= most]
    if not fitting:
        raise ImpossibleBudgetError(
            f"{least.task}: no setting keeps to {most * 1e3:.3g} ms; the nearest is "
            f"{describe(least.setting)} with {least.cost}"
        )
    if usual is not None and usual in fitting:
        fitting = [one for one in fitting if one is usual or _better(one, usual)]
    chosen = min(fitting, key=lambda point: (point.error, point.seconds))
    if seconds is not None:
        where = f"{most * 1e3:.4g} ms"
    elif most == SAMPLE:
        where = f"one sample of a stream ({SAMPLE * 1e3:.0f} ms)"
    else:
        where = f"the time of the {'default' if usual else 'fastest'} ({most * 1e3:.3g} ms)"
    if chosen is usual:
        return chosen, f"the default: no other setting errs less for sure within {where}"
    return chosen, f"least error within {where}"


def _stands(point: Point, default: Setting) -> bool:
    """Whether all knobs of a point stand at their defaults."""
    return all(default.get(name) == value for name, value in point.setting.items())


def _better(one: Point, other: Point) -> bool:
    """Whether one errs less by more than the standard error of the difference, and by a share."""
    spread = math.hypot(one.error_spread or 0.0, other.error_spread or 0.0)
    return other.error - one.error > max(spread / math.sqrt(one.runs), SHARE * other.error)


BLUE, GREY, RED = "#1f5fa8", "#9aa7b5", "#c8372d"
DIM = "#5c6874"
WIDE = 20.0  # errors that differ by more than this factor are drawn on a logarithmic axis
SIZE = (7.7, 5.6)  # [inch]


def trade_figure(result: TradeResult, task: TaskRow, path: Path) -> None:
    """Draw one task's settings as PNG: points numbered by their time, as in the table."""
    listed = points_by_time(result, task.task)
    chosen = chosen_of(listed, result.recommended[task.task])
    front = [point for point in listed if point.pareto]
    figure = plain_figure(SIZE)
    axis = figure.subplots()
    rest = [point for point in listed if not point.pareto]
    _draw(axis, rest, color=GREY, markersize=4.5, label="other settings")
    times, errors = zip(*((1e3 * point.seconds, point.error) for point in front), strict=True)
    axis.step(times, errors, where="post", color=BLUE, linewidth=1.3, alpha=0.7)
    _draw(axis, front, color=BLUE, markersize=6, label="Pareto front")
    star = {"color": RED, "markersize": 16, "zorder": 4}
    axis.plot([1e3 * chosen.seconds], [chosen.error], "*", label="recommended", **star)
    scale_axes(axis, listed)
    axis.set_xlabel(f"CPU time: {task.work} [ms]")
    axis.set_ylabel(f"error [{task.unit}]")
    seeds = f"{result.seeds} seed{'s; bars: standard deviation' if result.seeds > 1 else ''}"
    where = f"{Path(result.robot).name} {', '.join(result.parts)}"
    figure.suptitle(f"{task.task}: {where}, {seeds}\nerror: {task.truth}", fontsize=10)
    axis.grid(True, which="major", color="#e6e9ed", linewidth=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    for number, point in enumerate(listed, start=1):
        place = 1e3 * point.seconds, point.error
        colour = BLUE if point.pareto else DIM
        axis.annotate(
            str(number), place, xytext=(6, 6), textcoords="offset points",
            fontsize=7.5, color=colour,
        )  # fmt: skip
    save_figure(figure, path)


def points_by_time(result: TradeResult, task: str) -> list[Point]:
    """What was measured of one task, the fastest first."""
    own = (point for point in result.points if point.task == task)
    return sorted(own, key=lambda point: point.seconds)


def chosen_of(points: Sequence[Point], recommended: Recommended) -> Point:
    """The point that is recommended."""
    return next(point for point in points if point.setting == recommended.setting)


def _draw(axis: Any, points: Sequence[Point], **style: Any) -> None:
    if points:
        spreads = [(point.error_spread or 0.0, point) for point in points]
        _, _, bars = axis.errorbar(
            [1e3 * point.seconds for point in points],
            [point.error for point in points],
            xerr=[1e3 * min(point.seconds_spread or 0.0, 0.9 * point.seconds) for point in points],
            yerr=[[min(spread, point.error) for spread, point in spreads], [s for s, _ in spreads]],
            fmt="o",
            elinewidth=1.0,
            **style,
        )
        for bar in bars:
            bar.set_alpha(0.35)


def scale_axes(axis: Any, points: Sequence[Point]) -> None:
    """A logarithmic axis of time, and of errors that differ much; room for numbers."""
    low, high = min(p.seconds for p in points) * 1e3, max(p.seconds for p in points) * 1e3
    axis.set_xscale("log")
    room = 1.15 * (high / low) ** 0.08
    axis.set_xlim(low / room, high * room)
    _plain_ticks(axis.xaxis)
    errors = [point.error for point in points]
    if min(errors) > 0 and max(errors) > WIDE * min(errors):
        axis.set_yscale("log")
        axis.set_ylim(min(errors) / 2.0, max(errors) * 2.0)
        _plain_ticks(axis.yaxis)
    else:
        most = max(p.error + (p.error_spread or 0.0) for p in points) or 1.0
        axis.set_ylim(0.0, 1.12 * most)


def _plain_ticks(axis: Any) -> None:
    """Numbers as people write them, at least three, also within a decade."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

    low, high = axis.get_view_interval()
    for subs in ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)):
        ticks = [
            tick for tick in LogLocator(subs=subs).tick_values(low, high) if low <= tick <= high
        ]
        if len(ticks) > 3:
            break
    else:
        ticks = [tick for tick in MaxNLocator(5).tick_values(low, high) if low <= tick <= high]
    axis.set_ticks(ticks)
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))

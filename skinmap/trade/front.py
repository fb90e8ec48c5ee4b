"""The Pareto front of measured settings, which of them is recommended, and its picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skinmap.errors import ImpossibleBudgetError
from skinmap.report.page import plain_figure, save_figure
from skinmap.trade.measuring import Point, Recommended, Setting, TaskRow, TradeResult, describe

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
    return [not any(_dominates(other, point) for other in points) for point in points]


def _dominates(one: Point, other: Point) -> bool:
    no_worse = one.seconds <= other.seconds and one.error <= other.error
    return no_worse and (one.seconds < other.seconds or one.error < other.error)


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
    from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

    low, high = axis.get_view_interval()
    for subs in ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)):
        ticks = [
            tick for tick in LogLocator(subs=subs).tick_values(low, high) if low <= tick <= high
        ]
        if len(ticks) > 3:
            break
    else:
        from matplotlib.ticker import MaxNLocator

        ticks = [tick for tick in MaxNLocator(5).tick_values(low, high) if low <= tick <= high]
    axis.set_ticks(ticks)
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))

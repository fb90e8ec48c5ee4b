"""The Pareto front of measured settings, and which of them is recommended."""

from __future__ import annotations

import math
from collections.abc import Sequence

from skinmap.errors import ImpossibleBudgetError
from skinmap.trade.measured import Point, describe
from skinmap.trade.task import Setting

SAMPLE = 0.02  # seconds from one sample of a stream to the next at 50 Hz
SHARE = 0.01  # of the default's error, from which a difference is worth another setting
FLOOR = 0.01  # of the front's largest error: smaller errors count as so much for the knee


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


def knee(points: Sequence[Point]) -> Point:
    """The point where time x error is least: beyond it, twice the time no longer halves the error.

    It divides the front for the eye, and is not recommended: time is worth nothing below what
    there is of it.

    Parameters
    ----------
    points : sequence of Point
        Of one task, at least one.

    Returns
    -------
    Point

    Examples
    --------
    >>> from skinmap.trade import Point, knee
    >>> costs = [(1e-3, 8.0), (1e-2, 0.5), (2e-2, 0.4)]
    >>> knee([Point(task="x", setting={}, seconds=s, error=e, unit="%") for s, e in costs]).cost
    '10 ms, 0.5 %'
    """
    floor = FLOOR * max(point.error for point in points) or 1.0
    return min(points, key=lambda point: (point.seconds * max(point.error, floor), point.seconds))


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
        No point keeps the limit; says which comes nearest.

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

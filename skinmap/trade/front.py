"""The Pareto front of measured settings, and which of them a budget or its absence recommends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skinmap.errors import ImpossibleBudgetError
from skinmap.trade.points import Point

FLOOR = 0.01  # of the front's largest error: smaller errors count as so much for the knee


@dataclass(frozen=True, slots=True)
class Budget:
    """What a setting may cost and how wrong it may be; None where nothing is asked."""

    seconds: float | None = None
    error: float | None = None


def pareto(points: Sequence[Point]) -> list[bool]:
    """Whether each is on the front: no other is at least as good in both and better in one."""
    return [not any(_dominates(other, point) for other in points) for point in points]


def _dominates(one: Point, other: Point) -> bool:
    no_worse = one.seconds <= other.seconds and one.error <= other.error
    return no_worse and (one.seconds < other.seconds or one.error < other.error)


def recommend(points: Sequence[Point], budget: Budget) -> Point:
    """The point that a budget asks for.

    With a limit of time the most accurate within it (and within the error, where that is limited
    too); with a limit of error alone the fastest within it; with neither the knee of the front,
    where time x error is least: beyond it, twice the time no longer halves the error.

    Raises
    ------
    ImpossibleBudgetError
        No point keeps the budget; says which comes nearest.
    """
    fitting = [point for point in points if excess(point, budget) <= 0.0]
    if not fitting:
        raise ImpossibleBudgetError(_nearest(points, budget))
    if budget.seconds is not None:
        return min(fitting, key=lambda point: (point.error, point.seconds))
    if budget.error is not None:
        return min(fitting, key=lambda point: (point.seconds, point.error))
    return knee([point for point, on in zip(points, pareto(points), strict=True) if on])


def knee(front: Sequence[Point]) -> Point:
    """The point of a front where time x error is least."""
    floor = FLOOR * max(point.error for point in front) or 1.0
    return min(front, key=lambda point: (point.seconds * max(point.error, floor), point.seconds))


def excess(point: Point, budget: Budget) -> float:
    """By how much a point overdraws a budget, as a share of it, the worse of the two; 0 if not."""
    over = [0.0]
    if budget.seconds is not None:
        over.append(point.seconds / budget.seconds - 1.0)
    if budget.error is not None:
        over.append(
            point.error / budget.error - 1.0
            if budget.error > 0
            else (float("inf") if point.error > 0 else 0.0)
        )
    return max(over)


def _nearest(points: Sequence[Point], budget: Budget) -> str:
    near = min(points, key=lambda point: (excess(point, budget), point.error, point.seconds))
    asked = []
    if budget.seconds is not None:
        asked.append(f"{budget.seconds * 1e3:.3g} ms")
    if budget.error is not None:
        asked.append(f"{budget.error:.3g} {near.unit}")
    return (
        f"{near.task}: no setting keeps to {' and '.join(asked)}; the nearest is {near.words} "
        f"with {near.seconds * 1e3:.3g} ms and {near.error:.3g} {near.unit}"
    )

"""What `skinmap trade` gives back: its result, words for people, plots, page and profile."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from skinmap.cli.trade.result import (
    FailedRow,
    KnobRow,
    PointRow,
    Recommended,
    TaskRow,
    TradeResult,
)
from skinmap.profile import Value
from skinmap.report.image import media
from skinmap.report.page import lines_page
from skinmap.report.table import Cell, Table
from skinmap.trade.front import Budget, pareto
from skinmap.trade.points import Failure, Point, describe
from skinmap.trade.profile_file import Origin, machine, write_profile
from skinmap.trade.task import Setting, TradeTask

PROFILE = "profile.toml"


@dataclass(frozen=True, eq=False, slots=True)
class Traded:
    """All that was measured.

    Attributes
    ----------
    tasks : mapping of str to TradeTask
    points : mapping of str to sequence of Point
        By task; those of which every setting failed are left out.
    failures : sequence of Failure
    chosen : mapping of str to Point
        The recommendation by task.
    budgets : mapping of str to Budget
    origin : Origin
    """

    tasks: Mapping[str, TradeTask]
    points: Mapping[str, Sequence[Point]]
    failures: Sequence[Failure]
    chosen: Mapping[str, Point]
    budgets: Mapping[str, Budget]
    origin: Origin


def result_of(traded: Traded, out: Path | None) -> TradeResult:
    """The numbers."""
    return TradeResult(
        robot=traded.origin.robot,
        parts=list(traded.origin.parts),
        seed=traded.origin.seed,
        seeds=traded.origin.seeds,
        machine=machine(),
        tasks=[_task(task) for task in traded.tasks.values()],
        points=[
            _point(point, on_front)
            for points in traded.points.values()
            for point, on_front in zip(points, pareto(points), strict=True)
        ],
        recommended={
            name: Recommended(
                setting=dict(point.setting),
                seconds=point.seconds,
                error=point.error,
                unit=point.unit,
                why=why(traded.budgets[name]),
            )
            for name, point in traded.chosen.items()
        },
        failed=[
            FailedRow(
                task=one.task,
                setting=None if one.setting is None else dict(one.setting),
                reason=one.reason,
            )
            for one in traded.failures
        ],
        profile=None if out is None else str(out / PROFILE),
    )


def _plain(setting: Setting | None) -> dict[str, Value] | None:
    return None if setting is None else dict(setting)


def _point(point: Point, on_front: bool) -> PointRow:
    return PointRow(
        task=point.task,
        setting=dict(point.setting),
        seconds=point.seconds,
        seconds_spread=point.seconds_spread,
        error=point.error,
        error_spread=point.error_spread,
        unit=point.unit,
        memory_mb=point.memory_mb,
        pareto=on_front,
        runs=point.runs,
        pace_seconds=point.pace,
        beside=dict(point.beside),
    )


def _task(task: TradeTask) -> TaskRow:
    knobs = [
        KnobRow(name=k.name, values=list(k.values), default=k.default, meaning=k.meaning)
        for k in task.knobs
    ]
    return TaskRow(task=task.name, work=task.work, unit=task.unit, truth=task.truth, knobs=knobs)


def why(budget: Budget) -> str:
    """What a recommendation follows."""
    said = []
    if budget.seconds is not None:
        said.append(f"most accurate within {budget.seconds * 1e3:.4g} ms")
    if budget.error is not None:
        said.append(f"{'' if said else 'fastest '}within an error of {budget.error:.4g}")
    return " and ".join(said) or "knee of the front: least time x error"


def write(traded: Traded, stage: Path) -> Iterator[str]:
    """Write a plot of each task and the profile into a folder; their names."""
    from skinmap.cli.trade.figures import trade_figure

    for name, points in traded.points.items():
        path = stage / f"{name}.png"
        trade_figure(traded.tasks[name], points, traded.chosen[name], traded.origin, path)
        yield path.name
    write_profile(stage / PROFILE, list(traded.chosen.values()), traded.origin)
    yield PROFILE


def report(traded: Traded, stage: Path) -> str:
    """The page, with the plots that were written."""
    plots = [media(stage / f"{name}.png", name) for name in traded.points]
    title = f"{Path(traded.origin.robot).name}: speed against accuracy"
    return lines_page(title, lines(traded), plots)


def lines(traded: Traded) -> Iterator[str | Table]:
    """For people: every setting by its time, the front and the recommendation marked."""
    for name, points in traded.points.items():
        task, chosen = traded.tasks[name], traded.chosen[name]
        yield f"{name}: time of {task.work}; error in {task.unit}, {task.truth}"
        columns = ["", "setting", "ms", "±", task.unit, "±", "MB"]
        yield Table(columns, [_row(point, on, point is chosen) for point, on in _by_time(points)])
        yield (
            f"recommended ({why(traded.budgets[name])}): {chosen.words}: "
            f"{chosen.seconds * 1e3:.3g} ms, {chosen.error:.3g} {chosen.unit}\n"
        )
    for one in traded.failures:
        where = "" if one.setting is None else f" {describe(one.setting)}"
        yield f"not measured: {one.task}{where}: {one.reason}"


def _by_time(points: Sequence[Point]) -> list[tuple[Point, bool]]:
    return sorted(zip(points, pareto(points), strict=True), key=lambda pair: pair[0].seconds)


def _row(point: Point, on_front: bool, recommended: bool) -> list[Cell]:
    return [
        "=>" if recommended else "*" if on_front else "",
        point.words,
        1e3 * point.seconds,
        1e3 * point.seconds_spread,
        point.error,
        point.error_spread,
        point.memory_mb,
    ]

"""What `skinmap trade` gives back: the JSON object, tables, plots and the profile."""

from __future__ import annotations

import importlib.metadata
import json
import math
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from skinmap import __version__
from skinmap.report.table import table
from skinmap.trade.front import Budget, pareto
from skinmap.trade.points import Failure, Point, describe
from skinmap.trade.profile_file import Origin, machine, write_profile
from skinmap.trade.task import TradeTask

LIBRARIES = ("numpy", "scipy", "libigl", "scikit-learn", "numba")
PROFILE = "profile.toml"
Points = Mapping[str, Sequence[Point]]


def result_of(
    tasks: Mapping[str, TradeTask],
    found: Points,
    failures: Sequence[Failure],
    chosen: Mapping[str, Point],
    budgets: Mapping[str, Budget],
    origin: Origin,
) -> dict[str, Any]:
    """The JSON object; `docs/json.md` has its keys."""
    return {
        "robot": origin.robot,
        "parts": list(origin.parts),
        "seed": origin.seed,
        "seeds": origin.seeds,
        "machine": machine(),
        "versions": versions(),
        "tasks": [_task(task) for task in tasks.values()],
        "points": [
            point_row(point, on)
            for points in found.values()
            for point, on in zip(points, pareto(points), strict=True)
        ],
        "recommended": {
            name: {
                "setting": dict(point.setting),
                "seconds": point.seconds,
                "error": point.error,
                "unit": point.unit,
                "why": why(budgets[name]),
            }
            for name, point in chosen.items()
        },
        "failed": [
            {"task": one.task, "setting": one.setting and dict(one.setting), "reason": one.reason}
            for one in failures
        ],
        "profile": None,
        "files": [],
    }


def point_row(point: Point, on_front: bool) -> dict[str, Any]:
    """One of `points`."""
    return {
        "task": point.task,
        "setting": dict(point.setting),
        "seconds": point.seconds,
        "seconds_spread": point.seconds_spread,
        "error": point.error,
        "error_spread": point.error_spread,
        "unit": point.unit,
        "memory_mb": point.memory_mb,
        "pareto": on_front,
        "runs": point.runs,
        "pace_seconds": point.pace,
        **point.beside,
    }


def _task(task: TradeTask) -> dict[str, Any]:
    knobs = [
        {"name": k.name, "values": list(k.values), "default": k.default, "meaning": k.meaning}
        for k in task.knobs
    ]
    return {
        "task": task.name,
        "work": task.work,
        "unit": task.unit,
        "truth": task.truth,
        "knobs": knobs,
    }


def versions() -> dict[str, str | None]:
    """Versions of what the figures depend on; None where it is not installed."""
    found: dict[str, str | None] = {"skinmap": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found


def why(budget: Budget) -> str:
    """What a recommendation follows."""
    said = []
    if budget.seconds is not None:
        said.append(f"most accurate within {budget.seconds * 1e3:.4g} ms")
    if budget.error is not None:
        said.append(f"{'' if said else 'fastest '}within an error of {budget.error:.4g}")
    return " and ".join(said) or "knee of the front: least time x error"


def write(
    stage: Path,
    tasks: Mapping[str, TradeTask],
    found: Points,
    chosen: Mapping[str, Point],
    origin: Origin,
) -> None:
    """Write a plot of each task and the profile into a folder."""
    from skinmap.cli.trade.figures import trade_figure

    for name, points in found.items():
        trade_figure(tasks[name], points, chosen[name], origin, stage / f"{name}.png")
    write_profile(stage / PROFILE, list(chosen.values()), origin)


def emit_result(result: Mapping[str, Any]) -> None:
    """Print one JSON object; numbers to six digits, as a touch may take 50 microseconds."""
    click.echo(json.dumps(significant(result), indent=2, allow_nan=False))


def significant(value: Any) -> Any:
    """Nested data with numbers of six digits, None for NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(key): significant(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [significant(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value


def show(
    tasks: Mapping[str, TradeTask],
    found: Points,
    failures: Sequence[Failure],
    chosen: Mapping[str, Point],
    budgets: Mapping[str, Budget],
) -> None:
    """Tables for people: every setting by its time, the front and the recommendation marked."""
    for name, points in found.items():
        task = tasks[name]
        click.echo(f"{name}: time of {task.work}; error in {task.unit}, {task.truth}")
        table(
            ["", "setting", "ms", "±", task.unit, "±", "MB"],
            [_row(point, on, point is chosen[name]) for point, on in _by_time(points)],
        )
        point = chosen[name]
        click.echo(
            f"recommended ({why(budgets[name])}): {point.words}: {point.seconds * 1e3:.3g} ms, "
            f"{point.error:.3g} {point.unit}\n"
        )
    for one in failures:
        where = "" if one.setting is None else f" {describe(one.setting)}"
        click.echo(f"not measured: {one.task}{where}: {one.reason}")


def _by_time(points: Sequence[Point]) -> list[tuple[Point, bool]]:
    return sorted(zip(points, pareto(points), strict=True), key=lambda pair: pair[0].seconds)


def _row(point: Point, on_front: bool, recommended: bool) -> list[Any]:
    return [
        "=>" if recommended else "*" if on_front else "",
        point.words,
        1e3 * point.seconds,
        1e3 * point.seconds_spread,
        point.error,
        point.error_spread,
        point.memory_mb,
    ]

"""`skinmap trade --check`: a profile's settings measured again, beside what it predicts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from skinmap.cli.trade.report import emit_result, versions
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress
from skinmap.profile import read_profile
from skinmap.report.table import table
from skinmap.trade.check import ERROR_WITHIN, TIME_WITHIN, Checked, check_profile
from skinmap.trade.points import Failure
from skinmap.trade.profile_file import machine
from skinmap.trade.runner import steps
from skinmap.trade.task import tasks


def run_check(
    path: Path,
    robot: str,
    parts: tuple[str, ...],
    names: tuple[str, ...] | None,
    seed: int,
    seeds: int,
    *,
    as_json: bool,
) -> bool:
    """Check a profile, on its own robot, parts, tasks and seeds where nothing else is given.

    Returns
    -------
    bool
        Whether every figure is as predicted.
    """
    profile = read_profile(path)
    robot = robot if given("robot") or not profile.robot else profile.robot
    parts = parts or tuple(part for part in profile.part.split(",") if part)
    first = seed if given("seed") or profile.seed is None else profile.seed
    count = seeds if given("seeds") or profile.seeds is None else profile.seeds
    known = {name: tasks.get(name) for name in names or profile.predicted}
    loaded, wanted = open_robot(robot, parts)
    with progress(len(known) * steps(1, count), "check") as advance:
        checked, failures = check_profile(
            profile, known, loaded, wanted, seeds=range(first, first + count), progress=advance
        )
    within = not failures and all(one.within for one in checked)
    if as_json:
        emit_result(
            {
                "robot": robot,
                "parts": list(wanted),
                "seed": first,
                "seeds": count,
                "machine": machine(),
                "versions": versions(),
                "profile": str(path),
                "checked": [_row(one) for one in checked],
                "failed": [{"task": one.task, "reason": one.reason} for one in failures],
                "within": within,
            }
        )
    else:
        _show(checked, failures)
    return within


def given(name: str) -> bool:
    """Whether a parameter stands on the command line."""
    source = click.get_current_context().get_parameter_source(name)
    return source is ParameterSource.COMMANDLINE


def _row(one: Checked) -> dict[str, Any]:
    return {
        "task": one.point.task,
        "setting": dict(one.point.setting),
        "unit": one.point.unit,
        "predicted": {"seconds": one.seconds, "error": one.error},
        "measured": {"seconds": one.point.seconds, "error": one.point.error},
        "slower": one.slower,
        "raw_seconds_ratio": one.raw_ratio,
        "seconds_ratio": one.seconds_ratio,
        "error_ratio": one.error_ratio,
        "within": one.within,
    }


def _show(checked: list[Checked], failures: list[Failure]) -> None:
    table(
        [
            "task",
            "setting",
            "ms",
            "predicted",
            "raw ratio",
            "pace",
            "ratio",
            "error",
            "predicted",
            "ratio",
            "",
        ],
        [
            [
                one.point.task,
                one.point.words,
                1e3 * one.point.seconds,
                1e3 * one.seconds,
                one.raw_ratio,
                one.slower,
                one.seconds_ratio,
                f"{one.point.error:.3g} {one.point.unit}",
                f"{one.error:.3g} {one.point.unit}",
                one.error_ratio,
                "as predicted" if one.within else "differs",
            ]
            for one in checked
        ],
    )
    click.echo(
        f"as predicted: the time within {100 * TIME_WITHIN:.0f} % (ratio: raw ratio over pace, "
        "which is how many times as long a fixed piece of work takes now), "
        f"the error within {100 * ERROR_WITHIN:.0f} %"
    )
    for one in failures:
        click.echo(f"not measured: {one.task}: {one.reason}")

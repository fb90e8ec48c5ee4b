"""`skinmap trade --check`: a profile's settings measured again, beside what it predicts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
from click.core import ParameterSource

from skinmap.cli.trade.result import CheckedRow, CheckFailed, CheckResult, Cost
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress
from skinmap.profile import read_profile
from skinmap.report.table import Cell, Table
from skinmap.trade.check import ERROR_WITHIN, TIME_WITHIN, Checked, check_profile
from skinmap.trade.points import describe
from skinmap.trade.profile_file import machine
from skinmap.trade.runner import steps
from skinmap.trade.task import tasks


def work(
    path: Path,
    robot: str,
    parts: tuple[str, ...],
    names: tuple[str, ...] | None,
    seed: int,
    seeds: int,
) -> CheckResult:
    """Check a profile, on its own robot, parts, tasks and seeds where nothing else is given."""
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
    return CheckResult(
        robot=robot,
        parts=list(wanted),
        seed=first,
        seeds=count,
        machine=machine(),
        profile=str(path),
        checked=[_row(one) for one in checked],
        failed=[CheckFailed(task=one.task, reason=one.reason) for one in failures],
        within=not failures and all(one.within for one in checked),
    )


def given(name: str) -> bool:
    """Whether a parameter stands on the command line."""
    source = click.get_current_context().get_parameter_source(name)
    return source is ParameterSource.COMMANDLINE


def _row(one: Checked) -> CheckedRow:
    return CheckedRow(
        task=one.point.task,
        setting=dict(one.point.setting),
        unit=one.point.unit,
        predicted=Cost(seconds=one.seconds, error=one.error),
        measured=Cost(seconds=one.point.seconds, error=one.point.error),
        slower=one.slower,
        raw_seconds_ratio=one.raw_ratio,
        seconds_ratio=one.seconds_ratio,
        error_ratio=one.error_ratio,
        within=one.within,
    )


def lines(result: CheckResult) -> Iterator[str | Table]:
    """For people: measured beside predicted."""
    columns = ["task", "setting", "ms", "predicted", "raw ratio", "pace", "ratio"]
    rows: list[list[Cell]] = [
        [
            one.task,
            describe(one.setting),
            1e3 * one.measured.seconds,
            1e3 * one.predicted.seconds,
            one.raw_seconds_ratio,
            one.slower,
            one.seconds_ratio,
            f"{one.measured.error:.3g} {one.unit}",
            f"{one.predicted.error:.3g} {one.unit}",
            one.error_ratio,
            "as predicted" if one.within else "differs",
        ]
        for one in result.checked
    ]
    yield Table([*columns, "error", "predicted", "ratio", ""], rows)
    yield (
        f"as predicted: the time within {100 * TIME_WITHIN:.0f} % (ratio: raw ratio over pace, "
        "which is how many times as long a fixed piece of work takes now), "
        f"the error within {100 * ERROR_WITHIN:.0f} %"
    )
    for one in result.failed:
        yield f"not measured: {one.task}: {one.reason}"

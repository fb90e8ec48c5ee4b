"""`skinmap trade`: speed against accuracy on a user's own skin and machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from skinmap.cli.trade.result import CheckedRow, CheckFailed, CheckResult, Cost, TradeResult
from skinmap.commands.options import (
    open_robot,
    out_folder,
    outside_option,
    part_option,
    prints,
    seed_option,
)
from skinmap.commands.progress import progress
from skinmap.profile import read_profile
from skinmap.report.present import present
from skinmap.report.result import significant
from skinmap.report.table import Cell, Table
from skinmap.trade.points import describe
from skinmap.trade.profile_file import machine
from skinmap.trade.task import tasks

if TYPE_CHECKING:
    from skinmap.cli.trade.report import Traded
    from skinmap.trade.check import Checked
    from skinmap.trade.front import Budget
    from skinmap.trade.points import Failure
    from skinmap.trade.runner import Measured
    from skinmap.trade.task import TradeTask

ALL = "all"


@click.command("trade")
@click.argument("robot", default="icub", metavar="[ROBOT]")
@outside_option
@part_option
@click.option(
    "--task",
    "names",
    metavar="TASK",
    multiple=True,
    default=(ALL,),
    show_default=True,
    help="What to measure: flatten, classify, fidelity, calibrate, view, a plug-in, or all.",
)
@click.option(
    "--budget-ms",
    "budgets_ms",
    multiple=True,
    metavar="[TASK=]X",
    help="Recommend the most accurate setting that takes at most so long; may be repeated.",
)
@click.option(
    "--max-error",
    "max_errors",
    multiple=True,
    metavar="[TASK=]X",
    help="Recommend the fastest setting that errs at most so much, in the task's unit.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 1000),
    default=3,
    show_default=True,
    help="Repetitions, each with touches of its own.",
)
@out_folder("a plot a task, profile.toml and report.html")
@click.option(
    "--check",
    type=click.Path(path_type=Path),
    metavar="PROFILE",
    help="Measure a profile's settings again instead, beside what it predicts.",
)
@seed_option
@prints(TradeResult, check=CheckResult)
def command(
    robot: str,
    parts: tuple[str, ...],
    names: tuple[str, ...],
    budgets_ms: tuple[str, ...],
    max_errors: tuple[str, ...],
    seeds: int,
    out: Path | None,
    check: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Measure what each setting costs and how wrong it is, and recommend one for each task.

    A limit counts for every task measured, or for one: --budget-ms flatten=20. Without a limit
    the knee of the Pareto front is recommended. With --out the recommendation is written as
    profile.toml, which other commands take as --profile.

    \b
    Example:  skinmap trade icub --part right_forearm --out trade
              skinmap trade icub --part torso --task flatten --budget-ms 20 --json
              skinmap trade --check trade/profile.toml
    """
    if check is not None:
        _check(check, robot, parts, names, seed, seeds, as_json)
        return
    from skinmap.cli.trade.report import lines, report, result_of, write

    chosen, failures = _tasks(names)
    budgets = _budgets(chosen, budgets_ms, max_errors)
    traded = work(chosen, failures, budgets, robot, parts, range(seed, seed + seeds))
    present(
        result_of(traded, out),
        lambda _: lines(traded),
        as_json=as_json,
        out=out,
        write=lambda stage: write(traded, stage),
        page=lambda stage: report(traded, stage),
        number=significant,  # a touch may take 50 microseconds
    )


def work(
    tasks: Mapping[str, TradeTask],
    failures: Sequence[Failure],
    budgets: Mapping[str, Budget],
    robot: str,
    parts: tuple[str, ...],
    seeds: range,
) -> Traded:
    """Measure every setting of every task, and choose one of each.

    Raises
    ------
    SkinError
        Nothing could be measured, or no setting keeps a limit.
    """
    from skinmap.cli.trade.report import Traded
    from skinmap.trade.front import recommend
    from skinmap.trade.profile_file import Origin

    loaded, wanted = open_robot(robot, parts)
    measured = _measure(tasks, loaded, wanted, seeds, budgets)
    failed = [*failures, *(one for task in tasks for one in measured[task].failures)]
    found = {name: one.points for name, one in measured.items() if one.points}
    _refuse_nothing(found, failed)
    chosen = {name: recommend(points, budgets[name]) for name, points in found.items()}
    origin = Origin(robot, wanted, seeds.start, len(seeds))
    return Traded(tasks, found, failed, chosen, budgets, origin)


def _check(
    path: Path,
    robot: str,
    parts: tuple[str, ...],
    names: tuple[str, ...],
    seed: int,
    seeds: int,
    as_json: bool,
) -> None:
    """Check a profile; exits with 1 where it does not keep what it predicts."""
    writing = {"budgets_ms": "--budget-ms", "max_errors": "--max-error", "out": "--out"}
    for option in (option for name, option in writing.items() if given(name)):
        raise click.UsageError(f"--check recommends and writes nothing: it takes no {option}")
    only = None if ALL in names else names
    result = check_work(path, robot, parts, only, seed, seeds)
    present(result, check_lines, as_json=as_json, number=significant)
    if not result.within:
        click.get_current_context().exit(1)


def _tasks(names: tuple[str, ...]) -> tuple[dict[str, TradeTask], list[Any]]:
    """The tasks asked for by name, and plug-ins that do not load."""
    from importlib.metadata import entry_points

    from skinmap.profile import TASKS
    from skinmap.trade.points import Failure

    if ALL not in names:
        return {name: tasks.get(name) for name in dict.fromkeys(names)}, []
    known = tasks.names()
    lost = [point.name for point in entry_points(group=TASKS) if point.name not in known]
    failures = [Failure(name, None, "its plug-in does not load") for name in lost]
    return {name: tasks.get(name) for name in known}, failures


def _budgets(
    tasks: Mapping[str, TradeTask], budgets_ms: tuple[str, ...], max_errors: tuple[str, ...]
) -> dict[str, Budget]:
    from skinmap.trade.front import Budget

    times = _limits("--budget-ms", budgets_ms, tasks)
    errors = _limits("--max-error", max_errors, tasks, least=0.0)
    return {
        name: Budget(times[name] / 1e3 if name in times else None, errors.get(name))
        for name in tasks
    }


def _limits(
    option: str, words: tuple[str, ...], tasks: Mapping[str, TradeTask], least: float | None = None
) -> dict[str, float]:
    """The limit of each task; `TASK=X` wins over a bare X, wherever it stands."""
    from skinmap.errors import UnknownNameError

    common: dict[str, float] = {}
    own: dict[str, float] = {}
    for word in words:
        name, mark, number = word.rpartition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        fits = math.isfinite(value) and (value > 0 or value == least)
        if not fits:
            raise click.UsageError(f"{option} must be a number above 0, or TASK=X, got {word!r}")
        if mark and name not in tasks:
            raise UnknownNameError(f"task (of {option})", name, tasks)
        if mark:
            own[name] = value
        else:
            common = dict.fromkeys(tasks, value)
    return common | own


def _measure(
    tasks: Mapping[str, TradeTask],
    robot: Any,
    parts: tuple[str, ...],
    seeds: range,
    budgets: Mapping[str, Budget],
) -> dict[str, Measured]:
    from skinmap.trade.front import recommend
    from skinmap.trade.runner import measure, steps

    def measured(name: str, advance: Callable[[str], None]) -> Measured:
        return measure(
            tasks[name], robot, parts, seeds=seeds, progress=advance,
            choose=lambda points: recommend(points, budgets[name]),
        )  # fmt: skip

    total = sum(steps(_count(task), len(seeds)) for task in tasks.values())
    with progress(total, "trade") as advance:
        return {name: measured(name, advance) for name in tasks}


def _count(task: TradeTask) -> int:
    """How many settings a task has; 0 where it fails to say, which is reported later."""
    try:
        return len(task.settings())
    except Exception:  # noqa: BLE001 - a plug-in's fault, which the runner reports
        return 0


def _refuse_nothing(found: Mapping[str, Any], failures: list[Any]) -> None:
    """Stop where no task gave a single point."""
    if not found:
        from skinmap.errors import SkinError

        said = "; ".join(f"{one.task}: {one.reason}" for one in failures[:3])
        raise SkinError(f"nothing could be measured: {said}")


def check_work(
    path: Path,
    robot: str,
    parts: tuple[str, ...],
    names: tuple[str, ...] | None,
    seed: int,
    seeds: int,
) -> CheckResult:
    """Check a profile, on its own robot, parts, tasks and seeds where nothing else is given."""
    from skinmap.trade.check import check_profile
    from skinmap.trade.runner import steps

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


def check_lines(result: CheckResult) -> Iterator[str | Table]:
    """For people: measured beside predicted."""
    from skinmap.trade.check import ERROR_WITHIN, TIME_WITHIN

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

"""`skinmap trade`: speed against accuracy on a user's own skin and machine."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from skinmap import __version__
from skinmap.commands import options
from skinmap.commands.progress import progress
from skinmap.errors import SkinError, check_known
from skinmap.profile import FORMAT, PROFILE, Value
from skinmap.report.present import present
from skinmap.report.result import significant
from skinmap.report.table import Table
from skinmap.trade.measuring import (
    Point,
    Recommended,
    TaskRow,
    TradeResult,
    TradeTask,
    Unmeasured,
    chosen_of,
    defaults,
    describe,
    measure,
    pareto,
    points_by_time,
    recommend,
    trade_figure,
)

ALL = "all"


@click.command("trade")
@click.argument("robot", default="icub", metavar="[ROBOT]")
@options.part_option
@options.words(
    "--task", "names", "TASK", "Task to measure: flatten, classify, or all.", shown=(ALL,)
)
@options.number("--max-ms", 0.0, 1e8, "Limit of the time, instead of one sample of a stream.")
@options.whole("--seeds", 1, 1000, "Number of repetitions, each with its own touches.", shown=3)
@options.out_folder("a plot a task, profile.toml and report.html")
@options.prints(TradeResult)
def command(out: Path | None, as_json: bool, **asked: Any) -> None:
    """Measure the time and error of each setting, and recommend one for each task.

    Recommended is the least error within the time there is: one sample of a stream, or what the
    default takes where that is longer. It is never worse than the default unless a limit asks
    for that. With --out the recommendation is written as profile.toml, which other commands take
    as --profile.

    \b
    Example:  skinmap trade icub --part right_forearm --out trade
              skinmap trade icub --part torso --task flatten --max-ms 20 --json
    """
    result = work(**asked, profile=None if out is None else str(out / PROFILE))
    present(
        result,
        lines,
        as_json=as_json,
        out=out,
        write=lambda stage: write(result, stage),
        page=lambda stage: report(result, stage),
        number=significant,  # a touch may take 50 microseconds
    )


def work(
    robot: str,
    parts: tuple[str, ...],
    names: tuple[str, ...],
    max_ms: float | None,
    seeds: int,
    profile: str | None,
) -> TradeResult:
    """Measure every setting of every task, and choose one of each.

    Raises
    ------
    SkinError
        Nothing could be measured, or no setting keeps a limit.
    """
    chosen = _tasks(names)
    limit = None if max_ms is None else max_ms / 1e3
    loaded, wanted = options.open_robot(robot, parts)
    points: list[Point] = []
    failed: list[Unmeasured] = []
    recommended: dict[str, Recommended] = {}
    runs = seeds * sum(len(task.settings()) for task in chosen.values())
    with progress(runs, "trade") as advance:
        measured = {
            name: measure(task, loaded, wanted, seeds=range(seeds), progress=advance)
            for name, task in chosen.items()
        }
    for name, (own, unmeasured) in measured.items():
        failed += unmeasured
        points += [replace(one, pareto=on) for one, on in zip(own, pareto(own), strict=True)]
        if own:
            recommended[name] = _recommended(chosen[name], own, limit)
    if not points:
        said = "; ".join(f"{one.task}: {one.reason}" for one in failed[:3])
        raise SkinError(f"nothing could be measured: {said}")
    return TradeResult(
        robot=robot,
        parts=list(wanted),
        seed=0,
        seeds=seeds,
        tasks=[
            TaskRow(
                task=one.name, work=one.work, unit=one.unit, truth=one.truth, knobs=list(one.knobs)
            )
            for one in chosen.values()
        ],
        points=points,
        recommended=recommended,
        failed=failed,
        profile=profile,
    )


def _recommended(task: TradeTask, points: Sequence[Point], seconds: float | None) -> Recommended:
    one, why = recommend(points, defaults(task.knobs), seconds)
    return Recommended(
        setting=one.setting, seconds=one.seconds, error=one.error, unit=one.unit, why=why
    )


def every_task() -> dict[str, TradeTask]:
    """The tasks by name."""
    from skinmap.trade.tasks import classify_task, flatten_task

    return {"flatten": flatten_task, "classify": classify_task}


def _tasks(names: tuple[str, ...]) -> dict[str, TradeTask]:
    """The tasks asked for by name."""
    known = every_task()
    check_known("trade task", (name for name in names if name != ALL), known)
    return known if ALL in names else {name: known[name] for name in dict.fromkeys(names)}


def lines(result: TradeResult) -> Iterator[str | Table]:
    """For people: every setting by its time, the front and the recommendation marked."""
    for task in result.tasks:
        points = points_by_time(result, task.task)
        if not points:
            continue
        chosen = chosen_of(points, result.recommended[task.task])
        yield f"{task.task}: time of {task.work}; error in {task.unit}, {task.truth}"
        rows = [
            [
                number,
                "=>" if one is chosen else "*" if one.pareto else "",
                describe(one.setting),
                1e3 * one.seconds,
                None if one.seconds_spread is None else 1e3 * one.seconds_spread,
                one.error,
                one.error_spread,
            ]
            for number, one in enumerate(points, start=1)
        ]
        yield Table(["#", "", "setting", "ms", "±", task.unit, "±"], rows)
        why = result.recommended[task.task].why
        yield f"recommended ({why}): {describe(chosen.setting)}: {chosen.cost}\n"
    for lost in result.failed:
        where = "" if lost.setting is None else f" {describe(lost.setting)}"
        yield f"not measured: {lost.task}{where}: {lost.reason}"


def write(result: TradeResult, stage: Path) -> Iterator[str]:
    """Write a plot of each task and the profile into a folder; their names."""
    for task in result.tasks:
        if task.task in result.recommended:
            path = stage / f"{task.task}.png"
            trade_figure(result, task, path)
            yield path.name
    (stage / PROFILE).write_text(profile_text(result), encoding="utf-8")
    yield PROFILE


def report(result: TradeResult, stage: Path) -> str:
    """The page, with the plots that were written."""
    from skinmap.report.page import lines_page, media

    plots = [media(stage / f"{name}.png", name) for name in result.recommended]
    title = f"{Path(result.robot).name}: speed against accuracy"
    return lines_page(title, lines(result), plots)


def profile_text(result: TradeResult) -> str:
    """The profile as TOML: `[profile]`, then a table a task, each with its `predicted` figures."""
    head: dict[str, Value] = {
        "format": FORMAT,
        "skinmap": __version__,
        "robot": result.robot,
        "part": ",".join(result.parts),
        "machine": result.machine,
        "seed": result.seed,
        "seeds": result.seeds,
    }
    blocks: dict[str, Mapping[str, Value]] = {"profile": head}
    for task, one in result.recommended.items():
        blocks[task] = one.setting
        blocks[f"{task}.predicted"] = {
            "seconds": one.seconds, "error": one.error, "unit": one.unit
        }  # fmt: skip
    return "\n".join(
        "\n".join([f"[{name}]", *(f"{key} = {_toml(v)}" for key, v in block.items()), ""])
        for name, block in blocks.items()
    )


def _toml(value: Value) -> str:
    """One value; a JSON string is a TOML string, and so are numbers and booleans."""
    plain = significant(value) if isinstance(value, float) else value
    return json.dumps(plain, ensure_ascii=False)

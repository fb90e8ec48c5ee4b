"""What `skinmap trade` gives back: its result, words for people, plots, page and profile."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinmap.cli.trade.result import (
    FailedRow,
    KnobRow,
    PointRow,
    Recommended,
    TaskRow,
    TradeResult,
)
from skinmap.report.figure import plain_figure, save_figure
from skinmap.report.image import media
from skinmap.report.page import lines_page
from skinmap.report.table import Cell, Table
from skinmap.trade.front import Budget, pareto
from skinmap.trade.points import Failure, Point, describe
from skinmap.trade.profile_file import Origin, machine, write_profile
from skinmap.trade.task import TradeTask

PROFILE = "profile.toml"
BLUE, GREY, RED = "#1f5fa8", "#9aa7b5", "#c8372d"
DIM = "#5c6874"
WIDE = 20.0  # errors that differ by more than this factor are drawn on a logarithmic axis
SIZE = (12.5, 5.6)  # [inch]
ROWS = 24  # of the list at this height; more make the picture higher
COLUMNS = (0.0, 0.05, 0.88, 1.0)  # of the list: mark, number and setting, time, error
# Places of a number round its point [pt], nearest first.
OFFSETS = [
    (reach * x, reach * y)
    for reach in (8, 14, 20, 28, 38, 50)
    for x, y in ((0.7, 0.7), (0.7, -0.7), (-0.7, 0.7), (-0.7, -0.7), (0, 1), (0, -1), (1, 0))
]


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


def trade_figure(
    task: TradeTask, points: Sequence[Point], chosen: Point, origin: Origin, path: Path
) -> None:
    """Draw one task's settings as PNG: numbered points, and a list of them by their time."""
    order = sorted(range(len(points)), key=lambda number: points[number].seconds)
    marks = pareto(points)
    listed = [points[number] for number in order]
    front = [points[number] for number in order if marks[number]]
    rest = [points[number] for number in order if not marks[number]]
    width, height = SIZE
    figure = plain_figure((width, height * max(1.0, len(points) / ROWS)))
    axis, beside = figure.subplots(1, 2, width_ratios=[1.6, 1.0])
    _draw(axis, rest, color=GREY, markersize=4.5, label="other settings")
    axis.step(
        [1e3 * point.seconds for point in front],
        [point.error for point in front],
        where="post",
        color=BLUE,
        linewidth=1.3,
        alpha=0.7,
    )
    _draw(axis, front, color=BLUE, markersize=6, label="Pareto front")
    axis.plot(
        [1e3 * chosen.seconds], [chosen.error], "*", color=RED, markersize=16, zorder=4,
        label="recommended",
    )  # fmt: skip
    scale_axes(axis, points)
    axis.set_xlabel(f"CPU time: {task.work} [ms]")
    axis.set_ylabel(f"error [{task.unit}]")
    figure.suptitle(
        f"{task.name}: {Path(origin.robot).name} {', '.join(origin.parts)}, "
        f"{origin.seeds} seed{'s' if origin.seeds > 1 else ''}; bars: standard deviation\n"
        f"error: {task.truth}",
        fontsize=10,
    )
    axis.grid(True, which="major", color="#e6e9ed", linewidth=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    _list(beside, task, listed, front, chosen)
    number_points(figure, axis, listed, front, chosen)
    save_figure(figure, path)


def _list(
    axis: Any, task: TradeTask, listed: Sequence[Point], front: Sequence[Point], chosen: Point
) -> None:
    """The settings in words beside the plot, with their figures."""
    axis.set_axis_off()
    rows = max(len(listed), ROWS)
    common = _common(listed)

    def write(row: int, column: int, text: str, **style: Any) -> None:
        align = "right" if column >= 2 else "left"
        axis.text(
            COLUMNS[column], 1.0 - row / (rows + 1), text, transform=axis.transAxes, fontsize=8,
            ha=align, va="top", **style,
        )  # fmt: skip

    write(0, 1, "setting" + (f" ({describe(common)})" if common else ""), color=DIM)
    write(0, 2, "ms", color=DIM)
    write(0, 3, task.unit, color=DIM)
    for row, point in enumerate(listed, start=1):
        on = point in front
        colour = RED if point is chosen else BLUE if on else DIM
        words = describe({k: v for k, v in point.setting.items() if k not in common})
        style = {"color": colour, "weight": "bold" if point is chosen else "normal"}
        write(row, 0, f"{row}", **style)
        write(row, 1, words if point.setting else point.words, **style)
        write(row, 2, f"{1e3 * point.seconds:.3g}", **style)
        write(row, 3, f"{point.error:.3g}", **style)


def _common(points: Sequence[Point]) -> dict[str, Any]:
    """Knobs that stand at one value in all settings, where others tell these apart."""
    first = points[0].setting
    same = {k: v for k, v in first.items() if all(p.setting.get(k) == v for p in points)}
    return same if all(len(p.setting) > len(same) for p in points) else {}


def _draw(axis: Any, points: Sequence[Point], **style: Any) -> None:
    if points:
        _, _, bars = axis.errorbar(
            [1e3 * point.seconds for point in points],
            [point.error for point in points],
            xerr=[1e3 * min(point.seconds_spread, 0.9 * point.seconds) for point in points],
            yerr=[
                [min(point.error_spread, point.error) for point in points],
                [point.error_spread for point in points],
            ],
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
        most = max(p.error + p.error_spread for p in points) or 1.0
        axis.set_ylim(-0.05 * most, 1.12 * most)


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


def number_points(
    figure: Any, axis: Any, points: Sequence[Point], front: Sequence[Point], chosen: Point
) -> list[Any]:
    """Write each point's number beside it, where it covers no other number and no point."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # the layout is known only now
    renderer = canvas.get_renderer()
    dots = axis.transData.transform([(1e3 * point.seconds, point.error) for point in points])
    sides = [11 if point is chosen else 5 for point in points]  # the star is larger [px]
    taken = [
        Bbox.from_bounds(x - side, y - side, 2 * side, 2 * side)
        for (x, y), side in zip(dots, sides, strict=True)
    ]
    inside = axis.get_window_extent(renderer)
    notes = []

    def extent(note: Any) -> Any:
        note.update_positions(renderer)
        return Text.get_window_extent(note, renderer)  # of the words, without the line

    def cost(note: Any, offset: tuple[float, float]) -> float:
        """How many numbers and points the text would cover there; much more outside the axes."""
        note.set_position(offset)
        box = extent(note)
        out = box.x0 < inside.x0 or box.x1 > inside.x1 or box.y0 < inside.y0 or box.y1 > inside.y1
        return sum(box.overlaps(other) for other in taken) + 100.0 * out

    for number, point in enumerate(points, start=1):
        note = _number(axis, point, number, BLUE if point in front else DIM)
        costs = [cost(note, offset) for offset in OFFSETS]
        note.set_position(OFFSETS[costs.index(min(costs))])
        taken.append(extent(note))
        notes.append(note)
    return notes


def _number(axis: Any, point: Point, number: int, colour: str) -> Any:
    """A point's number in the list, wherever it will stand."""
    note = axis.annotate(
        str(number),
        (1e3 * point.seconds, point.error),
        xytext=(0.0, 0.0),
        textcoords="offset points",
        fontsize=7.5,
        color=colour,
        ha="center",
        va="center",
        arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.5, "shrinkB": 4},
        zorder=5,
    )
    note.set_in_layout(False)
    return note

"""The plot of a trade task: every setting by time and error, the front, the recommendation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skinmap.cli.figures import plain_figure, save_figure
from skinmap.trade.front import pareto
from skinmap.trade.points import Point
from skinmap.trade.profile_file import Origin
from skinmap.trade.task import TradeTask

BLUE, GREY, RED = "#1f5fa8", "#9aa7b5", "#c8372d"
INK, DIM = "#202830", "#707c88"
WIDE = 20.0  # errors that differ by more than this factor are drawn on a logarithmic axis
NEAR = 12  # of the places below: where a label that is not needed may stand
# Places of a label round its point [pt], nearest first.
OFFSETS = [
    (reach * x, reach * y)
    for reach in (9, 18, 30, 45, 65)
    for x, y in ((1, 0.7), (1, -0.7), (-1, 0.7), (-1, -0.7), (0, 1.3), (0, -1.3))
]


def trade_figure(
    task: TradeTask, points: Sequence[Point], chosen: Point, origin: Origin, path: Path
) -> None:
    """Draw one task's settings as PNG."""
    figure = plain_figure((9.0, 5.4))
    axis = figure.subplots()
    marks = pareto(points)
    front = sorted(
        (point for point, on in zip(points, marks, strict=True) if on),
        key=lambda point: (point.seconds, -point.error),
    )
    rest = [point for point, on in zip(points, marks, strict=True) if not on]
    _draw(axis, rest, fmt="o", color=GREY, markersize=5, label="other settings")
    axis.step(
        [1e3 * point.seconds for point in front],
        [point.error for point in front],
        where="post",
        color=BLUE,
        linewidth=1.2,
        alpha=0.6,
    )
    _draw(axis, front, fmt="o", color=BLUE, markersize=6, label="Pareto front")
    axis.plot(
        [1e3 * chosen.seconds],
        [chosen.error],
        "*",
        color=RED,
        markersize=17,
        zorder=4,
        label=f"recommended: {1e3 * chosen.seconds:.3g} ms, {chosen.error:.3g} {task.unit}",
    )
    _scales(axis, points)
    axis.set_xlabel(f"CPU time: {task.work} [ms]")
    axis.set_ylabel(f"error [{task.unit}]")
    axis.set_title(
        f"{task.name}: {Path(origin.robot).name} {', '.join(origin.parts)}, "
        f"{origin.seeds} seed{'s' if origin.seeds > 1 else ''} (bars: spread)\n"
        f"error: {task.truth}",
        fontsize=9,
    )
    axis.grid(True, which="both", color="#e6e9ed", linewidth=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    named = [chosen, *(point for point in front if point is not chosen)]
    label_points(figure, axis, [*named, *rest], len(named))
    save_figure(figure, path)


def _draw(axis: Any, points: Sequence[Point], *, fmt: str, **style: Any) -> None:
    if points:
        axis.errorbar(
            [1e3 * point.seconds for point in points],
            [point.error for point in points],
            xerr=[1e3 * min(point.seconds_spread, 0.9 * point.seconds) for point in points],
            yerr=[
                [min(point.error_spread, point.error) for point in points],
                [point.error_spread for point in points],
            ],
            fmt=fmt,
            elinewidth=0.6,
            **style,
        )


def _scales(axis: Any, points: Sequence[Point]) -> None:
    """A logarithmic axis of time, and of errors that differ much; room for labels."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    low, high = min(p.seconds for p in points) * 1e3, max(p.seconds for p in points) * 1e3
    axis.set_xscale("log")
    axis.set_xlim(low / (1.35 * (high / low) ** 0.12), high * 1.35 * (high / low) ** 0.12)
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    errors = [point.error for point in points]
    if min(errors) > 0 and max(errors) > WIDE * min(errors):
        axis.set_yscale("log")
        axis.set_ylim(min(errors) / 2.0, max(errors) * 2.0)
    else:
        most = max(p.error + p.error_spread for p in points) or 1.0
        axis.set_ylim(-0.05 * most, 1.12 * most)


def label_points(figure: Any, axis: Any, points: Sequence[Point], needed: int) -> None:
    """Name points with text that covers no other text and no point, with a line to each.

    The first `needed` are named in any case; others in grey, and only where there is room.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # the layout is known only now
    renderer = canvas.get_renderer()
    dots = axis.transData.transform([(1e3 * point.seconds, point.error) for point in points])
    taken = [Bbox.from_bounds(x - 5, y - 5, 10, 10) for x, y in dots]
    inside = axis.get_window_extent(renderer)

    def extent(note: Any) -> Any:
        note.update_positions(renderer)
        return Text.get_window_extent(note, renderer)  # of the words, without the line

    def cost(note: Any, offset: tuple[float, float]) -> float:
        """How many labels and points the text would cover there; much more outside the axes."""
        _move(note, offset)
        box = extent(note)
        out = box.x0 < inside.x0 or box.x1 > inside.x1 or box.y0 < inside.y0 or box.y1 > inside.y1
        return sum(box.overlaps(other) for other in taken) + 100.0 * out

    for number, point in enumerate(points):
        note = _label(axis, point, INK if number < needed else DIM)
        costs = [cost(note, offset) for offset in OFFSETS[: None if number < needed else NEAR]]
        if number >= needed and min(costs) > 0:
            note.remove()
            continue
        _move(note, OFFSETS[costs.index(min(costs))])
        taken.append(extent(note))


def _label(axis: Any, point: Point, colour: str) -> Any:
    """A point's setting in words, wherever it will stand."""
    note = axis.annotate(
        point.words,
        (1e3 * point.seconds, point.error),
        xytext=(0.0, 0.0),
        textcoords="offset points",
        fontsize=7.5 if colour == INK else 6.5,
        color=colour,
        bbox={"boxstyle": "square,pad=0.1", "facecolor": (1, 1, 1, 0.75), "edgecolor": "none"},
        arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.6},
        zorder=5,
    )
    note.set_in_layout(False)
    return note


def _move(note: Any, offset: tuple[float, float]) -> None:
    """Put a label beside its point, growing away from it."""
    note.set_position(offset)
    note.set_horizontalalignment(
        "left" if offset[0] > 0 else "right" if offset[0] < 0 else "center"
    )
    note.set_verticalalignment("bottom" if offset[1] > 0 else "top")

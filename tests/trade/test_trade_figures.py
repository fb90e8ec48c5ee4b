"""The plot of a trade task: ticks as people write them."""

from __future__ import annotations

import pytest

from skinmap.report.page import plain_figure
from skinmap.trade import Point
from skinmap.trade.measuring import scale_axes


def point(milliseconds: float, error: float) -> Point:
    return Point(
        task="toy", setting={"level": milliseconds}, seconds=1e-3 * milliseconds, error=error,
        unit="%", pareto=error < 0.865,
    )  # fmt: skip


def axis_of(points: list[Point]):
    figure = plain_figure((7.0, 5.0))
    axis = figure.subplots()
    scale_axes(axis, points)
    return figure, axis


@pytest.mark.parametrize(
    ("times", "errors"),
    [((0.2, 15), (3, 30)), ((4.4, 5.0), (0, 15)), ((17, 300), (0.01, 2)), ((1, 1), (1, 1))],
)
def test_ticks_are_plain_numbers_and_several(times, errors):
    points = [point(*pair) for pair in zip(times, errors, strict=True)]
    figure, axis = axis_of(points)
    figure.canvas.draw()
    low, high = axis.get_xlim()
    shown = [float(label.get_text()) for label in axis.get_xticklabels()]  # else a ValueError
    assert sum(low <= tick <= high for tick in shown) >= 3
    if axis.get_yscale() == "log":
        assert [float(label.get_text()) for label in axis.get_yticklabels()]

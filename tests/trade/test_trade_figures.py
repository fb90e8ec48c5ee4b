"""The plot of a trade task: numbers that cover nothing, and ticks as people write them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.text import Text

from skinmap.report.image import plain_figure
from skinmap.trade import Point
from skinmap.trade.front import number_points, scale_axes


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


def test_numbers_of_crowded_points_cover_neither_each_other_nor_a_point_nor_the_border():
    rng = np.random.default_rng(1)
    crowd = [point(20 + 8 * x, 0.86 + 0.01 * y) for x, y in rng.random((10, 2))]
    points = [*crowd, point(300, 0.85), point(17, 2.1)]
    figure, axis = axis_of(points)
    notes = number_points(figure, axis, points, crowd[0])
    assert [note.get_text() for note in notes] == [str(n) for n in range(1, len(points) + 1)]
    renderer = figure.canvas.get_renderer()
    boxes = [Text.get_window_extent(note, renderer) for note in notes]
    dots = axis.transData.transform([(1e3 * one.seconds, one.error) for one in points])
    inside = axis.get_window_extent(renderer)
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)
    for box in boxes:
        assert not any(box.contains(*dot) for dot in dots)
        assert inside.x0 <= box.x0 < box.x1 <= inside.x1
        assert inside.y0 <= box.y0 < box.y1 <= inside.y1


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

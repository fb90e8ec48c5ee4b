"""Charts side by side at one scale, each turned so that one direction on the body is up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinmap.arrays import FloatArray


def upright(uv: FloatArray, height: FloatArray) -> FloatArray:
    """Coordinates (n, 2) turned so that the values `height` (n,) [m] grow upwards on average."""
    centred = uv - uv.mean(axis=0)
    gradient, *_ = np.linalg.lstsq(centred, height - height.mean(), rcond=None)
    length = float(np.linalg.norm(gradient))
    if length == 0.0:
        return np.asarray(centred)
    c, s = gradient[1] / length, gradient[0] / length
    return np.asarray(centred @ np.array([[c, s], [-s, c]]))


def pack(charts: Sequence[FloatArray], gap: float) -> list[FloatArray]:
    """Charts in shelves of about equal width, the tallest first, `gap` [m] between them."""
    sizes = [np.ptp(chart, axis=0) for chart in charts]
    area = sum((size[0] + gap) * (size[1] + gap) for size in sizes)
    width = max(1.3 * np.sqrt(area), max(size[0] for size in sizes))
    placed: list[FloatArray] = [np.zeros((0, 2))] * len(charts)
    x, top, shelf = 0.0, 0.0, 0.0
    for i in sorted(range(len(charts)), key=lambda k: (-sizes[k][1], k)):
        if x > 0 and x + sizes[i][0] > width:
            x, top, shelf = 0.0, top - shelf - gap, 0.0
        corner = charts[i].min(axis=0) + np.array([0.0, sizes[i][1]])
        placed[i] = charts[i] - corner + np.array([x, top])
        x, shelf = x + sizes[i][0] + gap, max(shelf, float(sizes[i][1]))
    return placed

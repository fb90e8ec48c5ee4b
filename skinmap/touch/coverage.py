"""How much of a touch lies over taxels: both are laid on one grid and counted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.touch.gestures import Pad

COARSE, FINE = 3e-3, 1.5e-3  # between the points of the grid [m]
SLENDER = 4e-3  # radius of a pad up to which the fine grid is needed [m]


def covered_share(pads: Sequence[Pad], uv: FloatArray, spacing: float) -> float:
    """Share of the pads' area that lies within one spacing of a taxel.

    Parameters
    ----------
    pads : sequence of Pad
    uv : (n, 2) float
        Taxels in the plane of the pads, NaN where the map does not reach [m].
    spacing : float
        Of the taxels [m].

    Returns
    -------
    float
        0 to 1; 1 for pads too small for a point of the grid.
    """
    step = COARSE if min(pad.radius for pad in pads) > SLENDER else FINE
    ends = np.array([[pad.start, pad.end] for pad in pads])
    radii = np.array([pad.radius for pad in pads])
    low = ends.min(axis=(0, 1)) - radii.max()
    high = ends.max(axis=(0, 1)) + radii.max()
    x, y = (np.arange(a, b + step, step) for a, b in zip(low, high, strict=True))
    first = ((ends.min(axis=1) - radii[:, None] - low) / step).astype(np.int64)
    last = ((ends.max(axis=1) + radii[:, None] - low) / step).astype(np.int64) + 2
    under = np.zeros((len(x), len(y)), bool)
    for pad, (i, j), (k, m) in zip(pads, first.tolist(), last.tolist(), strict=True):
        under[i:k, j:m] |= _inside(pad, x[i:k], y[j:m])
    touched = int(np.count_nonzero(under))
    if touched == 0:
        return 1.0
    return int(np.count_nonzero(under & _over_taxels(x, y, step, uv, spacing))) / touched


def _inside(pad: Pad, x: FloatArray, y: FloatArray) -> BoolArray:
    """(i, j) whether points of a grid lie inside a pad, as `Pad.depth` has it."""
    (start_x, start_y), (end_x, end_y) = pad.start, pad.end
    axis_x, axis_y = end_x - start_x, end_y - start_y
    away_x, away_y = (x - start_x)[:, None], (y - start_y)[None, :]
    length = axis_x * axis_x + axis_y * axis_y
    if length > 0:
        along = (away_x * axis_x + away_y * axis_y) / length
        along = np.minimum(np.maximum(along, 0.0), 1.0)
        away_x, away_y = away_x - along * axis_x, away_y - along * axis_y
    return np.asarray(np.sqrt(away_x * away_x + away_y * away_y) / pad.radius < 1.0)


def _over_taxels(
    x: FloatArray, y: FloatArray, step: float, uv: FloatArray, spacing: float
) -> BoolArray:
    """(i, j) which points of a grid lie within one spacing of a taxel (n, 2)."""
    over = np.zeros((len(x), len(y)), bool)
    reach = int(np.ceil(spacing / step))
    rows, away_x = _around(x, step, uv[:, 0], reach)
    columns, away_y = _around(y, step, uv[:, 1], reach)
    near = (rows >= 0).any(axis=1) & (columns >= 0).any(axis=1)
    rows, columns = rows[near], columns[near]
    inside = away_x[near][:, :, None] + away_y[near][:, None, :] < spacing * spacing
    inside &= (rows >= 0)[:, :, None] & (columns >= 0)[:, None, :]
    taxel, i, j = np.nonzero(inside)
    over[rows[taxel, i], columns[taxel, j]] = True
    return over


def _around(
    line: FloatArray, step: float, at: FloatArray, reach: int
) -> tuple[IntArray, FloatArray]:
    """The points (n, r) of an axis next to each place (n,), -1 beyond it, and how far, squared."""
    before = np.floor((np.where(np.isfinite(at), at, np.inf) - line[0]) / step)
    before = np.clip(before, -reach - 2, len(line) + reach).astype(np.int64)
    index = before[:, None] + np.arange(-reach, reach + 2)
    outside = (index < 0) | (index >= len(line))
    away = line[np.clip(index, 0, len(line) - 1)] - at[:, None]
    return np.where(outside, -1, index), away * away

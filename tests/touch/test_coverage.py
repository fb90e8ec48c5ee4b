from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from skinmap.touch.simulation.gestures import GESTURES, Pad
from skinmap.touch.simulation.simulator import covered_share


def plainly(pads, uv, spacing):
    """The same share by asking every point of the grid for its depth and its nearest taxel."""
    step = 3e-3 if min(pad.radius for pad in pads) > 4e-3 else 1.5e-3
    corners = np.array([[pad.start, pad.end] for pad in pads]).reshape(-1, 2)
    reach = max(pad.radius for pad in pads)
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    lines = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*lines), -1).reshape(-1, 2)
    covered = grid[np.max([pad.depth(grid) for pad in pads], axis=0) > 0]
    taxels = uv[np.isfinite(uv[:, 0])]
    distance, _ = cKDTree(taxels).query(covered, distance_upper_bound=spacing)
    return float(np.isfinite(distance).mean())


@pytest.mark.parametrize("name", GESTURES)
def test_covered_share_is_that_of_every_point_asked(name, rng):
    shares = []
    for _ in range(25):
        pads = GESTURES[name](rng, 0.9)
        uv = rng.uniform(-0.08, 0.08, (int(rng.integers(1, 300)), 2))
        uv[rng.random(len(uv)) < 0.2] = np.nan
        uv[0] = 0.0
        spacing = rng.uniform(2e-3, 8e-3)
        shares.append(plainly(pads, uv, spacing))
        # Both count the same points: places are refused or taken by this to the last bit.
        assert covered_share(pads, uv, spacing) == shares[-1]
    assert 0.0 < np.mean(shares) < 1.0


def test_covered_share_of_far_taxels_is_none(rng):
    pad = Pad((0.0, 0.0), (0.01, 0.0), 6e-3, 1.0)
    assert covered_share([pad], np.array([[0.5, 0.0], [-3e6, 2.0]]), 5e-3) == 0.0


def test_a_pad_between_the_points_of_the_grid_is_covered():
    speck = Pad((0.0, 0.0), (0.0, 0.0), 1e-4, 1.0)
    assert covered_share([speck], np.zeros((1, 2)), 5e-3) == 1.0

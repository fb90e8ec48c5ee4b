"""Flat tilings of modules and their neighbourhoods."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.neighbours.offsets import neighbourhoods
from skinmap.skin.modules import module_layout, taxel_table, triangle_sheet


@pytest.fixture(scope="session")
def tiling():
    """A function: taxels (n, 3) [m] of a flat sheet of 6 rows of 12 modules of a layout."""

    def make(name: str, side: float | None = None) -> np.ndarray:
        layout = module_layout(name)
        centres, angles = triangle_sheet([(0, 12)] * 6, side or layout.side)
        poses = np.tile(np.eye(4), (len(centres), 1, 1))
        poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angles)
        poses[:, 1, 0], poses[:, 0, 1] = np.sin(angles), -np.sin(angles)
        poses[:, :2, 3] = centres
        return taxel_table(poses, layout).positions

    return make


@pytest.fixture(scope="session")
def flat_hoods():
    """A function: neighbourhoods of taxels (n, 3) in the plane z = 0."""

    def make(points, radius=8e-3, band=0.8e-3):
        up = np.tile([0.0, 0, 1], (len(points), 1))
        reference = np.tile([0.0, 1, 0], (len(points), 1))
        return neighbourhoods(points, up, reference, radius=radius, band=band)

    return make

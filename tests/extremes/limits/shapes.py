"""Surfaces, skins and pressures that the laws are measured on."""

from __future__ import annotations

from functools import cache

import numpy as np

from skinmap.skin.skin import Skin, skin_from_points
from skinmap.touch.prepared_skin import PreparedSkin

PITCH = 6.5e-3


def dome(n: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """A grid bent over a shallow dome: n x n vertices, about one unit wide."""
    row, column = np.divmod(np.arange(n * n), n)
    x, y = column / (n - 1), row / (n - 1)
    vertices = np.column_stack([x, y, 0.3 * np.sin(np.pi * x) * np.sin(np.pi * y)])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + n])
    upper = np.column_stack([corner + 1, corner + n + 1, corner + n])
    return vertices, np.concatenate([lower, upper])


def lattice(rows: int = 12, columns: int = 12) -> np.ndarray:
    """Hexagons 6.5 mm apart, bent round a cylinder of 60 mm: (n, 3) [m]."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    flat = PITCH * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)])
    angle = flat[:, 0] / 60e-3
    return np.column_stack([60e-3 * np.sin(angle), flat[:, 1], 60e-3 * (np.cos(angle) - 1)])


def normals(rows: int = 12, columns: int = 12) -> np.ndarray:
    row, column = np.divmod(np.arange(rows * columns), columns)
    angle = PITCH * (column + 0.5 * (row % 2)) / 60e-3
    return np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])


def bent_skin(rows: int = 12, columns: int = 12, *, scale: float = 1.0, offset: float = 0.0,
              noise: float = 0.0, keep: np.ndarray | None = None) -> Skin:  # fmt: skip
    """The lattice as a skin; noise is a share of the pitch, `keep` the rows that are there."""
    points = lattice(rows, columns)
    points = points + noise * PITCH * np.random.default_rng(1).normal(size=points.shape)
    keep = np.ones(len(points), bool) if keep is None else keep
    return skin_from_points(scale * points[keep] + offset, normals(rows, columns)[keep])


def with_holes(modules: int) -> np.ndarray:
    """(400,) which taxels of 20 x 20 are there: blocks of nine are missing from the middle."""
    row, column = np.divmod(np.arange(400), 20)
    keep = np.ones(400, bool)
    for k in range(modules):
        top, left = 3 + 6 * (k // 3), 2 + 6 * (k % 3)
        keep &= ~((abs(row - top) < 2) & (abs(column - left) < 2))
    return keep


@cache
def prepared() -> PreparedSkin:
    return PreparedSkin(bent_skin())


def press(row: int = 78, peak: float = 200.0) -> np.ndarray:
    """Pressures (144,) of a finger on one taxel."""
    gap = np.linalg.norm(lattice() - lattice()[row], axis=1)
    return peak * np.exp(-0.5 * (gap / 9e-3) ** 2)

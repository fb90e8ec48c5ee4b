"""What a touch of skin sends: chances of an answer's size where one is expected.

Shared by what judges answers (`evidence`) and what chooses the next place (`places`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from calibration.wiring.boards import Boards
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.triangles import unit

PLACE = 4e-3  # error of a person's place, standard deviation an axis [m]
THRESHOLD = 12.0  # counts above rest that are an answer, as `ACTIVE` of `skinmap.touch`
SPIKE, DEAD = 0.004, 0.03  # chances that an untouched channel answers and a touched one does not
SPREAD = 0.6  # of the logarithm of an answer: gains of 15 to 40 %, and the model's own error
TIMING = 0.12  # error of when a stroke comes by, in its duration
SHAPES = ((4.5e-3, 80.0), (6e-3, 50.0), (6e-3, 150.0), (8.5e-3, 200.0))  # width [m], force [counts]
NEAR = 32e-3  # sites further from a touch do not answer [m]
LEVELS = 9  # of an answer: none, and eight from the threshold to 255 counts
STEPS = 48  # of an expected answer, logarithmic
LOWEST = 1.0  # expected answers below are none [counts]


def _table() -> FloatArray:
    """(LEVELS, STEPS + 1) log chance of each level for each expected answer, none first."""
    edges = np.geomspace(THRESHOLD, 255.0, LEVELS)
    log_edges = np.log(edges)
    expected = np.concatenate([[1e-6], np.geomspace(LOWEST, 400.0, STEPS)])
    z = (log_edges[:, None] - np.log(expected)[None]) / SPREAD
    below = ndtr(z)
    inside = np.diff(below, axis=0)
    inside[-1] += 1.0 - below[-1]  # saturated
    felt = (1.0 - DEAD) * inside + SPIKE / (LEVELS - 1)
    none = 1.0 - felt.sum(axis=0)
    return np.log(np.maximum(np.vstack([none[None], felt]), 1e-12)).astype(np.float32)


TABLE = _table()
STEP = np.log(400.0 / LOWEST) / (STEPS - 1)


def level_of(response: FloatArray) -> IntArray:
    """(n,) level of each answer; 0 for none."""
    size = np.log(np.maximum(response, THRESHOLD) / THRESHOLD) / np.log(255.0 / THRESHOLD)
    level = 1 + np.floor(size * (LEVELS - 1)).astype(np.int64)
    return np.asarray(np.where(response < THRESHOLD, 0, np.minimum(level, LEVELS - 1)))


def step_of(log_expected: FloatArray) -> IntArray:
    """Column of `TABLE` for logarithms of expected answers [counts]; NaN is none."""
    step = (log_expected - np.float32(np.log(LOWEST))) * np.float32(1.0 / STEP) + 1.5
    return np.asarray(np.fmin(np.fmax(step, 0.0), STEPS), np.int16)  # fmax: NaN is none


def steps_at(square: FloatArray, shapes: Sequence[tuple[float, float]]) -> IntArray:
    """(s, ...) columns of `TABLE` at squared distances (...) [m2] from touches of some shapes."""
    width, force = np.array(shapes, square.dtype).T.reshape(2, -1, *[1] * square.ndim)
    return step_of(np.log(force) - 0.5 * (square / width**2))


def offsets() -> tuple[FloatArray, FloatArray]:
    """(o, 2) errors of a place on a grid and their log chances."""
    steps = 5e-3 * np.arange(-3, 4)
    grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    grid = grid[np.linalg.norm(grid, axis=1) < 14.5e-3]
    weight = -0.5 * (grid**2).sum(axis=1) / PLACE**2
    return grid, weight - np.log(np.exp(weight).sum())


def tangents(boards: Boards, place: FloatArray) -> FloatArray:
    """(2, 3) directions along the skin at a place (3,)."""
    nearest = int(np.argmin(np.linalg.norm(boards.table.positions - place, axis=1)))
    return tangent_frames(boards.normals[nearest])


def sideways(boards: Boards, path: FloatArray) -> FloatArray:
    """(3,) direction along the skin across a stroke (p, 3)."""
    normal = np.cross(*tangents(boards, path[len(path) // 2]))
    return unit(np.cross(normal, unit(path[-1] - path[0])))

"""How well a poke tells a board laid otherwise: by all that answers, not by its place alone.

A module alone cannot say whether its board is turned or the finger was off to a side. Its
neighbours can, as they answer the same finger; so the error of the place is summed over jointly for
all modules that a poke lights, and places where several modules meet tell most.
"""

from __future__ import annotations

import numpy as np

from calibration.wiring.boards import Boards
from calibration.wiring.evidence import NEAR, TABLE, _offsets, step_of
from skinmap.arrays import FloatArray
from skinmap.geometry.triangles import unit

SHAPES = ((6e-3, 50.0), (6e-3, 150.0))  # width [m] and force [counts] of the pokes reckoned with
DIMENSIONS = 4  # that the overlaps of answers are laid out in


def _layout() -> FloatArray:
    """(STEPS + 1, d) points whose squared distances are -log of the overlaps of two answers.

    Torgerson's classical scaling; then the overlap of many answers is one matrix product.
    """
    chance = np.exp(TABLE.astype(np.float64))
    square = -np.log(np.minimum(np.sqrt(chance).T @ np.sqrt(chance), 1.0))
    centred = square - square.mean(axis=0) - square.mean(axis=1)[:, None] + square.mean()
    values, vectors = np.linalg.eigh(-0.5 * centred)
    top = np.argsort(-values)[:DIMENSIONS]
    return np.asarray(vectors[:, top] * np.sqrt(np.maximum(values[top], 0.0)), np.float32)


POINTS = _layout()


def tangents(boards: Boards, place: FloatArray) -> FloatArray:
    """(2, 3) directions along the skin at a place (3,)."""
    nearest = int(np.argmin(np.linalg.norm(boards.table.positions - place, axis=1)))
    out = boards.normals[nearest]
    first = unit(np.cross(out, np.eye(3)[np.argmin(np.abs(out))])[None])[0]
    return np.stack([first, np.cross(out, first)])


def telling(boards: Boards, places: FloatArray, most: float) -> FloatArray:
    """(c, 5, m) evidence that pokes at places (c, 3) bring where a site's board is laid otherwise.

    The elements are those of `boards.ELEMENTS` but the first. In nats, at most `most`, in the mean
    over where the finger really was.
    """
    found = np.zeros((len(places), 5, len(boards)))
    grid, log_weight = _offsets()
    shapes = np.array(SHAPES)
    weight = np.tile(np.exp(log_weight), len(shapes)) / len(shapes)
    for row, place in enumerate(places):
        near = np.flatnonzero(np.linalg.norm(boards.centres - place, axis=1) < NEAR)
        if len(near) == 0:
            continue
        points = place + grid @ tangents(boards, place)
        gap = boards.places[near][None] - points[:, None, None, None]  # (o, b, 6, k, 3)
        square = (gap**2).sum(axis=-1)
        size = np.log(shapes[:, 1])[:, None, None, None, None] - 0.5 * (
            square[None] / (shapes[:, 0] ** 2)[:, None, None, None, None]
        )
        laid = POINTS[step_of(size)]  # (s, o, b, 6, k, d)
        laid = laid * (boards.columns[near] >= 0)[:, None, :, None]
        q = len(weight)
        laid = laid.reshape(q, len(near), 6, -1).transpose(1, 2, 0, 3)  # (b, 6, q, k d)
        norm = (laid**2).sum(axis=-1)
        cross = laid @ laid[:, :1].transpose(0, 1, 3, 2)
        apart = norm[..., None] + norm[:, :1, None, :] - 2.0 * cross  # (b, 6, q, q)
        whole = apart[:, 0].sum(axis=0)
        rest = whole - apart[:, 0]
        own = -np.log(np.exp(-whole) @ weight)
        other = -np.log(np.exp(-(rest[:, None] + apart[:, 1:])) @ weight + 1e-30)  # (b, 5, q)
        found[row][:, near] = (np.clip(2.0 * (other - own), 0.0, most) @ weight).T
    return found

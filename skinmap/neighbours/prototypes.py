"""Prototypes: the shapes that neighbourhoods are compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray, freeze
from skinmap.neighbours.offsets import Neighbourhoods


@dataclass(frozen=True, eq=False, slots=True)
class Prototypes:
    """The shapes of s structures, padded to k places.

    Attributes
    ----------
    offsets : (s, k, 2) float
        Clockwise from twelve o'clock [m].
    filled, required : (s, k) bool
        Which places hold a point (the first ones), and which of those every member must have.
    tolerance : float
        [m].
    rotations : int
        Rotations that a member may have: 1 or the symmetry of the lattice.
    """

    offsets: FloatArray
    filled: BoolArray
    required: BoolArray
    tolerance: float
    rotations: int

    def __post_init__(self) -> None:
        freeze(self, offsets=self.offsets, filled=self.filled, required=self.required)

    def __len__(self) -> int:
        return len(self.offsets)

    def take(self, chosen: IntArray) -> Prototypes:
        """Some of the prototypes, in the order asked for."""
        return Prototypes(
            self.offsets[chosen],
            self.filled[chosen],
            self.required[chosen],
            self.tolerance,
            self.rotations,
        )

    def joined(self, other: Prototypes) -> Prototypes:
        """These and others of the same tolerance, rotations and number of places."""
        return Prototypes(
            np.concatenate([self.offsets, other.offsets]),
            np.concatenate([self.filled, other.filled]),
            np.concatenate([self.required, other.required]),
            self.tolerance,
            self.rotations,
        )


def as_prototypes(
    hoods: Neighbourhoods, rows: IntArray, *, tolerance: float, rotations: int
) -> Prototypes:
    """Some neighbourhoods as prototypes, their points clockwise from twelve o'clock."""
    offsets, filled, required = hoods.offsets[rows], hoods.filled[rows], hoods.required[rows]
    order = clockwise(offsets, filled)
    return Prototypes(
        np.take_along_axis(offsets, order[..., None], 1),
        np.take_along_axis(filled, order, 1),
        np.take_along_axis(required, order, 1),
        tolerance,
        rotations,
    )


def clockwise(offsets: FloatArray, filled: BoolArray) -> IntArray:
    """(s, k) order of places clockwise from twelve o'clock, empty ones last."""
    angle = np.mod(np.arctan2(offsets[..., 0], offsets[..., 1]), 2.0 * np.pi)
    return np.argsort(np.where(filled, angle, np.inf), axis=1, kind="stable")

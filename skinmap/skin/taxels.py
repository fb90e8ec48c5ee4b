"""The taxel table: what a file says about each taxel, row by row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray, check_finite, check_points, freeze
from skinmap.errors import InvalidArrayError


@dataclass(frozen=True, eq=False, slots=True)
class TaxelTable:
    """Placed taxels in the frame of their link, ordered by channel.

    Attributes
    ----------
    channels : (n,) int
        Place of each taxel in the live vector; each once.
    modules : (n,) int
        Module (rigid board) of each taxel.
    positions : (n, 3) float
        [m].
    normals : (n, 3) float
        As the file has them; placeholders more often than not, zero where there are none.
    """

    channels: IntArray
    modules: IntArray
    positions: FloatArray
    normals: FloatArray

    def __post_init__(self) -> None:
        positions = check_points(self.positions, "positions")
        n = len(positions)
        normals = check_finite(self.normals, "normals", (n, 3))
        channels = np.asarray(self.channels, np.int64)
        modules = np.asarray(self.modules, np.int64)
        if channels.shape != (n,) or modules.shape != (n,):
            raise InvalidArrayError(
                f"channels and modules must have shape ({n},), "
                f"got {channels.shape} and {modules.shape}"
            )
        if n and channels.min() < 0:
            raise InvalidArrayError(f"channels start at 0, got {channels.min()}")
        values, count = np.unique(channels, return_counts=True)
        if (count > 1).any():
            raise InvalidArrayError(f"channel {values[count > 1][0]} comes more than once")
        order = np.argsort(channels)
        freeze(
            self,
            channels=channels[order],
            modules=modules[order],
            positions=positions[order],
            normals=normals[order],
        )

    def __len__(self) -> int:
        return len(self.channels)

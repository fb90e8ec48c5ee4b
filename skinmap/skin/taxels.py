"""The taxel table: what a file says about each taxel, row by row."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from skinmap.arrays import FloatArray, IntArray, check_finite, check_points, freeze
from skinmap.errors import InvalidArrayError

ABSENT, THERMAL, UNKNOWN = -1, -2, -3
NO_ID = -1  # of a taxel that is not wired


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
    representative : (n,) int
        What an iCub file says of each: the channel that stands for it, `ABSENT`, `THERMAL` or,
        where it says nothing, `UNKNOWN`; all unknown if not given.
    link : str
        The link that the file names, if any.
    ids : (n,) int
        Number that the hardware has for each taxel, `NO_ID` for one that is not wired: it has a
        place and never speaks; no rows where the hardware knows channels only.
    pieces : (n,) int
        Shell that carries each taxel, where a part has several: no triangle goes from one to
        another. No rows where it has one.
    """

    channels: IntArray
    modules: IntArray
    positions: FloatArray
    normals: FloatArray
    representative: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    link: str = ""
    ids: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    pieces: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        positions = check_points(self.positions, "positions")
        n = len(positions)
        normals = check_finite(self.normals, "normals", (n, 3))
        channels = np.asarray(self.channels, np.int64)
        stated = np.asarray(self.representative, np.int64)
        if len(stated) == 0:
            stated = np.full(n, UNKNOWN)
        modules = np.asarray(self.modules, np.int64)
        ids, pieces = np.asarray(self.ids, np.int64), np.asarray(self.pieces, np.int64)
        for name, given in (("ids", ids), ("pieces", pieces)):
            if given.shape not in ((n,), (0,)):
                raise InvalidArrayError(f"{len(given)} {name} for {n} taxels")
        if not channels.shape == modules.shape == stated.shape == (n,):
            raise InvalidArrayError(
                f"channels and modules must have shape ({n},), "
                f"got {channels.shape}, {modules.shape} and {stated.shape}"
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
            representative=stated[order],
            ids=ids[order] if len(ids) else ids,
            pieces=pieces[order] if len(pieces) else pieces,
        )

    @property
    def unwired(self) -> IntArray:
        """Channels (k,) of taxels that have a place and no wire: nothing ever comes of them."""
        return self.channels[self.ids == NO_ID] if len(self.ids) else self.ids

    def __len__(self) -> int:
        return len(self.channels)

"""One touch as the doctor sees it: where it was asked for, and what answered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from skinmap.arrays import FloatArray, check_finite, freeze
from skinmap.errors import InvalidArrayError, UnknownNameError

How = Literal["poke", "stroke", "hand"]
HOWS: tuple[str, ...] = get_args(How)


@dataclass(frozen=True, eq=False, slots=True)
class Touch:
    """A touch and its answer.

    Attributes
    ----------
    how : {"poke", "stroke", "hand"}
    path : (p, 3) float or None
        Where it was asked for, in the link's frame [m]: one point, or the points of a stroke in
        order; None where nobody knows.
    response : (n,) float
        Largest answer of each row of the table above its rest [counts].
    arrival : (n,) float
        When it came, 0 at the touch's beginning to 1 at its end; used for strokes.
    """

    how: str
    path: FloatArray | None
    response: FloatArray
    arrival: FloatArray

    def __post_init__(self) -> None:
        if self.how not in HOWS:
            raise UnknownNameError("kind of touch", self.how, HOWS)
        response = check_finite(self.response, "response", (None,))
        arrival = check_finite(self.arrival, "arrival", (len(response),))
        freeze(self, response=response, arrival=arrival)
        if self.path is not None:
            path = check_finite(self.path, "path", (None, 3))
            if len(path) == 0 or (self.how == "stroke" and len(path) < 2):
                raise InvalidArrayError("a touch has a place, a stroke at least two")
            freeze(self, path=path)

    @property
    def middle(self) -> FloatArray | None:
        """(3,) the middle of where it was asked for [m]."""
        return None if self.path is None else np.asarray(self.path.mean(axis=0))

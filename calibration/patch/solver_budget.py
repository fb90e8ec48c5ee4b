"""How much work goes into laying a board on its link: what trades speed for accuracy."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skinmap.errors import InvalidArrayError

STARTS = 3  # most patches need three
STEPS = 20  # a stage at most; most stages settle before
DETAIL = 4e-3  # a facet's sagitta stays below 0.1 mm on a wrist [m]
FINEST = 0.5e-3  # half a link of a humanoid then has a million triangles [m]


@dataclass(frozen=True, slots=True)
class Effort:
    """Knobs of a calibration; the defaults are what accuracy needs.

    Attributes
    ----------
    starts : int
        From how many places the board is laid at first; those that fit badly, and differ, get
        twice as many again.
    steps : int
        Steps of Gauss and Newton in each of the three stages, at most.
    detail : float
        Longest edge of the wrap round the link [m].
    """

    starts: int = STARTS
    steps: int = STEPS
    detail: float = DETAIL

    def __post_init__(self) -> None:
        for name in ("starts", "steps"):
            if getattr(self, name) < 1:
                raise InvalidArrayError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not FINEST <= self.detail < math.inf:
            raise InvalidArrayError(
                f"the detail of a wrap must be at least {FINEST:g} m, got {self.detail:g}"
            )


FULL = Effort()

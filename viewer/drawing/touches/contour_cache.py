"""Contours of touches for body and flat map: found once for both, as often as requested.

A contour takes a sparse product over its part and a search for the triangles it crosses. Between
two searches a touch keeps its contour; its centre, arrow, trail and label follow each sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.live.contacts.named_touch import NamedTouch
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.touches.outlines import touch_field
from viewer.drawing.touches.touch_marks import Ground, contour_on

EVERY = math.inf  # with each sample


def check_rate(rate: float) -> float:
    """A rate of contours [1/s] above 0; infinite for a new one with each sample.

    Raises
    ------
    InvalidArrayError
        Another number.
    """
    if not rate > 0.0:
        raise InvalidArrayError(f"contours are found anew more than 0 times a second, got {rate}")
    return float(rate)


class KeptContours:
    """Contours of the touches shown, by touch and surface.

    Parameters
    ----------
    rate : float
        How often they are found anew, at most [1/s, of the samples' time].
    """

    def __init__(self, rate: float = EVERY) -> None:
        self.rate = check_rate(rate)
        self._time = self._last = math.nan
        self._fields: dict[tuple[str, int], tuple[FloatArray, float]] = {}
        self._lines: dict[tuple[int, str, int], FloatArray] = {}

    def begin(self, time: float) -> None:
        """Turn to the touches of a time [s]."""
        went_on = time > self._last  # else somebody led the recording elsewhere
        self._last = time
        if not (went_on and time < self._time + 1.0 / self.rate - 1e-9):
            self._time = time
            self._fields.clear()
            self._lines.clear()
            return
        # What has no number of its own cannot be told from another touch.
        self._fields = {key: kept for key, kept in self._fields.items() if key[1] >= 0}
        self._lines = {key: kept for key, kept in self._lines.items() if key[2] >= 0}

    def of(
        self,
        ground: Ground,
        layer: SkinLayer,
        touch: NamedTouch,
        touches: Sequence[NamedTouch],
        lift: float,
    ) -> FloatArray:
        """(k, 2, 3) contour of one of the touches on a surface, in its frame [m]."""
        row = next(k for k, one in enumerate(touches) if one is touch)
        number = touch.identity if touch.identity >= 0 else -1 - row
        key = (id(ground), touch.part, number)
        if key not in self._lines:
            named = key[1:]
            if named not in self._fields:
                self._fields[named] = touch_field(layer, touch, touches)
            self._lines[key] = contour_on(ground, *self._fields[named], lift)
        return self._lines[key]

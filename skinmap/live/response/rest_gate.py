"""What of a stream of pressures is a touch: by the rest that each taxel shows by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray
from skinmap.live.response.pressures import REST, WINDOW
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts import ACTIVE
from skinmap.touch.rest import Rest, felt, find_rest, usual_rest

FROZEN = (
    1.0  # a taxel that moves by no more than this while it is high has no finger on it [counts]
)
TWICE = 2  # windows in which it must be frozen
NEVER = 5  # windows after which a taxel that was never seen at rest is stuck
PRESSED_FLAT = 250.0  # a reading at the end of the range stands still under a finger, too [counts]


class RestGate:
    """Lets touches of a joined skin of N taxels pass, and nothing else.

    Each taxel's levels are learnt in the first two seconds in which it is seen at rest; before,
    they are the usual ones. A taxel is stuck while it stands still above the level of a touch for
    four seconds, for two if it was never seen at rest, or if it is never seen at rest for ten; one
    reading at rest sets it free.

    Parameters
    ----------
    skin : JoinedSkin
    rate : float
        Samples a second, 0 where unknown.
    """

    def __init__(self, skin: JoinedSkin, rate: float) -> None:
        self.skin = skin
        n = len(skin)
        every = (rate if rate > 0 else 50.0) * REST / WINDOW
        self._every = max(1, round(every))
        self._window = np.zeros((WINDOW, n), np.float32)
        self._seen = 0
        self._known: BoolArray = np.zeros(n, bool)
        self._high = np.zeros(n, np.int64)  # windows that a taxel has been high without a break
        self._still = np.zeros(n, np.int64)  # and has stood still
        self.rest = usual_rest(n)

    def apply(self, pressures: NDArray[Any]) -> NDArray[Any]:
        """The pressures (t, N) [counts] with 0 wherever nothing is touched."""
        if self.rest.stuck.any():
            self._set_free(pressures)
        found = felt(pressures, self.rest, self.skin.beside)
        start = -self._seen % self._every
        for row in range(start, len(pressures), self._every):
            place = (self._seen + row) // self._every % WINDOW
            self._window[place] = pressures[row]
            if place == WINDOW - 1:
                self._learn()
        self._seen += len(pressures)
        return found

    def health(self) -> dict[str, dict[str, list[int]]]:
        """Channels that are stuck or noisy, by part; parts without any are left out."""
        found = {}
        for part, rows in self.skin.slices.items():
            channels = self.skin.skins[part].skin.channels
            own = {
                "stuck": channels[self.rest.stuck[rows]].tolist(),
                "noisy": channels[self.rest.noisy[rows]].tolist(),
            }
            if any(own.values()):
                found[part] = own
        return found

    def _set_free(self, pressures: NDArray[Any]) -> None:
        free = self.rest.stuck & (pressures.min(axis=0) <= ACTIVE)
        if free.any():
            self._high[free] = self._still[free] = 0
            self.rest = _with(self.rest, stuck=self.rest.stuck & ~free)

    def _learn(self) -> None:
        """Take what a full window says: levels of taxels seen at rest, and who is stuck."""
        low, high = self._window.min(axis=0), self._window.max(axis=0)
        held = low > ACTIVE
        still = held & (high - low <= FROZEN) & (high < PRESSED_FLAT)
        self._high = np.where(held, self._high + 1, 0)
        self._still = np.where(still, self._still + 1, 0)
        stuck = (self._still >= TWICE) | (~self._known & (still | (self._high >= NEVER)))
        rest = _with(self.rest, stuck=self.rest.stuck | stuck)
        if not self._known.all():
            found = find_rest(self._window)
            fresh = ~self._known & ~found.stuck
            levels = {
                name: np.where(fresh, getattr(found, name), getattr(rest, name))
                for name in ("offset", "begins", "goes_on")
            }
            rest = _with(rest, **levels)
            self._known |= fresh
        self.rest = rest


def _with(rest: Rest, **changes: FloatArray | BoolArray) -> Rest:
    names = ("offset", "begins", "goes_on", "stuck")
    return Rest(**{name: changes.get(name, getattr(rest, name)) for name in names})

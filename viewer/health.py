"""The health of each taxel: what a response calibration says, and what the stream shows.

What a dead, stuck or noisy taxel reads is not a pressure: every layer draws the sign of its state,
and outlines, peaks and plots leave it out.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import BoolArray, IntArray
from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.live.moment import Moment
from skinmap.touch.contacts.skin_geometry import ACTIVE

# As `calibration.response.Health` names them, and what only a stream can be: silent, or high since
# it began ("unheard"), so that nobody knows whether it is touched or hangs.
STATES = ("ok", "never touched", "dead", "stuck", "saturated", "noisy", "unheard", "stale")
OK, NEVER, DEAD, STUCK, SATURATED, NOISY, UNHEARD, STALE = range(len(STATES))
MUTE = (DEAD, STUCK, NOISY, UNHEARD)  # what such a taxel reads is not a pressure
MUTED = np.isin(np.arange(len(STATES)), MUTE)
TOP = 255.0  # counts: a taxel that reads so much could be pressed harder and would not tell


class HealthWatch:
    """Keeps what is known of the taxels of each part.

    Parameters
    ----------
    sizes : mapping of str to int
        Taxels of each part.
    healths : mapping of str to (n,) array-like of str, optional
        What a response calibration found; other taxels are "never touched" until they are.

    Attributes
    ----------
    version : int
        Changes with what is known of any taxel.

    Raises
    ------
    UnknownNameError, SkinMismatchError
        A state that does not exist, or another number of states than taxels.
    """

    def __init__(
        self, sizes: Mapping[str, int], healths: Mapping[str, ArrayLike] | None = None
    ) -> None:
        self._calibrated = {part: np.full(n, NEVER, np.int64) for part, n in sizes.items()}
        for part, names in (healths or {}).items():
            self._calibrated[part] = _numbers(names, sizes[part], part)
        self._states = {part: states.copy() for part, states in self._calibrated.items()}
        self._rested = {part: np.zeros(n, bool) for part, n in sizes.items()}
        self._felt = {part: np.zeros(n, bool) for part, n in sizes.items()}
        self._told: dict[str, NDArray[np.str_] | None] = {}
        self.version = 0

    def observe(self, moment: Moment) -> None:
        """Take what a moment tells of its taxels; one that was at rest and then felt is well."""
        for part, pressures in moment.pressures.items():
            states = self._states.get(part)
            if states is None or np.shape(pressures) != states.shape:
                continue
            told = moment.states.get(part)
            high = np.asarray(pressures) > ACTIVE
            found = high & self._rested[part]
            for touch in moment.touches:
                if touch.part == part:
                    found[touch.taxels] = True
            self._rested[part] |= ~high
            if told is not self._told.get(part) or (found & ~self._felt[part]).any():
                self._felt[part] |= found
                self._told[part] = told
                self._states[part] = self._judged(part, told)
                self.version += 1

    def _judged(self, part: str, told: NDArray[np.str_] | None) -> IntArray:
        """(n,) states by calibration and stream; what a calibration found stays."""
        states = self._calibrated[part].copy()
        states[(states == NEVER) & self._felt[part]] = OK
        # Before anything of a part was seen at rest, none of its taxels is different.
        if told is not None and not (told == STATES[UNHEARD]).all():
            for state in MUTE:
                states[(told == STATES[state]) & (states <= NEVER)] = state
        return states

    def states(self, part: str, moment: Moment | None) -> IntArray:
        """(n,) state of each taxel at a moment, as numbers of `STATES`."""
        states = self._states[part].copy()
        if moment is None or part not in moment.pressures:
            return states
        pressures = np.asarray(moment.pressures[part], np.float64)
        if pressures.shape != states.shape:
            raise SkinMismatchError(
                f"pressures of shape {pressures.shape} for the {len(states)} taxels of {part!r}"
            )
        well = states <= NEVER
        states[well & (pressures >= TOP)] = SATURATED
        states[well & ~np.isfinite(pressures)] = STALE
        if moment.stale:
            states[well] = STALE
        return states

    def known(self, part: str) -> IntArray:
        """(n,) what is known of each taxel whatever comes now, as numbers of `STATES`."""
        return self._states[part]

    def mute(self, part: str) -> BoolArray:
        """(n,) taxels of which no pressure is known, whatever they read."""
        return np.asarray(MUTED[self._states[part]])

    def unfit(self, part: str) -> BoolArray:
        """(n,) taxels whose values mean nothing, whatever they read: to be marked on any layer."""
        return np.asarray(self._states[part] > NEVER)


def _numbers(names: ArrayLike, n: int, part: str) -> IntArray:
    words = np.asarray(names, dtype=str)
    if words.shape != (n,):
        raise SkinMismatchError(f"health of {words.size} taxels for the {n} of {part!r}")
    unknown = sorted(set(words.tolist()) - set(STATES))
    if unknown:
        raise UnknownNameError("health state", unknown[0], STATES)
    return np.array([STATES.index(word) for word in words.tolist()], np.int64)

"""The health of each taxel: what a response calibration says, and what the stream shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import BoolArray, IntArray
from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.live.moment import Moment
from skinmap.touch.contacts import ACTIVE

# As `calibration.response.Health` names them, and what only a stream can be.
STATES = ("ok", "never touched", "dead", "stuck", "saturated", "noisy", "stale")
OK, NEVER, DEAD, STUCK, SATURATED, NOISY, STALE = range(len(STATES))
TOP = 255.0  # counts: a taxel that reads so much could be pressed harder and would not tell


class HealthWatch:
    """Keeps what is known of the taxels of each part.

    Parameters
    ----------
    sizes : mapping of str to int
        Taxels of each part.
    healths : mapping of str to (n,) array-like of str, optional
        What a response calibration found; other taxels are "never touched" until they are.

    Raises
    ------
    UnknownNameError, SkinMismatchError
        A state that does not exist, or another number of states than taxels.
    """

    def __init__(
        self, sizes: Mapping[str, int], healths: Mapping[str, ArrayLike] | None = None
    ) -> None:
        self._states = {part: np.full(n, NEVER, np.int64) for part, n in sizes.items()}
        for part, names in (healths or {}).items():
            self._states[part] = _numbers(names, sizes[part], part)

    def observe(self, moment: Moment) -> None:
        """A taxel that is felt for the first time is well."""
        for part, pressures in moment.pressures.items():
            states = self._states.get(part)
            if states is not None and np.shape(pressures) == states.shape:
                states[(states == NEVER) & (np.asarray(pressures) > ACTIVE)] = OK

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
        well = (states == OK) | (states == NEVER)
        states[well & (pressures >= TOP)] = SATURATED
        states[well & ~np.isfinite(pressures)] = STALE
        if moment.stale:
            states[well] = STALE
        return states

    def known(self, part: str) -> IntArray:
        """(n,) what is known of each taxel whatever comes now, as numbers of `STATES`."""
        return self._states[part]

    def unfit(self, part: str) -> BoolArray:
        """(n,) taxels whose values mean nothing, whatever they read: to be marked on any layer."""
        states = self._states[part]
        return np.asarray((states != OK) & (states != NEVER))


def _numbers(names: ArrayLike, n: int, part: str) -> IntArray:
    words = np.asarray(names, dtype=str)
    if words.shape != (n,):
        raise SkinMismatchError(f"health of {words.size} taxels for the {n} of {part!r}")
    unknown = sorted(set(words.tolist()) - set(STATES))
    if unknown:
        raise UnknownNameError("health state", unknown[0], STATES)
    return np.array([STATES.index(word) for word in words.tolist()], np.int64)

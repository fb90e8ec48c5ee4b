"""What an untouched skin sends, and what is more than that.

A taxel is touched where it reads more than its own noise and a taxel beside it does so too: real
skins have spikes, offsets and stuck areas, and none of these is a touch. Each taxel has two levels
(Canny's hysteresis): one that begins a contact, one that goes on with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.touch.contacts.skin_geometry import ACTIVE

LOW = ACTIVE // 2  # beside a taxel that is touched so little suffices [counts]
BEGINS, GOES_ON = 5.0, 3.0  # standard deviations of the noise above rest: 1 in 3e6, 1 in 700
NOISY = 4.0 * ACTIVE  # a taxel that must read more to be believed is reported [counts]
ENOUGH = 12  # quiet samples that a rest can be learnt from
UPPER = 84.13  # percentile that lies one deviation above the median
CUT_OFF = 2.43  # by how much median steps are too small where half of the noise is cut off at 0
MEDIAN_STEP = 0.954  # of the absolute step between two samples of noise of deviation 1
CALM_SHARE = 25.0  # percentile over time that is rest where touches are short


@dataclass(frozen=True, eq=False, slots=True)
class Rest(Frozen):
    """Levels of n taxels.

    Attributes
    ----------
    offset : (n,) float
        What a taxel reads at rest [counts].
    begins, goes_on : (n,) float
        A reading above `begins` with one above `goes_on` beside it is a touch [counts].
    stuck : (n,) bool
        Taxels that hang at a value as if touched: they say nothing.
    """

    offset: FloatArray
    begins: FloatArray
    goes_on: FloatArray
    stuck: BoolArray

    def __len__(self) -> int:
        return len(self.begins)

    @property
    def noisy(self) -> BoolArray:
        """(n,) taxels with so much noise that light touches are not felt there."""
        return np.asarray((self.begins > NOISY) & ~self.stuck)


@cache
def usual_rest(count: int) -> Rest:
    """Levels of taxels of which nothing is known: those of a skin with little noise."""
    begins, goes_on = np.full((2, count), [[ACTIVE], [LOW]], np.float64)
    return Rest(np.zeros(count), begins, goes_on, np.zeros(count, bool))


def find_rest(samples: ArrayLike, *, quiet: ArrayLike | None = None) -> Rest:
    """Learn the levels of each taxel from its own rest.

    Parameters
    ----------
    samples : (t, n) array-like of float
        Pressures [counts].
    quiet : (t,) array-like of bool, optional
        Samples that are known to be of nobody's touch. Where that is not said, each taxel
        is taken to be touched for less than half of the time.

    Returns
    -------
    Rest
        `usual_rest` where there are too few samples to learn from.

    Raises
    ------
    InvalidArrayError
        Samples that are no table, or as many quiet marks as there are none.
    """
    table = np.asarray(samples)
    if table.ndim != 2:
        raise InvalidArrayError(f"samples must have shape (t, n), got {table.shape}")
    if quiet is not None:
        marks = np.asarray(quiet, bool)
        if marks.shape != (len(table),):
            raise InvalidArrayError(f"quiet must have shape ({len(table)},), got {marks.shape}")
        if marks.sum() < ENOUGH:
            return usual_rest(table.shape[1])
        found = np.percentile(table[marks].astype(np.float32), [50, UPPER], axis=0)
        middle, upper = found.astype(np.float64)
        return _levels(middle, upper - middle)
    if len(table) < ENOUGH:
        return usual_rest(table.shape[1])
    return _unmarked(table.astype(np.float32))


def _unmarked(table: NDArray[np.float32]) -> Rest:
    """Levels of a recording without marked touches.

    Noise is judged by the median step from sample to sample: noise makes all steps, a touch a few
    large ones. A taxel whose readings are mostly cut off at 0 steps less than its noise; the skin's
    own typical noise is then the least that is assumed.
    """
    low = np.percentile(table, CALM_SHARE, axis=0).astype(np.float64)
    noise = np.median(np.abs(np.diff(table, axis=0)), axis=0) / MEDIAN_STEP
    noise = np.where(low <= 0.0, CUT_OFF * noise, noise)
    noise = np.maximum(noise, np.median(noise))
    return _levels(low, noise)


def _levels(offset: FloatArray, noise: FloatArray) -> Rest:
    return Rest(
        offset,
        np.maximum(ACTIVE, offset + BEGINS * noise),
        np.maximum(LOW, offset + GOES_ON * noise),
        offset > ACTIVE,
    )


def felt(samples: NDArray[Any], rest: Rest, beside: IntArray) -> NDArray[Any]:
    """The samples (k, n) with 0 wherever nothing is touched.

    Parameters
    ----------
    samples : (k, n) array
        Pressures [counts].
    rest : Rest
    beside : (n, d) int
        Taxels beside each, padded with n (`SkinGeometry.beside`). A taxel that has nobody beside
        it is believed alone.
    """
    found = np.zeros_like(samples)
    high = samples.max(axis=0, initial=0) > rest.goes_on
    columns = np.flatnonzero(high & ~rest.stuck)
    if len(columns) == 0:
        return found
    own = samples[:, columns]
    place = np.full(len(rest) + 1, len(columns))
    place[columns] = np.arange(len(columns))
    around = place[beside[columns]].T
    alone = (beside[columns] == len(rest)).all(axis=1)
    some = own > rest.goes_on[columns]
    begun = some & (own > rest.begins[columns])
    begun &= _any_beside(some, around) | alone
    kept = begun | (some & _any_beside(begun, around))
    found[:, columns] = np.where(kept, own, 0)
    return found


def _any_beside(marks: BoolArray, around: IntArray) -> BoolArray:
    """(k, c) whether any of the columns beside each one (d, c) is among the marks (k, c)."""
    padded = np.zeros((len(marks), marks.shape[1] + 1), bool)
    padded[:, :-1] = marks
    return np.asarray(padded[:, around].any(axis=1))

"""A skin untouched: mute modules, and channels that are dead, stuck, noisy, cut off or copies.

The analysis of channels is that of `skinmap examine`; modules and the level of each channel are
added here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calibration.wiring.boards import Boards
from calibration.wiring.touches import without_holes
from skinmap.arrays import FloatArray, freeze
from skinmap.errors import InvalidArrayError
from skinmap.soundness.channel_faults import channel_faults
from skinmap.soundness.finding import Finding, finding
from skinmap.soundness.survey import survey
from skinmap.soundness.track import Track

FEWEST = 100  # samples; fewer tell nothing
SILENT = 0.5  # share of samples without a number that makes a channel silent
FLICKER = 4  # changes of a stuck channel at most: two spikes
NOISY = 5.0  # times the noise of the others
QUARTILE = 1.1503 * np.sqrt(6.0)  # upper one of second differences, of normal noise of 1
ALIVE = 20  # changes that a lively channel shows at least, else the rest is too calm to judge
OF_CHANNELS = {"dead", "stuck", "clipped", "quantised", "copied"}  # that a rest shows


@dataclass(frozen=True, eq=False, slots=True)
class RestFindings:
    """What a rest showed.

    Attributes
    ----------
    samples : int
    mute : tuple of int
        Modules (places in `Boards.numbers`) of which no channel changed.
    alive : (m,) bool
        Modules whose noise shows that they send.
    found : tuple of Finding
        Faults of channels beyond the mute modules; `channels` are rows of the table.
    tells : bool
        Whether there was noise enough to judge at all.
    level, noise : (n,) float
        Median and standard deviation of each row [counts].
    """

    samples: int
    mute: tuple[int, ...]
    alive: np.ndarray
    found: tuple[Finding, ...]
    tells: bool
    level: FloatArray
    noise: FloatArray

    def __post_init__(self) -> None:
        freeze(self)

    def rows(self, kind: str) -> list[list[int]]:
        """Rows of the table of each finding of a kind."""
        return [one.channels or [] for one in self.found if one.kind == kind]


def judge_rest(samples: ArrayLike, boards: Boards) -> RestFindings:
    """Judge samples of an untouched skin.

    Parameters
    ----------
    samples : (t, n) array-like
        At least 100 of them [counts]; NaN where a number did not come.
    boards : Boards
        Of a part with n taxels.

    Returns
    -------
    RestFindings
        Mute modules, and faults of channels; one that sends no number in most samples is dead.

    Raises
    ------
    InvalidArrayError
        Samples of another length than the table, too few, or without any number.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> from calibration.wiring import boards_of, judge_rest
    >>> boards = boards_of(skinmap.load_robot("icub"), "left_forearm")
    >>> rest = np.rint(np.random.default_rng(0).normal(240.0, 1.2, (300, len(boards.table))))
    >>> rest[:, 5], rest[:, 33] = 255.0, np.nan
    >>> found = judge_rest(rest, boards)
    >>> found.rows("stuck"), found.rows("dead")
    ([[5]], [[33]])
    """
    values = without_holes(samples)
    missing = ~np.isfinite(np.asarray(samples, np.float64))
    n = len(boards.table)
    if values.shape[1] != n:
        raise InvalidArrayError(f"{values.shape[1]} values at rest for {n} taxels")
    if len(values) < FEWEST:
        raise InvalidArrayError(f"{len(values)} samples at rest, at least {FEWEST} are needed")
    if missing.all():
        raise InvalidArrayError(f"no channel of {boards.part!r} sends numbers")
    silent = missing.mean(axis=0) > SILENT
    changes = (np.diff(values, axis=0) != 0).sum(axis=0)
    moving = (changes > FLICKER) & ~silent
    tells = bool(moving[~silent].mean() >= 0.5 and np.percentile(changes[moving], 2.0) >= ALIVE)
    there = boards.columns >= 0
    lively = np.where(there, moving[np.where(there, boards.columns, 0)], False)
    mute = np.flatnonzero((lively.sum(axis=1) == 0) & (there.sum(axis=1) >= 3) & tells)
    rows = boards.columns[mute]
    within = set(rows[rows >= 0].tolist())
    # A channel with a spike or two stands still as well, and two spikes at once make no copy.
    level = np.median(values, axis=0)
    reach = np.where(moving, np.maximum(3.0, 9.0 * np.median(np.abs(values - level), axis=0)), 0.0)
    still = np.clip(values, level - reach, level + reach)
    still[:, silent] = np.nan
    looked = survey(Track(boards.part, still))
    with np.errstate(all="ignore"):
        every = channel_faults(looked)[0] if tells or silent.any() else []
    found = []
    for one in every:
        own = [c for c in one.channels or () if c not in within and (tells or silent[c])]
        if one.kind in OF_CHANNELS and own and one.rows is None:
            found.append(replace(one, channels=own))
    # Quartiles: a spike is not noise, and pressures that are cut off at zero mostly stand still.
    rough = np.percentile(np.abs(np.diff(values, 2, axis=0)), 75.0, axis=0) / QUARTILE
    wild = moving & (rough > NOISY * max(float(np.median(rough[moving])), 0.25)) if tells else ()
    if np.any(wild):
        found.append(finding("noisy", "noisy at rest", channels=np.flatnonzero(wild)))
    alive = np.asarray(2 * lively.sum(axis=1) > there.sum(axis=1)) & tells
    return RestFindings(len(values), tuple(mute.tolist()), alive, tuple(found), tells, level, rough)

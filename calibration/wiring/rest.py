"""What a skin tells untouched: mute modules, stuck and silent channels, those given twice.

Values are whole counts, so the tests count: how often a channel changes, and how often two say the
same. A channel that says the same as another one in every sample, where two channels of their own
would have done so by a chance of less than one in a million, is given twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibration.wiring.boards import Boards
from calibration.wiring.touches import without_holes
from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.errors import InvalidArrayError

FEWEST = 100  # samples; fewer tell nothing
SILENT = 0.5  # share of samples without a number that makes a channel silent
FLICKER = 4  # changes of a stuck channel at most: two spikes
ALIVE = 20  # changes that a lively channel shows at least, else the rest is too calm to judge
CHANCE = 1e-6  # that any pair of healthy channels passes for one given twice
BLOCK = 64  # samples over which a channel's levels are counted: baselines wander slowly
ALIKE = 0.9  # share of samples in which the copies of a channel agree, at least
LIKE = 0.5  # correlation of copies with noise of their own, at least
FEW_CHANGES = 8.0  # correlation times root of the changes that chance does not reach
FAR = 8.0  # spreads that such a correlation lies above those of all other pairs


@dataclass(frozen=True, eq=False, slots=True)
class RestFindings:
    """What a rest showed.

    Attributes
    ----------
    samples : int
    stuck : (s,) int
        Rows of the table that never changed, though others did.
    mute : tuple of int
        Modules (places in `Boards.numbers`) of which no channel changed.
    alive : (m,) bool
        Modules whose noise shows that they send.
    pairs : (p, 2) int
        Rows that say the same.
    tells : bool
        Whether there was noise enough to judge at all.
    unsure : (u,) int
        Rows that changed too seldom to be compared with others.
    silent : (q,) int
        Rows that sent no number in most samples.
    """

    samples: int
    stuck: IntArray
    mute: tuple[int, ...]
    alive: np.ndarray
    pairs: IntArray
    tells: bool
    unsure: IntArray
    silent: IntArray

    def __post_init__(self) -> None:
        freeze(self)


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
        Mute modules, and channels that are stuck, silent or given twice.

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
    >>> found.stuck.tolist(), found.silent.tolist()
    ([5], [33])
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
    none = np.zeros(0, np.int64)
    m = len(boards)
    if moving[~silent].mean() < 0.5 or np.percentile(changes[moving], 2.0) < ALIVE:
        return RestFindings(len(values), none, (), np.zeros(m, bool), none.reshape(0, 2), False,
                            none, np.flatnonzero(silent))  # fmt: skip
    there = boards.columns >= 0
    lively = np.where(there, moving[np.where(there, boards.columns, 0)], False)
    mute = np.flatnonzero((lively.sum(axis=1) == 0) & (there.sum(axis=1) >= 3))
    within = np.zeros(n, bool)
    within[boards.columns[mute][there[mute]]] = True
    return RestFindings(
        len(values),
        np.flatnonzero(~moving & ~within & ~silent),
        tuple(mute.tolist()),
        np.asarray(2 * lively.sum(axis=1) > there.sum(axis=1)),
        _twice(values, np.flatnonzero(moving)),
        True,
        np.flatnonzero(moving & (changes < ALIVE)),
        np.flatnonzero(silent),
    )


def _twice(values: FloatArray, rows: IntArray) -> IntArray:
    """(p, 2) rows that are copies of each other."""
    x = values[:, rows]
    t, n = x.shape
    if n < 2:
        return np.zeros((0, 2), np.int64)
    x = x - np.rint(np.median(x, axis=0))
    reach = np.maximum(3.0, 9.0 * np.median(np.abs(x), axis=0))
    x = np.clip(x, -reach, reach)  # two spikes in one sample make no copy
    fast = np.diff(x, axis=0)
    found = np.asarray(np.corrcoef(fast.T)).reshape(n, n)
    np.fill_diagonal(found, 0.0)
    upper = found[np.triu_indices(n, 1)]
    spread = 1.4826 * float(np.median(np.abs(upper - np.median(upper)))) + 1.0 / np.sqrt(t)
    # Clipped channels speak up now and then only: few changes agree by chance.
    changes = (fast != 0).sum(axis=0)
    few = np.minimum(changes[:, None], changes[None])
    least = np.maximum(LIKE, float(np.median(upper)) + FAR * spread)
    high = np.argwhere(np.triu(found, 1) > np.maximum(least, FEW_CHANGES / np.sqrt(few)))
    exact = np.argwhere(np.triu(found, 1) > 0.3)
    kept = {(int(a), int(b)) for a, b in high}
    limit = np.log(CHANCE / (n * (n - 1) / 2))
    for a, b in exact.tolist():
        same = x[:, a] == x[:, b]
        if same.mean() >= ALIKE and _log_chance(x[:, a], x[:, b], same) < limit:
            kept.add((a, b))
    return rows[np.array(sorted(kept), np.int64).reshape(-1, 2)]


def _log_chance(a: FloatArray, b: FloatArray, same: np.ndarray) -> float:
    """Log chance (Chernoff's bound) that two channels of their own agree so often."""
    expected = 0.0
    for first in range(0, len(a), BLOCK):
        one, other = a[first : first + BLOCK], b[first : first + BLOCK]
        levels = np.union1d(one, other)
        p = (one[:, None] == levels).mean(axis=0)
        q = (other[:, None] == levels).mean(axis=0)
        expected += len(one) * float(p @ q)
    rate = min(expected / len(a), 1.0 - 1e-9)
    share = float(same.mean())
    if share <= rate:
        return 0.0
    gap = share * np.log(share / rate)
    if share < 1.0:
        gap += (1.0 - share) * np.log((1.0 - share) / (1.0 - rate))
    return float(-len(a) * gap)

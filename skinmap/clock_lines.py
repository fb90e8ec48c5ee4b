"""Two clocks on one line: which row of the skin belongs to which row of a reference.

A chamber, a load cell or a camera records beside the skin on a clock of its own. Both see the same
loads, so that the reference is a function of the skin, with its memory, once the rows are laid on
each other. The line that leaves the least unexplained is searched over lag and slope; rows that
one side lost give several lines of one slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.memory_features import MemoryState

MOST_SLOPE = 0.03  # either way: clocks of computers are far better, rates that are rounded are not
MOST_LAG = 0.1  # of the reference's rows, either way, beyond what the lengths leave open
LEAST_LAG = 1000  # rows that are searched in any case
COARSE = 20  # rows between those that the search looks at
OVERLAP = 0.6  # share of the reference that must lie inside the samples
SAME = 0.9  # correlation with the skin's median of a channel that follows it
WINDOWS, REACH = 40, 150  # of the local lags, and how far they look [rows]
BREAK = 15  # rows lost at once that make a line of their own
GAIN = 0.8  # of the misfit that a further line must leave at most
CHUNK = 10_000  # rows at once
LONG = 30_000  # rows of a reference that are looked at one by one
WEAK = 0.002  # of the reference's variance: above it all channels are tried together
REST = 0.2  # of the rows, in which a channel is at rest or below
STILL = 4.0  # times the median step of a channel at rest: noise
CLEARLY = 1.3  # times less that a line leaves unexplained than an expected one, or that one holds
UNEXPLAINED = 0.2  # of the reference's variance: above it the clocks do not align
WRONG = 10.0  # times the usual misfit of a stretch, of which a lag mends less than half
FALSE = 5.0  # times the misfit must fall by leaving wrong stretches out
PRIOR = 0.05  # weight of (slope / 1 %)^2 and (lag / 500 rows)^2 against the log of the misfit


@dataclass(frozen=True, slots=True)
class ClockLine:
    """Skin row = reference row + offset_rows + slope * reference row, from `first_row` on.

    Attributes
    ----------
    first_row
        Of the reference; the next line begins where this one ends.
    offset_rows, slope
        The line.
    residual_rows
        Median distance of local lags from all lines.
    unexplained
        Share of the reference's variance that the skin leaves open on all lines; above
        `UNEXPLAINED` the clocks are not aligned.
    """

    first_row: int
    offset_rows: float
    slope: float
    residual_rows: float
    unexplained: float


def skin_rows(lines: Sequence[ClockLine], reference_rows: ArrayLike) -> FloatArray:
    """Rows of the skin, in parts of a row, that belong to rows of the reference."""
    rows = np.asarray(reference_rows, np.float64)
    which = np.searchsorted([one.first_row for one in lines], rows, side="right") - 1
    which = np.maximum(which, 0)
    offsets = np.array([one.offset_rows for one in lines])[which]
    return rows + offsets + np.array([one.slope for one in lines])[which] * rows


def reference_at(lines: Sequence[ClockLine], reference: ArrayLike, count: int) -> FloatArray:
    """The reference (count,) at each row of the skin; NaN where there is none."""
    wanted = np.asarray(reference, np.float64)
    places = skin_rows(lines, np.arange(len(wanted)))
    order = np.argsort(places, kind="stable")
    rows = np.arange(count)
    return np.interp(rows, places[order], wanted[order], left=np.nan, right=np.nan)


def following(samples: ArrayLike) -> IntArray:
    """Channels that follow the median of the skin, those that fall under load among them.

    Raises
    ------
    InvalidArrayError
        No channel moves.
    """
    return _following(np.asarray(samples))[0]


def _following(samples: FloatArray) -> tuple[IntArray, FloatArray]:
    few = samples[:: max(1, len(samples) // 5000)].astype(np.float64)
    spread = few.std(axis=0)
    live = np.flatnonzero(spread > 0.5 * (spread.max(initial=0.0) > 1.0))
    live = live[spread[live] > 0]
    if not len(live):
        raise InvalidArrayError("no channel moves: there is nothing to lay the reference on")
    scaled = (few[:, live] - few[:, live].mean(axis=0)) / spread[live]
    alike = scaled.T @ scaled / len(few)
    hub = int(np.argmax((np.abs(alike) > SAME).sum(axis=1)))  # the largest group that goes together
    sign = np.where(alike[hub] < 0, -1.0, 1.0)
    scaled *= sign
    middle = np.median(scaled[:, np.abs(alike[hub]) >= SAME], axis=1)
    for _ in range(3):
        follows = scaled.T @ middle / len(few) / max(middle.std(), 1e-12)
        keep = follows > min(SAME, float(follows.max()))
        keep |= follows == follows.max()
        middle = np.median(scaled[:, keep], axis=1)
    return live[keep], sign[keep]


def _signal(samples: FloatArray) -> FloatArray:
    """The skin as one number a row, 0 to 1."""
    own, sign = _following(samples)
    few = samples[:: max(1, len(samples) // 5000)][:, own].astype(np.float64)
    low, high = np.percentile(few, [0.5, 99.5], axis=0)
    scale = sign / np.maximum(high - low, 1e-12) / len(own)
    parts = [
        samples[start : start + CHUNK][:, own] @ scale for start in range(0, len(samples), CHUNK)
    ]
    found = np.concatenate(parts) - float(low @ scale)
    few = np.sort(found[:: max(1, len(found) // 5000)])
    return (found - few[0]) / max(few[-1] - few[0], 1e-12)


def _total(samples: FloatArray) -> FloatArray:
    """How far all channels together are from their rest, a number a row, 0 to 1."""
    few = samples[:: max(1, len(samples) // 5000)].astype(np.float64)
    scaled = (few - few.mean(axis=0)) / np.maximum(few.std(axis=0), 1e-12)
    # A load skews a channel its own way; where hands rest on it half of the time, the others vote.
    sign = np.where(scaled.T @ (scaled @ (scaled**3).mean(axis=0)) < 0, -1.0, 1.0)
    rest = np.quantile(few * sign, REST, axis=0)
    steps = np.diff(samples[: len(few)].astype(np.float64), axis=0)
    rest += STILL * np.median(np.abs(steps), axis=0) / np.sqrt(2.0)
    parts = [
        np.maximum(samples[start : start + CHUNK] * sign - rest, 0.0).sum(axis=1)
        for start in range(0, len(samples), CHUNK)
    ]
    found = np.concatenate(parts)
    return found / max(float(np.quantile(found, 0.995)), 1e-12)


def align(
    samples: ArrayLike,
    reference: ArrayLike,
    *,
    rate: float = 50.0,
    expected: float | None = None,
) -> tuple[ClockLine, ...]:
    """Lay the rows of a reference on those of the samples.

    Parameters
    ----------
    samples : (t, n) array-like
        Raw channels; those that follow the skin's median are looked at.
    reference : (u,) array-like
        Load at the same nominal rate, on its own clock.
    rate : float
        Rows a second.
    expected : float, optional
        Offset [rows] of clocks that go alike: another line must fit clearly better.

    Returns
    -------
    tuple of ClockLine
        One, or several where rows were lost.

    Raises
    ------
    InvalidArrayError
        No channel moves, the reference never moves or holds NaN, or one of them is too short.

    Examples
    --------
    >>> import numpy as np
    >>> load = np.interp(np.arange(4000), np.arange(0, 4000, 100),
    ...                  np.random.default_rng(1).uniform(0, 1, 40))
    >>> (line,) = align(np.outer(load, [40.0, 60.0]).round(), load[30:3900])
    >>> bool(abs(line.offset_rows - 30) < 3)
    True
    """
    given, wanted = np.asarray(samples), np.asarray(reference, np.float64).ravel()
    if min(len(given), len(wanted)) < 2 * COARSE * 10:
        raise InvalidArrayError(
            f"{len(given)} samples and {len(wanted)} rows of a reference: "
            f"at least {2 * COARSE * 10} of each are needed to align their clocks"
        )
    if not np.isfinite(wanted).all():
        raise InvalidArrayError("the reference holds NaN or infinity")
    if np.ptp(wanted) < 1e-9 * max(1.0, np.abs(wanted).max()):
        raise InvalidArrayError("the reference never moves: there is nothing to align")
    found = _lines(_signal(given), wanted, rate, expected)
    if found[0].unexplained > WEAK:
        # Touches here and there, or a gait: the load is that of all, and some channels lag it.
        of_all = _lines(_total(given), wanted, rate, expected)
        found = min(found, of_all, key=lambda lines: lines[0].unexplained)
    return found


def _lines(
    signal: FloatArray, reference: FloatArray, rate: float, expected: float | None
) -> tuple[ClockLine, ...]:
    """The best lines; of many hours, by means of some rows: the search grows with their square."""
    by = -(-len(reference) // LONG)
    if by > 1:
        signal, reference = (
            one[: len(one) // by * by].reshape(-1, by).mean(axis=1) for one in (signal, reference)
        )
    found = _Alignment(signal, reference, rate / by).lines(expected and expected / by)
    return tuple(
        ClockLine(
            by * one.first_row, by * one.offset_rows - one.slope * (by - 1) / 2, one.slope,
            by * one.residual_rows, one.unexplained,
        )
        for one in found
    )  # fmt: skip


class _Place(NamedTuple):
    """Where a reference lies: lines of one slope, from some first rows on.

    Offsets (k,) hold at the middle of the reference.
    """

    slope: float
    offsets: FloatArray
    firsts: IntArray = np.zeros(1, np.int64)


class _Alignment:
    """The search of lines for one signal (t,) and one reference (u,)."""

    def __init__(self, signal: FloatArray, reference: FloatArray, rate: float) -> None:
        features = MemoryState(signal[:1], rate).steps(signal[:, None])[:, :, 0]
        # The running mean of the features trails; that of the reference trails as far.
        trail = max(1, round(0.5 * rate))
        self.fine = np.column_stack([np.ones(len(signal)), features])
        self.features = _trailing(self.fine, COARSE)
        self.reference = _trailing(reference, trail)
        self.rows = np.arange(0, len(reference), COARSE)
        self.coarse = _trailing(self.reference, COARSE)
        self.middle = len(reference) / 2
        self.wide = max(len(reference) // WINDOWS, 100)  # rows of a window

    def left(self, positions: FloatArray, *, least: float = OVERLAP) -> float:
        """Share of the reference's variance that features at these rows leave unexplained."""
        index = np.rint(positions).astype(np.int64)
        inside = (index >= 0) & (index < len(self.features))
        if inside.sum() < least * len(index):
            return np.inf
        own, wanted = self.features[index[inside]], self.coarse[self.rows[inside]]
        wanted = wanted - wanted.mean()
        square = own.T @ own
        square[np.diag_indices_from(square)] += 1e-6 * len(own)
        toward = own.T @ wanted
        power = float(wanted @ wanted)
        if power <= 0:
            return np.inf
        return max(1.0 - float(toward @ np.linalg.solve(square, toward)) / power, 1e-9)

    def cost(self, at: _Place) -> float:
        """What the search makes small."""
        # Clocks rather go alike and begin together: decides where the misfit does not.
        beyond = max(abs(at.offsets[0]) - abs(len(self.features) - len(self.reference)) / 2, 0.0)
        far = PRIOR * ((at.slope / 0.01) ** 2 + (beyond / 500.0) ** 2)
        return float(np.log(self.left(self.places(self.rows, at))) + far)

    def places(self, rows: IntArray, at: _Place) -> FloatArray:
        """Rows of the skin that belong to rows of the reference."""
        which = np.maximum(np.searchsorted(at.firsts, rows, side="right") - 1, 0)
        return rows + at.offsets[which] + at.slope * (rows - self.middle)

    def lines(self, expected: float | None) -> tuple[ClockLine, ...]:
        """The best lines."""
        found = self._without_wrong(self._finer(self._coarse()))
        while len(found.firsts) < 6 and (more := self._broken(found)):
            found = more
        left = self.left(self.places(self.rows, found), least=0.0)
        if expected is not None:
            alike = self.left(np.asarray(self.rows + expected, np.float64))
            if alike < CLEARLY * left:
                found, left = _Place(0.0, np.array([expected])), alike
        residual, slope = self._residual(found), float(found.slope)
        return tuple(
            ClockLine(int(first), float(offset - slope * self.middle), slope, residual, left)
            for first, offset in zip(found.firsts, found.offsets, strict=True)
        )

    def _coarse(self) -> _Place:
        count = len(self.reference)
        open_ends = abs(len(self.features) - count) / 2 + MOST_LAG * count
        most = max(LEAST_LAG, open_ends) // COARSE * COARSE
        lags = np.arange(-most, most + 1, COARSE) + (len(self.features) - count) / 2
        tried = [
            (self.cost(_Place(slope, np.array([lag]))), slope, lag)
            for slope in np.arange(-MOST_SLOPE, MOST_SLOPE + 1e-9, 0.002)
            for lag in lags
        ]
        best = [
            self._finer(_Place(slope, np.array([lag])), rough=True)
            for cost, slope, lag in sorted(tried)[:8]
            if np.isfinite(cost)
        ]
        if not best:
            raise InvalidArrayError("the reference and the samples overlap too little to align")
        return min(best, key=lambda one: (self.cost(one), one.slope, one.offsets[0]))

    def _finer(self, at: _Place, *, rough: bool = False) -> _Place:
        """Go downhill, by steps that shrink."""
        at = at._replace(offsets=at.offsets.astype(np.float64))
        best = self.cost(at)
        ends = np.append(at.firsts[1:], len(self.reference))
        centres = (at.firsts + ends) / 2 - self.middle  # lines turn about their own middle
        steps = ((1e-3, 10.0), (5e-4, 5.0)) if rough else ((5e-4, 5.0), (2e-4, 2.0), (1e-4, 1.0))
        for by_slope, by_rows in steps:
            for _ in range(20):
                tries = [
                    at._replace(slope=at.slope + turn, offsets=at.offsets - turn * centres)
                    for turn in (-by_slope, by_slope)
                ]
                for which in range(len(at.offsets)):
                    for move in (-by_rows, by_rows):
                        moved = at.offsets.copy()
                        moved[which] += move
                        tries.append(at._replace(offsets=moved))
                costs = [self.cost(one) for one in tries]
                least = int(np.argmin(costs))
                if costs[least] >= best:
                    break
                best, at = costs[least], tries[least]
        return at

    def _without_wrong(self, at: _Place) -> _Place:
        """Leave out a load that the skin never felt, where nearly all of the misfit is its own."""
        misfit = self._windows(at, level=True)
        least = misfit.min(axis=1)
        wrong = (least > WRONG * np.median(least)) & (least > 0.5 * misfit[:, REACH])
        rows, before = self.rows, self.cost(at)
        starts = self._starts()[wrong, None]
        inside = (rows >= starts) & (rows < starts + self.wide)
        self.rows = rows[~inside.any(axis=0)]
        without = self._finer(at)
        if self.cost(without) < before - np.log(FALSE):
            return without
        self.rows = rows
        return at

    def _starts(self) -> IntArray:
        """First row of each window."""
        return np.linspace(0, len(self.reference) - self.wide, WINDOWS).astype(np.int64)

    def _windows(self, place: _Place, *, level: bool = False) -> FloatArray:
        """Misfit (k, 2 REACH + 1) of each window at each lag, against the curve of all.

        A shift of a window's level is part of it with `level`.
        """
        rows = np.arange(len(self.reference))
        index = np.rint(self.places(rows, place)).astype(np.int64)
        inside = (index >= 0) & (index < len(self.fine))
        every = slice(None, None, 5)
        own, wanted = self.fine[index[inside]][every], self.reference[inside][every]
        curve = self.fine @ np.linalg.lstsq(own, wanted, rcond=None)[0]
        lags = np.arange(-REACH, REACH + 1)
        found = []
        for start in self._starts():
            here = slice(start, start + self.wide, 4)
            at = np.clip(index[here][None] + lags[:, None], 0, len(curve) - 1)
            away = self.reference[here][None] - curve[at]
            found.append((away**2).mean(axis=1) if level else away.var(axis=1))
        return np.array(found)

    def _residual(self, at: _Place) -> float:
        misfit = self._windows(at)
        sharp = np.quantile(misfit, 0.5, axis=1) - misfit.min(axis=1)
        best = np.argmin(misfit, axis=1).astype(np.float64)
        # Each window counts by how much its lag matters: a rest matches at any.
        return _middle(np.abs(best - _middle(best, sharp)), sharp)

    def _broken(self, at: _Place) -> _Place | None:
        """One more line, where rows were lost; None where that does not pay."""
        total = np.cumsum(self._windows(at), axis=0)
        before = total[:-1].min(axis=1)
        after = (total[-1] - total[:-1]).min(axis=1)
        order = np.argsort(before + after)
        for cut in order[:3]:
            if not 3 <= cut < WINDOWS - 4:
                continue
            first = round((cut + 1) * len(self.reference) / WINDOWS)
            which = int(np.searchsorted(at.firsts, first, side="right")) - 1
            lags = (int(np.argmin(total[cut])), int(np.argmin(total[-1] - total[cut])))
            if abs(lags[0] - lags[1]) < BREAK:
                continue
            offsets = np.insert(at.offsets, which + 1, at.offsets[which] + lags[1] - REACH)
            offsets[which] += lags[0] - REACH
            more = self._finer(_Place(at.slope, offsets, np.insert(at.firsts, which + 1, first)))
            for width in (80, 40, 20):  # rows by which the cut moves
                tries = []
                for steps in range(-4, 5):
                    moved = more.firsts.copy()
                    moved[which + 1] += steps * width
                    one = more._replace(firsts=moved)
                    tries.append((self.cost(one), abs(steps), one))
                more = self._finer(min(tries, key=lambda one: one[:2])[2])
            if self.cost(more) < self.cost(at) + np.log(GAIN):
                return more
        return None


def _middle(values: FloatArray, weights: FloatArray) -> float:
    """Median of values (k,) that count as much as their weights (k,)."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _trailing(values: FloatArray, wide: int) -> FloatArray:
    """Means over the last rows, fewer at the beginning."""
    total = np.cumsum(np.concatenate([np.zeros((1, *values.shape[1:])), values]), axis=0)
    rows = np.arange(1, len(values) + 1)
    first = np.maximum(rows - wide, 0)
    shape = (-1,) + (1,) * (values.ndim - 1)
    return (total[rows] - total[first]) / (rows - first).reshape(shape)

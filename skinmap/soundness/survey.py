"""One pass over the samples: what every later question about a recording is answered from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.soundness.track import Track

MOST_CELLS, LONGEST_CELL = 500, 64
SHORT = 250  # rows of a piece that one touch may fill
USUAL = 20.0  # percentile of the cells of a piece that stands for its rest
PIECES = 12  # of a recording, each with a rest of its own
BLOCK = 2**21  # values that are looked at together: they stay in the processor's cache
SIGMA_OF_SECOND = 0.5117  # of normal noise, per mean absolute second difference: sqrt(pi / 2 / 6)
TOUCHED = 6.0  # deviations of its noise from which a channel counts as touched
BOTH, AXES = 0.3, 0.3  # of the larger swing, and of the channels that swing so: axes of a force
AT_REST = 0.35  # share of its cells near its median
SPIKE = 3.0  # times as far as all else: a single value there is no load
ALONE = 0.8  # of its reach by which a spike differs from the rows beside it
FEW = 0.05  # of the channels: such single rows of theirs alone cast no doubt on themselves
FARTHER, RARER = 20.0, 10  # the same, and loads that last, where such rows may be loads themselves
GRADED = 0.15  # of it: what moves others by more, and by less than itself, is a tap
NOISES, STEPS = 50.0, 20.0  # that a recording reaches at least: single rows may be its only loads
PASSES = 6  # in which spikes are taken out, the farthest of each cell at a time


@dataclass(frozen=True, eq=False)
class Survey:
    """A recording in cells of some rows each.

    Attributes
    ----------
    track : Track
    cell : int
        Rows of a cell; the rows behind the last whole cell belong to it.
    changed : (t,) int
        Channels whose value differs from the row before; the first row counts as all.
    changes : (k, n) float
        Share of the steps in each cell at which a channel changed.
    mean, low, high, rough : (k, n) float32
        Of each cell: mean, extremes, and mean absolute second difference.
    gone : (t, n) bool or None
        Values that are not finite: each counts as the last one before it.
    spikes : (m, 2) int
        Row and channel of single values far outside the span, which count as gone.
    """

    track: Track
    cell: int
    changed: IntArray
    changes: NDArray[np.float32]
    mean: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    rough: NDArray[np.float32]
    gone: NDArray[np.bool_] | None
    spikes: IntArray

    @cached_property
    def missing(self) -> IntArray:
        """(n,) Values of each channel that are not finite."""
        return np.zeros(self.width, int) if self.gone is None else np.sum(self.gone, axis=0)

    @property
    def width(self) -> int:
        """Channels."""
        return self.track.values.shape[1]

    @property
    def count(self) -> int:
        """Rows."""
        return len(self.track.values)

    def column(self, channel: int) -> FloatArray:
        """All values of a channel."""
        return np.asarray(self.track.values[:, channel], np.float64)

    def rows_of_cells(self, first: int, last: int) -> tuple[int, int]:
        """First and last row of some cells."""
        end = self.count if last >= len(self.mean) - 1 else (last + 1) * self.cell
        return first * self.cell, end - 1

    def cell_of(self, rows: Any) -> Any:
        """Cell of rows."""
        return np.minimum(np.asarray(rows) // self.cell, len(self.mean) - 1)

    @cached_property
    def constant(self) -> NDArray[np.bool_]:
        """(n,) Whether a channel never changes."""
        silent = self.missing > 0.9 * self.count
        return np.asarray((self.high.max(axis=0) == self.low.min(axis=0)) | silent)

    @cached_property
    def span(self) -> NDArray[np.float32]:
        """(n,) How far apart the extremes of each channel are."""
        return np.asarray(self.high.max(axis=0) - self.low.min(axis=0))

    @cached_property
    def fast(self) -> FloatArray:
        """(k, n) Deviation of each cell from the running median of its channel."""
        return self._away(PIECES)

    def _away(self, several: int) -> FloatArray:
        """(k, n) Deviation of each cell from medians of some pieces."""
        pieces = np.array_split(np.arange(len(self.mean)), min(several, len(self.mean)))
        middle = np.array([np.median(self.mean[own], axis=0) for own in pieces])
        return self.mean - self._between(middle)

    def _between(self, levels: FloatArray) -> FloatArray:
        """(k, n) Levels (p, n) of pieces, at each cell."""
        several = len(levels)
        if several < 2:
            return np.broadcast_to(levels, self.mean.shape)
        middles = (np.arange(several) + 0.5) * len(self.mean) / several - 0.5
        at = np.clip(np.arange(len(self.mean)), middles[0], middles[-1])
        low = np.minimum(np.searchsorted(middles, at, side="right") - 1, several - 2)
        share = ((at - middles[low]) / (middles[1] - middles[0]))[:, None]
        return np.asarray(levels[low] * (1.0 - share) + levels[low + 1] * share)

    @cached_property
    def rising(self) -> bool:
        """Whether values rise under load: most channels reach far that way.

        Where all feel the same load, which may last, they begin at rest as well.
        """
        lively = ~self.constant if not self.constant.all() else slice(None)
        low, high = np.percentile(self.fast[:, lively], (0.5, 99.5), axis=0)
        reach = np.clip((high + low) / np.maximum(high - low, 1e-12), -0.8, 0.8)
        some = self.mean[:, lively]
        low, middle, high = np.percentile(some, (0.5, 50.0, 99.5), axis=0)
        size = np.maximum(high - low, 1e-12)
        steady = np.abs(some[[0, -1]] - middle).max(axis=0) < 0.25 * size  # it does not drift
        reach = reach + steady * np.clip((high + low - 2.0 * middle) / size, -0.8, 0.8)
        begin = 0.0
        if self.uniform:
            low, middle, high = np.percentile(some, (1.0, 50.0, 99.0), axis=0)
            size = np.maximum(high - low, 1e-12)
            reach = np.clip((high + low - 2.0 * middle) / size, -0.8, 0.8)
            first = np.median(some[:5], axis=0)
            begin = np.clip((high + low - 2.0 * first) / size, -1.0, 1.0)
        return bool(np.nansum(reach + begin) >= 0)

    @property
    def sign(self) -> float:
        """1 where values rise under load, else -1."""
        return 1.0 if self.rising else -1.0

    @cached_property
    def two_sided(self) -> bool:
        """Whether loads move channels either way: axes of a force or of a magnetic field."""
        lively = ~self.constant
        # A long touch turns medians of short pieces, a drift those of long ones.
        courses = [self._away(several)[:, lively] for several in (PIECES, 4, 1)]
        ends = [np.percentile(one, (0.5, 99.5), axis=0) for one in courses]
        low, high = np.min(np.abs(ends), axis=0)
        less, more = np.minimum(low, high), np.maximum(low, high)
        swings = more > self.floor[lively]
        both = swings & (less > BOTH * more) & (less > self.floor[lively])
        # Loads that are held for long leave no level that a channel comes back to.
        both &= (np.abs(courses[-1]) < self.floor[lively]).mean(axis=0) > AT_REST
        return bool(not self.uniform and both.sum() > max(AXES * swings.sum(), 3))

    @cached_property
    def quantum(self) -> float:
        """Smallest step between values of most channels; 0 for values that are not discrete."""
        steps = self.steps[(self.steps > 0) & ~self.constant]
        return float(np.median(steps)) if len(steps) else 0.0

    @cached_property
    def steps(self) -> FloatArray:
        """(n,) Smallest step between values of each channel, of up to 20,000 of its rows."""
        rows = np.unique(np.linspace(0, self.count - 1, min(self.count, 20_000)).astype(int))
        found = np.zeros(self.width)
        some = np.ascontiguousarray(self.track.values[rows].T)
        for channel in np.flatnonzero(~self.constant):
            kinds = np.unique(some[channel])
            if kinds.dtype.kind == "f":
                kinds = kinds[np.isfinite(kinds)].astype(np.float64)
            gaps = np.diff(kinds.astype(np.float64))
            if len(gaps):
                found[channel] = gaps.min()
        return found

    @cached_property
    def noise(self) -> FloatArray:
        """(n,) Standard deviation of each channel at rest, from its second differences."""
        return np.asarray(np.percentile(self.rough, 30.0, axis=0) * SIGMA_OF_SECOND, np.float64)

    @cached_property
    def usual_noise(self) -> float:
        """Noise of the median channel that changes at all."""
        own = self.noise[~self.constant]
        return float(np.median(own)) if len(own) else 0.0

    @cached_property
    def rest(self) -> FloatArray:
        """(n,) Level of each channel at rest: the calm side of its cells."""
        share = 50.0 if self.two_sided else 25.0 if self.rising else 75.0
        return np.asarray(np.percentile(self.mean, share, axis=0), np.float64)

    @cached_property
    def floor(self) -> FloatArray:
        """(n,) What a channel must deviate by to count as touched."""
        usual = float(np.median(self.span[~self.constant])) if (~self.constant).any() else 0.0
        own = np.maximum(self.noise, self.usual_noise)
        return np.maximum(TOUCHED * own, max(0.04 * usual, 1.5 * self.quantum))

    @property
    def short(self) -> bool:
        """Whether one touch may fill a piece."""
        return self.count < SHORT * min(PIECES, len(self.mean))

    @cached_property
    def levels(self) -> FloatArray:
        """(p, n) Level of each channel at rest in each of some pieces of the recording."""
        return self.levels_at(USUAL)

    def levels_at(self, share: float) -> FloatArray:
        """(p, n) The same at a percentile of the cells of each piece, from the calm side."""
        pieces = np.array_split(np.arange(len(self.mean)), min(PIECES, len(self.mean)))
        share = 50.0 if self.two_sided else share if self.rising else 100.0 - share
        level = np.array([np.percentile(self.mean[own], share, axis=0) for own in pieces])
        if not self.short:
            return level
        # A touch may last for such a piece: the calmest of three.
        wide = np.concatenate([level[:1], level, level[-1:]])
        calmest = np.minimum if self.rising else np.maximum
        return np.asarray(calmest.reduce([wide[:-2], wide[1:-1], wide[2:]]))

    @cached_property
    def follows(self) -> FloatArray:
        """(n,) Correlation of each channel with the median of the skin, over cells."""
        own = self.mean - self.mean.mean(axis=0)
        course = np.median(own[:, ~self.constant], axis=1)
        course = course - course.mean()
        size = np.linalg.norm(course) * np.linalg.norm(own, axis=0)
        return np.asarray(course @ own / np.maximum(size, 1e-12), np.float64)

    @cached_property
    def uniform(self) -> bool:
        """Whether all channels feel the same load, which comes and goes."""
        lively = ~self.constant
        if lively.sum() < 4 or np.median(np.abs(self.follows[lively])) < 0.8:
            return False
        course = np.median(self.mean[:, lively] - self.mean[0, lively], axis=1)
        pieces = [np.median(one) for one in np.array_split(course, min(PIECES, len(course)))]
        # A drift or a step goes one way; a load may, where a reference was pressed along.
        one_way = np.abs(np.diff(pieces)).sum() <= 1.5 * np.ptp(pieces)
        return bool(not one_way or self.track.reference is not None)

    @cached_property
    def loaded(self) -> bool:
        """Whether a load on the whole skin lasts, so that rest is not in each piece."""
        if not self.uniform:
            return False
        lively = ~self.constant
        level = np.median((self.levels - self.rest)[:, lively], axis=1)
        course = np.median((self.mean - self.rest)[:, lively], axis=1)
        rough = np.abs(np.diff(level)).sum() > 1.5 * np.ptp(level)
        rough |= self.track.reference is not None
        return bool(rough and np.ptp(level) > 0.1 * np.ptp(course))

    @cached_property
    def response(self) -> NDArray[np.float32]:
        """(k, n) Deviation of each cell from rest, which may drift, positive under load."""
        steady = self.loaded or len(self.mean) < 3 * PIECES
        rest = self.rest[None] if steady else self._between(self.levels)
        found = ((self.mean - rest) * self.sign).astype(np.float32)
        return np.abs(found) if self.two_sided else found

    @cached_property
    def touched(self) -> NDArray[np.bool_]:
        """(k, n) Whether a channel is touched in a cell."""
        far = self.response > self.floor
        peak = (self.high - self.mean) if self.rising else (self.mean - self.low)
        if self.two_sided:
            peak = np.maximum(self.high - self.mean, self.mean - self.low)
        return np.asarray(far | (self.response + peak > 1.5 * self.floor))

    @cached_property
    def calm(self) -> NDArray[np.bool_]:
        """(k,) Cells in which (almost) nothing is touched."""
        if self.constant.all():
            return np.ones(len(self.mean), bool)
        load = self.touched[:, ~self.constant].mean(axis=1)
        return np.asarray(load <= max(0.03, float(np.percentile(load, 15.0))))


def survey(track: Track) -> Survey:
    """Look once at every sample of a recording; again where spikes have to be taken out."""
    values = track.values
    gone = None
    if values.dtype.kind == "f" and not all(
        np.isfinite(values[start : start + 4096]).all() for start in range(0, len(values), 4096)
    ):
        gone = ~np.isfinite(values)
        track = replace(track, values=_held_over(values, gone))
    found = _looked(track, gone, np.zeros((0, 2), np.int64))
    for _ in range(PASSES):
        spikes = _spikes(found)
        if len(spikes) == 0:
            break
        out = np.zeros(values.shape, bool)
        out[tuple(spikes.T)] = True
        track = replace(track, values=_held_over(track.values, out))
        # A row of spikes repeats none, though it is held over.
        again = _looked(track, gone, np.concatenate([found.spikes, spikes]))
        found = replace(again, changed=found.changed)
    return found


def _held_over(values: NDArray[Any], gone: NDArray[np.bool_]) -> NDArray[Any]:
    """Values (t, n) with the last one before each that is gone, at the begin the first one."""
    found = values.copy()
    for channel in np.flatnonzero(gone.any(axis=0)):
        known = np.flatnonzero(~gone[:, channel])
        at = np.maximum(np.searchsorted(known, np.arange(len(values)), side="right") - 1, 0)
        found[:, channel] = values[known[at], channel] if len(known) else 0
    return found


def _spikes(survey: Survey) -> IntArray:
    """Rows and channels (m, 2) of one or two values far beyond all that lasts for longer."""
    middle = np.median(survey.mean, axis=0)
    reach = np.maximum(survey.high - middle, middle - survey.low)
    usual = max(NOISES * survey.usual_noise, STEPS * survey.quantum)
    if (reach > SPIKE * usual).any():
        usual = max(usual, _usual_reach(survey, middle))
    cells, channels = np.nonzero(reach > SPIKE * usual)
    if len(cells) == 0:
        return np.zeros((0, 2), np.int64)
    # The rows behind the last whole cell belong to it.
    rows = cells[:, None] * survey.cell + np.arange(2 * survey.cell)
    rows = np.minimum(rows, survey.count - 1)
    values, one = survey.track.values, np.arange(len(cells))
    away = np.abs(values[rows, channels[:, None]] - middle[channels, None])
    row, size = rows[one, away.argmax(axis=1)], away.max(axis=1)
    beside = row + np.array([[[-2], [-1]], [[1], [2]]])  # two before it, two behind it
    beside = np.where((beside < 0) | (beside >= survey.count), 2 * row - beside, beside)
    beside = np.clip(beside, 0, survey.count - 1)
    steps = np.abs(values[beside, channels].astype(np.float64) - values[row, channels])
    alone = steps.max(axis=1).min(axis=0) > ALONE * size
    alone &= np.maximum(steps[0, 1], steps[1, 0]) > ALONE * size  # of three rows the middle one
    lasting = reach[cells[~alone], channels[~alone]].max(initial=usual)
    kept = alone & (size > SPIKE * lasting)
    for at in np.flatnonzero(kept):  # a tap moves those around it too, by less
        near = np.abs(values[row[at]].astype(np.float64) - values[beside[0, 0, at]]) / size[at]
        kept[at] = np.count_nonzero((near > GRADED) & (near < ALONE)) < 2
    if kept.any():
        short, long, far = _loads(survey, 0.5 * usual)
        own = int(kept.sum())
        if own > long or len(np.unique(channels[kept])) > FEW * survey.width:
            own = 0  # not for certain the fault of a few channels among loads that last
        doubtful = np.full(len(row), 2 * (short - own) > long)
        if survey.track.events is not None and survey.track.labels:
            doubtful |= survey.track.events[row] >= 0
        kept &= ~doubtful | ((size > FARTHER * far) & (short < RARER * long))
    return np.unique(np.column_stack([row, channels])[kept], axis=0)


def _usual_reach(survey: Survey, middle: NDArray[np.float32]) -> float:
    """How far nearly all cells reach without the two farthest rows of each."""
    if survey.cell < 3:
        return 0.0
    several = max(BLOCK // (survey.cell * survey.width), 20)
    own = np.linspace(0, len(survey.mean) - 1, min(several, len(survey.mean))).astype(int)
    rows = own[:, None] * survey.cell + np.arange(survey.cell)
    away = np.abs(survey.track.values[rows] - middle)
    return float(np.percentile(np.partition(away, -3, axis=1)[:, -3], 99.0))


def _loads(survey: Survey, least: float) -> tuple[int, int, float]:
    """Loads of channels beyond a level: those of one or two rows, those that last, their reach.

    Noise around the level ends no load: beside a short one values lie below half of it.
    """
    rest, short, long, reach = survey.mean - survey.fast, 0, 0, least
    for start in range(0, survey.count, 4096):
        own = survey.track.values[start : start + 4096]
        away = np.abs(own - rest[survey.cell_of(start + np.arange(len(own)))])
        away = np.pad(away, ((1, 2), (0, 0)))
        before, at, behind, after = (away[k : k + len(own)] for k in range(4))
        lasting = np.minimum(np.minimum(at, behind), after)
        single = np.maximum(before, behind) < np.minimum(least, 0.5 * at)
        double = np.maximum(before, after) < np.minimum(least, 0.5 * np.maximum(at, behind))
        short += int(((at > least) & (single | (double & (behind > least)))).sum())
        long += int(((before <= least) & (lasting > least)).sum())
        reach = max(reach, float(lasting.max(initial=least)))
    return short, long, reach


def _looked(track: Track, gone: NDArray[np.bool_] | None, spikes: IntArray) -> Survey:
    """Figures of all cells, block by block."""
    values = track.values
    count, width = values.shape
    cell = int(np.clip(count // MOST_CELLS, 4, LONGEST_CELL))
    cells = max(count // cell, 1)
    cell = min(cell, count)
    parts: dict[str, NDArray[np.float32]] = {
        name: np.zeros((cells, width), np.float32)
        for name in ("changes", "mean", "low", "high", "rough")
    }
    changed = np.empty(count, np.int64)
    changed[0] = width
    several = max(BLOCK // max(cell * width, 1), 1)
    for first in range(0, cells, several):
        last = min(first + several, cells)
        end = count if last == cells else last * cell
        start = first * cell
        begin = max(start - 1, 0)
        own = values[begin:end]
        moved = own[1:] != own[:-1]
        changed[begin + 1 : end] = np.count_nonzero(moved, axis=1)
        if start == 0:
            moved = np.concatenate([moved[:1], moved])
        if gone is not None:
            moved |= gone[start:end]  # no number is another than any other
        _cells(values[start:end], moved, cell, {x: one[first:last] for x, one in parts.items()})
    if gone is not None:
        still = parts["high"].max(axis=0) == parts["low"].min(axis=0)
        lost = (gone | still).all(axis=1) & gone.any(axis=1)
        changed[lost | np.append(False, lost[:-1])] = width  # nor is the row behind such a one
    return Survey(track, cell, changed, gone=gone, spikes=spikes, **parts)


def _cells(
    block: NDArray[Any], moved: NDArray[np.bool_], cell: int, into: dict[str, NDArray[np.float32]]
) -> None:
    """Figures of whole cells of a block; the rows behind them count for the last cell."""
    cells, width = into["mean"].shape
    whole = block[: cells * cell].astype(np.float32, copy=False).reshape(cells, cell, width)
    into["changes"][:] = (
        moved[: cells * cell].reshape(cells, cell, width).mean(axis=1, dtype=np.float32)
    )
    into["mean"][:] = whole.mean(axis=1)
    into["low"][:] = whole.min(axis=1)
    into["high"][:] = whole.max(axis=1)
    if cell > 2:
        bend = whole[:, 2:] - whole[:, 1:-1]
        bend -= whole[:, 1:-1]
        bend += whole[:, :-2]
        into["rough"][:] = np.abs(bend, out=bend).mean(axis=1)
    tail = block[cells * cell :]
    if len(tail):
        into["low"][-1] = np.minimum(into["low"][-1], tail.min(axis=0))
        into["high"][-1] = np.maximum(into["high"][-1], tail.max(axis=0))
        behind = moved[cells * cell :].any(axis=0)
        into["changes"][-1] = np.maximum(into["changes"][-1], behind / cell)

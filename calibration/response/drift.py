"""Baselines that follow drift and never a touch.

A baseline adapts only while its taxel is free. While one is pressed, its baseline moves with the
common drift of the free channels of its module, as far as its own reading moves along with it:
warming skins stay calibrated under a hand, and a steady reading is not bent by neighbours that
drift alone. A touch is over when the reading falls by most of its height at once; what then
remains and could have drifted while it lasted is drift, and the baseline takes it over.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray

FREE = 2.5  # time constant of a free baseline [s]: a press rises quicker than drift by far
RELEASED = 0.25  # of a touch's height: a fall below it is the end of the touch
SETTLING = 0.5  # time constant after a release, while the reading may still creep [s]
LONG = 2.0  # a touch that lasts so long creeps [s]; drift is nothing in shorter ones
WALK = 0.05  # most that an own drift may be [counts/s]: 20 in ten minutes and half as much again
FEWEST = 3  # free taxels whose mean is the drift of a module; one thermal channel is enough
RIDGE = 1.0  # counts squared: a common drift below one count is taken over as it is


class DriftTracker:
    """Baselines of n channels through a stream of blocks.

    Parameters
    ----------
    baseline, threshold : (n,) float
        At the start [counts].
    sign : int
        1 where presses read higher.
    rate : float
        Samples a second.
    modules : (n,) int, optional
        Module of each channel; the whole skin drifts as one where it is not known.
    thermal : (n,) bool, optional
        Channels that feel temperature and no touch: always free, so they tell the drift of a
        module that is pressed all over.
    trusted : (n,) bool, optional
        Channels whose drift may speak for others: a dead one never drifts, a noisy one always.
    """

    def __init__(
        self,
        baseline: FloatArray,
        threshold: FloatArray,
        sign: int,
        rate: float,
        *,
        modules: IntArray | None = None,
        thermal: BoolArray | None = None,
        trusted: BoolArray | None = None,
    ) -> None:
        n = len(baseline)
        self.baseline = baseline.copy()
        self.threshold = threshold
        self.sign, self.rate = sign, rate
        self._tactile = np.ones(n, np.bool_) if thermal is None else ~thermal
        self._trusted = np.ones(n, np.bool_) if trusted is None else trusted
        self._module = np.zeros(n, np.int64)
        if modules is not None:
            self._module = np.unique(modules, return_inverse=True)[1].ravel()
        self._height = np.zeros(n)  # of the present touch [counts]; 0 while free
        self._held = np.zeros(n)  # how long it has lasted [s]
        self._settling = np.zeros(n)  # time left of what follows a release [s]
        self._before = baseline.copy()  # when the touch began
        self._drift = np.zeros(n)  # common drift since then [counts]
        self._sums = np.zeros((5, n))  # of 1, x, y, x x, x y; x the drift, y the reading

    def apply(self, samples: FloatArray) -> FloatArray:
        """Deviations (t, n) from the tracked baselines for the next samples (t, n) [counts]."""
        out = np.empty(samples.shape)
        for row, sample in enumerate(samples):
            out[row] = self._step(sample)
        return out

    def _step(self, sample: FloatArray) -> FloatArray:
        deviation = self.sign * (sample - self.baseline)
        begun = (deviation > self.threshold) & self._tactile & (self._height == 0)
        if begun.any():
            self._before[begun] = self.baseline[begun]
            self._drift[begun] = 0.0
            self._sums[:, begun] = 0.0
            self._height[begun] = deviation[begun]
            self._held[begun] = 0.0
        pressed = self._height > 0
        if pressed.any():
            self._release(sample, deviation, pressed)
            pressed = self._height > 0
        move = self._move(sample)
        if not pressed.any():
            self.baseline += move
        else:
            self._hold(sample, np.flatnonzero(pressed), move, ~pressed)
            self.baseline[~pressed] += move[~pressed]
        return np.asarray(self.sign * (sample - self.baseline))

    def _release(self, sample: FloatArray, deviation: FloatArray, pressed: BoolArray) -> None:
        """End the touches whose reading fell."""
        np.maximum(self._height, deviation, out=self._height, where=pressed)
        self._held[pressed] += 1.0 / self.rate
        own = WALK * self._held  # that the baseline may have drifted meanwhile
        over = pressed & (deviation < RELEASED * self._height)
        over &= deviation < self.threshold + own
        rows = np.flatnonzero(over)
        left = sample[rows] - self.baseline[rows]
        self.baseline[rows] += np.clip(left, -own[rows], own[rows])
        self._height[rows] = 0.0
        self._settling[rows] = np.where(self._held[rows] > LONG, SETTLING, 0.0)

    def _move(self, sample: FloatArray) -> FloatArray:
        """What a free baseline moves in this sample [counts]."""
        dt = 1.0 / self.rate
        move = (dt / FREE) * (sample - self.baseline)
        if self._settling.any():
            move[self._settling > 0] *= min(FREE / SETTLING, FREE / dt)
            np.maximum(self._settling - dt, 0.0, out=self._settling)
        return move

    def _hold(self, sample: FloatArray, held: IntArray, move: FloatArray, free: BoolArray) -> None:
        """Move the baselines of pressed taxels with the drift that they share."""
        self._drift[held] += self._common(move, free)[self._module[held]]
        old = held[self._held[held] > LONG]
        if len(old) == 0:
            return
        x, y = self._drift[old], sample[old] - self._before[old]
        sums = self._sums[:, old] + np.stack([np.ones_like(x), x, y, x * x, x * y])
        self._sums[:, old] = sums
        x_mean, y_mean, xx, xy = sums[1:] / sums[0]
        share = (xy - x_mean * y_mean + RIDGE) / (xx - x_mean**2 + RIDGE)
        self.baseline[old] = self._before[old] + np.clip(share, 0.0, 1.0) * x

    def _common(self, move: FloatArray, free: BoolArray) -> FloatArray:
        """Mean move of the free channels of each module, of the whole skin where they are few."""
        usable = free & self._trusted & (self._settling == 0)
        count = int(self._module.max(initial=0)) + 1
        heavy = np.where(self._tactile, 1.0, FEWEST) * usable
        total = np.bincount(self._module, heavy, minlength=count)
        limit = self.threshold / (FREE * self.rate)  # a free reading lies within its threshold
        drawn = np.bincount(self._module, heavy * np.clip(move, -limit, limit), minlength=count)
        everywhere = drawn.sum() / max(float(total.sum()), 1.0)
        return np.where(total >= FEWEST, drawn / np.maximum(total, 1.0), everywhere)

"""Features of a channel that remembers: its value, how far it lags behind, and what it forgets.

Foam answers a load late and lets go later: play operators follow the loop between loading and
unloading (Prandtl and Ishlinskii), slow means the creep. All are causal: a live stream and a
recording get the same features.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray

MEAN_SECONDS = 0.5  # of the running mean that steadies whole counts, unless another is asked for
RADII = (0.05, 0.125, 0.25, 0.5)  # of the play operators, in spans of a channel
SECONDS = (0.4, 2.0, 10.0)  # time constants of the slow means
FEATURES = 4 + len(RADII) + len(SECONDS)


class MemoryState:
    """Features of n channels, row after row.

    Parameters
    ----------
    start : (n,) array of float
        Values at rest, or the first ones, in spans: where each memory begins.
    rate : float
        Rows a second.
    seconds : float
        Of the running mean; 0 leaves the values as they are.
    """

    def __init__(self, start: FloatArray, rate: float, seconds: float = MEAN_SECONDS) -> None:
        start = np.asarray(start, np.float64)
        self._rate = rate
        self._window = np.tile(start, (max(1, round(seconds * rate)), 1))
        self._mean = start.copy()
        self._next = 0
        self._plays = np.tile(start, (len(RADII), 1))
        self._slow = np.tile(start, (len(SECONDS), 1))
        self._radii = np.array(RADII)[:, None]
        self._share = -np.expm1(-1.0 / (np.array(SECONDS) * rate))[:, None]

    def step(self, values: FloatArray) -> FloatArray:
        """Features (FEATURES - 1, n) after one more row of values (n,): all but the constant."""
        self._mean += (values - self._window[self._next]) / len(self._window)
        self._window[self._next] = values
        self._next = (self._next + 1) % len(self._window)
        if not self._next:  # rounding of differences does not add up
            self._mean = self._window.mean(axis=0)
        mean = self._mean
        np.clip(self._plays, mean - self._radii, mean + self._radii, out=self._plays)
        self._slow += self._share * (mean - self._slow)
        lags = np.vstack([self._plays, self._slow])
        return np.vstack([mean[None], mean[None] ** 2, mean[None] ** 3, mean - lags])

    def steps(self, values: FloatArray) -> FloatArray:
        """Features (t, FEATURES - 1, n) of rows (t, n) that follow: to the bit those of `step`."""
        means = self._means(values)
        found = np.empty((len(values), FEATURES - 1, values.shape[1]))
        lags, plays, slow = found[:, 3:], self._plays, self._slow
        way = np.empty_like(slow)
        for mean, own in zip(means, lags, strict=True):
            np.maximum(plays, mean - self._radii, out=plays)
            np.minimum(plays, mean + self._radii, out=plays)
            np.subtract(mean, slow, out=way)
            np.multiply(way, self._share, out=way)
            np.add(slow, way, out=slow)
            np.subtract(mean, plays, out=own[: len(RADII)])
            np.subtract(mean, slow, out=own[len(RADII) :])
        found[:, 0], found[:, 1], found[:, 2] = means, means**2, means**3
        return found

    def _means(self, values: FloatArray) -> FloatArray:
        """Running means (t, n), turn of the window by turn."""
        means, row = np.empty(values.shape), 0
        if len(self._window) == 1:  # nothing is averaged
            means[:], row = values, len(values)
        while row < len(values):
            now = values[row : row + len(self._window) - self._next]
            own, end = means[row : row + len(now)], self._next + len(now)
            own[:] = (now - self._window[self._next : end]) / len(self._window)
            own[0] += self._mean
            np.add.accumulate(own, out=own)
            self._window[self._next : end] = now
            self._next = end % len(self._window)
            if not self._next:  # rounding of differences does not add up
                own[-1] = self._window.mean(axis=0)
            self._mean, row = own[-1].copy(), row + len(now)
        return means

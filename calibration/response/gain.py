"""Gain curves: from counts to loads, piecewise linear, for pushing and for letting go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from skinmap.arrays import BoolArray, FloatArray, check_finite, freeze
from skinmap.errors import InvalidArrayError

KNOTS = 8
STANDS = 0.2  # of a load, that it moves by at most while it stands still
ALIKE = 0.9  # correlation of loads and answers that are the same but late
FEWEST = 6  # samples of a branch that a curve is fitted to


@dataclass(frozen=True, eq=False, slots=True)
class ReferenceLoads:
    """Samples under known loads.

    Attributes
    ----------
    samples : (t, n) float
        [counts].
    loads : (t, n) float
        In any unit, of which pressures are then; 0 where a taxel was not loaded.
    """

    samples: FloatArray
    loads: FloatArray

    def __post_init__(self) -> None:
        samples = check_finite(self.samples, "reference samples", (None, None))
        loads = check_finite(self.loads, "reference loads", (len(samples), samples.shape[1]))
        if not len(samples):
            raise InvalidArrayError("the reference has no samples")
        if (loads < 0).any():
            raise InvalidArrayError(f"loads must not be negative, got {loads.min()}")
        freeze(self, samples=samples, loads=loads)


@dataclass(frozen=True, eq=False, slots=True)
class Gain:
    """Curves of n taxels over common loads.

    Attributes
    ----------
    knots : (k,) float
        Loads, from 0 upwards.
    counts : (n, 2, k) float
        Answer at each load when pushing (0) and when letting go (1), not decreasing; NaN for a
        taxel without a curve.
    """

    knots: FloatArray
    counts: FloatArray

    def __post_init__(self) -> None:
        knots = check_finite(self.knots, "knots", (None,))
        counts = np.asarray(self.counts, np.float64)
        if counts.ndim != 3 or counts.shape[1:] != (2, len(knots)):
            raise InvalidArrayError(
                f"counts must have shape (n, 2, {len(knots)}), got {counts.shape}"
            )
        freeze(self, knots=knots, counts=counts)

    def loads(self, answer: FloatArray, falling: BoolArray | None = None) -> FloatArray:
        """Loads (t, n) for answers (t, n) in counts, on the branch for letting go where `falling`.

        Taxels without a curve share the median one; beyond the last knot the last slope goes on.
        """
        curves = self._curves()
        pushing = _inverse(answer, curves[:, 0], self.knots)
        if falling is None or not falling.any():
            return pushing
        return np.where(falling, _inverse(answer, curves[:, 1], self.knots), pushing)

    def _curves(self) -> FloatArray:
        """Curves (n, 2, k) with the median one where there was none."""
        missing: BoolArray = np.asarray(np.isnan(self.counts).any(axis=(1, 2)))
        if not missing.any():
            return self.counts
        if missing.all():
            raise InvalidArrayError("no taxel has a gain curve: no load reached any of them")
        common = np.median(self.counts[~missing], axis=0)
        return np.where(missing[:, None, None], common, self.counts)


def _inverse(answer: FloatArray, counts: FloatArray, knots: FloatArray) -> FloatArray:
    """Loads (t, n) for answers (t, n) on curves (n, k) that do not decrease.

    A flat piece is a jump of the load: it is joined to the next one that rises.
    """
    out = np.zeros_like(answer)
    low, load = counts[:, 0].copy(), np.full(len(counts), knots[0])
    slope = np.zeros(len(counts))
    for k in range(1, len(knots)):
        rise = counts[:, k] - low
        up = rise > 0
        slope = np.where(up, (knots[k] - load) / np.where(up, rise, 1.0), slope)
        # Each piece adds what the answer covers of it.
        out += np.where(up, slope, 0.0) * np.clip(answer - low, 0.0, rise)
        low, load = np.where(up, counts[:, k], low), np.where(up, knots[k], load)
    return np.asarray(out + knots[0] + slope * np.maximum(answer - low, 0.0))


class BranchFollower:
    """Whether loads rise or fall, through a stream of blocks.

    An answer turns when it comes back from its last extreme by more than the play: noise alone
    does not change the branch.
    """

    def __init__(self, play: FloatArray) -> None:
        self._play = play
        self._middle = np.zeros_like(play)
        self._falling = np.zeros(len(play), np.bool_)

    def apply(self, answer: FloatArray) -> BoolArray:
        """Which of the answers (t, n) [counts] are on the way down (t, n)."""
        out = np.empty(answer.shape, np.bool_)
        for row, now in enumerate(answer):
            middle = np.clip(self._middle, now - self._play, now + self._play)
            moved = middle != self._middle
            self._falling = np.where(moved, middle < self._middle, self._falling)
            self._middle = middle
            out[row] = self._falling
        return out


def fit_gain(reference: ReferenceLoads, baseline: FloatArray, sign: int) -> Gain:
    """Monotone curves through the reference loads of each taxel (pool adjacent violators).

    Parameters
    ----------
    reference : ReferenceLoads
        Samples (t, n) [counts] and the loads (t, n) that they were taken under.
    baseline : (n,) float
        Readings at rest [counts].
    sign : int
        1 where harder presses read higher, -1 where they read lower.

    Returns
    -------
    Gain
        Curves of n taxels, for pushing and for letting go.

    Examples
    --------
    >>> import numpy as np
    >>> from calibration.response import ReferenceLoads, fit_gain
    >>> loads = np.linspace(0.0, 10.0, 50)[:, None] * np.ones(3)
    >>> gain = fit_gain(ReferenceLoads(20.0 + 9.0 * loads, loads), np.full(3, 20.0), 1)
    >>> gain.counts.shape
    (3, 2, 8)
    """
    answer = sign * (reference.samples - baseline)
    knots = np.linspace(0.0, float(reference.loads.max(initial=0.0)), KNOTS)
    falling = _falling(reference.loads)
    counts = np.full((answer.shape[1], 2, KNOTS), np.nan)
    for taxel in range(answer.shape[1]):
        load = reference.loads[:, taxel]
        for branch, rows in enumerate((~falling[:, taxel], falling[:, taxel])):
            own = rows & (load > 0)
            if own.sum() >= FEWEST:
                counts[taxel, branch] = _curve(load[own], answer[own, taxel], knots)
        push, release = counts[taxel]
        counts[taxel] = np.where(np.isnan(counts[taxel]), np.stack([release, push]), counts[taxel])
    return Gain(knots, counts)


def explained(gain: Gain, reference: ReferenceLoads, baseline: FloatArray, sign: int) -> FloatArray:
    """Share of the answers of each taxel (n,) that its curve explains; NaN without a curve."""
    answer = sign * (reference.samples - baseline)
    falling = _falling(reference.loads)
    found = np.full(answer.shape[1], np.nan)
    for taxel in np.flatnonzero(np.isfinite(gain.counts).all(axis=(1, 2))):
        rows = reference.loads[:, taxel] > 0  # foam creeps back after them
        load, own = reference.loads[rows, taxel], answer[rows, taxel]
        push, release = (np.interp(load, gain.knots, one) for one in gain.counts[taxel])
        left = own - np.where(falling[rows, taxel], release, push)
        # One load that stands still teaches as well: its answer counts from rest.
        whole = own - own.mean() if np.ptp(load) > STANDS * load.max() else own
        found[taxel] = 1.0 - (left @ left) / max(float(whole @ whole), 1e-12)
    return found


def lag_of(reference: ReferenceLoads, baseline: FloatArray, sign: int) -> int:
    """Rows that the loads come after the answers at which both look alike; 0 without such."""
    answer = (sign * (reference.samples - baseline)).mean(axis=1)
    load = reference.loads.mean(axis=1)
    load, answer = load - load.mean(), answer - answer.mean()
    together = correlate(load, answer)
    alike = together.max() > ALIKE * np.sqrt((load @ load) * (answer @ answer))
    return int(together.argmax()) - len(load) + 1 if alike else 0


def _falling(loads: FloatArray) -> BoolArray:
    """Samples whose load fell last: a step that holds stays on its branch."""
    change = np.sign(np.diff(loads, axis=0, prepend=0.0))
    last = np.where(change != 0, np.arange(len(loads))[:, None], 0)
    last = np.maximum.accumulate(last, axis=0)
    return np.asarray(np.take_along_axis(change, last, axis=0) < 0)


def _curve(load: FloatArray, answer: FloatArray, knots: FloatArray) -> FloatArray:
    """Piecewise linear through (0, 0), least squares, then made monotone by pooling."""
    from sklearn.isotonic import IsotonicRegression

    place = np.interp(load, knots, np.arange(len(knots)))
    left = np.minimum(place.astype(np.int64), len(knots) - 2)
    share = place - left
    design = np.zeros((len(load), len(knots)))
    design[np.arange(len(load)), left] = 1.0 - share
    design[np.arange(len(load)), left + 1] += share
    weight = design.sum(axis=0)
    # Second differences hold the knots that no load came near: a straight line between others.
    bend = np.diff(np.eye(len(knots)), 2, axis=0) * 1e-3 * np.sqrt(weight.max())
    rows = np.concatenate([design, bend])[:, 1:]  # no load, no answer: the first knot is 0
    values = np.concatenate([answer, np.zeros(len(bend))])
    counts = np.concatenate([[0.0], np.linalg.lstsq(rows, values, rcond=None)[0]])
    isotonic = IsotonicRegression(y_min=0.0)
    return np.asarray(
        isotonic.fit_transform(np.arange(len(knots)), counts, sample_weight=weight + 1e-3)
    )

"""Fits pressures of taxels to evidence: a ladder of models, each judged on held-out stretches.

Linear, a monotone cubic, and one with hysteresis (play operators and slow means) are compared by
sums of squares alone, so that no feature of a recording has to be kept. A taxel that does better by
the shape that all share, scaled to it, takes that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.clock_lines import UNEXPLAINED, ClockLine, align, following, reference_at
from skinmap.errors import InvalidArrayError
from skinmap.memory_features import FEATURES, MEAN_SECONDS, RADII, MemoryState
from skinmap.touch.load_calibration import (
    REST_CALM,
    REST_DOUBT,
    REST_SECONDS,
    SHRINK,
    LoadCalibration,
    Warmth,
    calm_rests,
    chunks,
    skin_level,
)

LADDER = ("linear", "cubic", "hysteresis")
MEANS = (MEAN_SECONDS, 0.25, 0.1, 0.0)  # that are tried [s]: a longer one blunts brief loads
TRIED, BETTER = 12, 0.97  # taxels that they are tried on; error that a shorter one must leave
EVERY = 5  # rows from one that is fitted to the next: neighbours tell the same
MOST_ROWS = 20_000  # that ranges of counts are taken from
FOLDS = 5  # stretches of a recording of which each is held out
LEAST_SPAN = 3.0  # counts from rest to the top: below it a taxel tells too little
LEAST_SPREAD = 0.5  # counts: below it a taxel is dead
AT_REST = 0.05  # share of the range of a load that a reference may stand off at rest
SEEN_AT_REST = 0.02  # of it, that is not worth a note: noise and creep
WARMER = 0.8  # of the square of what rest wanders, that may be left with a temperature
# Channels of two recordings may have another order where the ratios of their gains have a standard
# deviation above `APART` (over days of an insole .075), on `LEAST_ALIKE` taxels or more. They have
# the same where the gains correlate by `ALIKE` (.6 over days of 7.5 %; 0 in another order) and by
# `CHANCE` standard deviations of a correlation by chance.
APART, LEAST_ALIKE = 0.13, 8
ALIKE, CHANCE = 0.3, 2.0
# Chambers of like range read the same counts alike (over days of an insole within 7 %).
MOST_OFF, MOST_OFF_FAR, LIKE_RANGE = 1.25, 2.0, 1.6
HALF_INSIDE = 0.6745  # standard deviations either way that hold half
FULL_ROWS, FULL_RANGE = 0.1, 0.3  # a taxel is saturated that stands still at its end in so many
# rows while the load goes through so much of its range
# Ridge a row: of the cubic, the plays and the slow means.
RIDGE = np.array([0.0] + [1e-4] * 3 + [1e-2] * len(RADII) + [1e-3] * (FEATURES - 4 - len(RADII)))


@dataclass(frozen=True, eq=False, slots=True)
class Pressed:
    """One recording whose channels felt a known pressure.

    Attributes
    ----------
    name : str
        Of its file.
    samples : (t, n) array
        Raw counts.
    rate : float
        Samples a second.
    reference : (u,) array of float
        [bar] at the same rate, on its own clock.
    channels : (k,) array of int, optional
        Which channels felt it; all without.
    thermal : (n,) array of int, optional
        Channel with the temperature of each channel's module, -1 for none.
    lost : (t,) array of bool, optional
        Rows without a sample of their own, which teach nothing.
    timed : bool
        Whether the reference came with times of its own.
    """

    name: str
    samples: FloatArray
    rate: float
    reference: FloatArray
    channels: IntArray | None = None
    thermal: IntArray | None = None
    lost: BoolArray | None = None
    timed: bool = False


class Sums(NamedTuple):
    """Sums of squares (FOLDS, n, FEATURES, FEATURES), products with the reference and its own."""

    square: FloatArray
    toward: FloatArray
    power: FloatArray
    rows: FloatArray

    def whole(self) -> Sums:
        """Those of all folds."""
        return Sums(*(values.sum(axis=0) for values in self))


@dataclass(frozen=True, eq=False, slots=True)
class LoadFit:
    """A calibration, and how it came about.

    Attributes
    ----------
    calibration : LoadCalibration
    clocks : list of tuple of ClockLine
        Of each file.
    held_out : dict of str to float
        Median error of each model on held-out stretches [bar].
    dead, stray : (k,) int
        Taxels that never moved, and that did not follow the skin.
    unloaded : (k,) int
        Taxels that no evidence pressed.
    shared : int
        Taxels that took the shape of all.
    at_rest : list of float
        Reading of the reference of each file while the skin rested [bar]; 0 where it is as good.
    moved : list of float
        Share of its range by which the rest of a taxel moves in each file, median.
    """

    calibration: LoadCalibration
    clocks: list[tuple[ClockLine, ...]]
    held_out: dict[str, float]
    dead: list[int]
    stray: list[int]
    shared: int
    at_rest: list[float] = field(default_factory=list)
    moved: list[float] = field(default_factory=list)
    unloaded: list[int] = field(default_factory=list)


def fit_load(
    evidence: Sequence[Pressed],
    *,
    when: float = 0.0,
    area_mm2: float = float("nan"),
    fingerprint: str = "",
) -> LoadFit:
    """Fit the pressures of all taxels.

    Parameters
    ----------
    evidence : sequence of Pressed
        One or more recordings of the same n channels.
    when : float
        Time of the evidence [s since 1970].
    area_mm2 : float
        Of a taxel, which forces need.
    fingerprint : str
        Of the skin.

    Returns
    -------
    LoadFit

    Examples
    --------
    >>> import numpy as np
    >>> load = np.interp(np.arange(5000), np.arange(0, 5000, 100),
    ...                  np.random.default_rng(1).uniform(0, 2, 50))
    >>> counts = (240 - np.outer(load, np.linspace(20, 30, 8))).round()
    >>> fit = fit_load([Pressed("press.npz", counts, 50.0, load)])
    >>> int(fit.calibration.answered.sum()), bool(np.nanmax(fit.calibration.error) < 0.05)
    (8, True)

    Raises
    ------
    InvalidArrayError
        Clocks that do not align, no taxel that follows, a reference that is not zero at rest, or
        recordings that contradict each other.
    """
    first = evidence[0]
    n = first.samples.shape[1]
    lines = [_aligned(one) for one in evidence]
    wanted = [
        reference_at(line, one.reference, len(one.samples))
        for one, line in zip(evidence, lines, strict=True)
    ]
    for one, reference in zip(evidence, wanted, strict=True):
        reference[np.zeros(len(reference), bool) if one.lost is None else one.lost] = np.nan
    warmth = _warmth(evidence, wanted)
    if warmth is not None:
        evidence = [replace(one, samples=warmth.corrected(one.samples)) for one in evidence]
    told = np.zeros(n, bool)
    dead = np.ones(n, bool)
    for one in evidence:
        own = np.arange(n) if one.channels is None else np.asarray(one.channels, np.int64)
        every = max(EVERY, len(one.samples) // MOST_ROWS)
        moves = one.samples[::every].astype(np.float32).std(axis=0) > LEAST_SPREAD
        dead &= ~moves
        told[own[np.isin(own, own[following(one.samples[:, own])])]] = True
    told &= ~dead
    if warmth is not None:
        told[np.unique(warmth.channel[warmth.channel >= 0])] = False
    rest, span, recovery, rested = np.zeros(n), np.ones(n), np.zeros(n), False
    shifts, at_rest, moved, known = [], [], [], np.zeros(n, bool)
    for one, reference in zip(evidence, wanted, strict=True):
        own_rest, own_span, own_recovery, begins, stood = _scales(
            one, reference, told & _felt(one, n)
        )
        at_rest.append(stood)
        moved.append(_moved(one, reference, told & _felt(one, n), own_span))
        rested |= begins
        told &= ~_saturated(one, reference, told & _felt(one, n))
        turned = told & known & _felt(one, n)
        if turned.any() and np.median(np.sign(own_span * span)[turned]) < 0:
            raise InvalidArrayError(
                f"{one.name} contradicts {first.name}: under load the counts of one fall and "
                "those of the other rise"
            )
        new = _felt(one, n) & ~known
        rest[new], recovery[new] = own_rest[new], own_recovery[new]
        known |= new
        wider = _felt(one, n) & (np.abs(own_span) > np.abs(span))
        span[wider] = own_span[wider]
        shifts.append(np.where(known, own_rest - rest, 0.0))
    told &= np.abs(span) >= LEAST_SPAN
    span = np.where(np.abs(span) < LEAST_SPAN, LEAST_SPAN, span)
    mean_s = _mean_seconds(evidence, wanted, told, rest, shifts, span)
    sums = [
        _sums(one, reference, rest + shift, span, mean_s)
        for one, reference, shift in zip(evidence, wanted, shifts, strict=True)
    ]
    if len(sums) > 1:
        _agree(evidence, sums, told, span)
    total = Sums(*(np.sum(same, axis=0) for same in zip(*sums, strict=True)))
    fit = _solved(
        total, told, dead, lines, rest, span, recovery,
        top=np.nanmax([np.nanmax(one) for one in wanted]), rested=rested, rate=first.rate,
        when=when, area_mm2=area_mm2, fingerprint=fingerprint, mean_s=mean_s,
    )  # fmt: skip
    felt = np.any([_felt(one, n) for one in evidence], axis=0)
    fit = replace(
        fit,
        at_rest=at_rest,
        moved=moved,
        dead=[k for k in fit.dead if felt[k]],
        stray=[k for k in fit.stray if felt[k]],
        unloaded=np.flatnonzero(~felt).tolist(),
    )
    if warmth is None:
        return fit
    stray = sorted({*fit.stray} - {*warmth.channel.tolist()})
    return replace(fit, calibration=replace(fit.calibration, warmth=warmth), stray=stray)


def _warmth(evidence: Sequence[Pressed], wanted: Sequence[FloatArray]) -> Warmth | None:
    """Effect of temperatures on rest, of taxels whose rest they explain on stretches left out."""
    channel = evidence[0].thermal
    if channel is None:
        return None
    own = np.flatnonzero(channel >= 0)
    rests = []
    for one, reference in zip(evidence, wanted, strict=True):
        held = np.nanquantile(reference, 0.02) + AT_REST * np.ptp(reference[np.isfinite(reference)])
        rests.append(one.samples[np.flatnonzero(reference <= held)].astype(np.float64))
    usual = rests[0].mean(axis=0)[channel]
    slope = np.zeros(len(channel))
    away = [rows - rows.mean(axis=0) for rows in rests]
    folds = [fold for rows in away for fold in np.array_split(rows, FOLDS) if len(fold)]
    square = np.array([(fold[:, channel] ** 2).sum(axis=0) for fold in folds])
    toward = np.array([(fold[:, channel] * fold).sum(axis=0) for fold in folds])
    power = np.array([(fold**2).sum(axis=0) for fold in folds])
    others = np.maximum(square.sum(axis=0) - square, 1e-9)
    left = (toward.sum(axis=0) - toward) / others
    error = (power - 2 * left * toward + left**2 * square).sum(axis=0)
    rows = sum(len(fold) for fold in folds)
    good = own[(error < WARMER * power.sum(axis=0))[own] & (square.sum(axis=0) > rows)[own]]
    slope[good] = toward.sum(axis=0)[good] / square.sum(axis=0)[good]
    return Warmth(np.where(np.isin(np.arange(len(channel)), good), channel, -1), slope, usual)


def _mean_seconds(
    evidence: Sequence[Pressed], wanted: Sequence[FloatArray], told: BoolArray, rest: FloatArray,
    shifts: Sequence[FloatArray], span: FloatArray,
) -> float:  # fmt: skip
    """The running mean [s] with the least error on held-out stretches of a few taxels."""
    left, rows = dict.fromkeys(MEANS, 0.0), slice(0, MOST_ROWS)
    for one, reference, shift in zip(evidence, wanted, shifts, strict=True):
        own = np.flatnonzero(told & _felt(one, len(told)))
        own = own[:: max(1, len(own) // TRIED)][:TRIED]
        few = Pressed(one.name, one.samples[rows][:, own], one.rate, one.reference)
        for seconds in MEANS:
            sums = _sums(few, reference[rows], (rest + shift)[own], span[own], seconds)
            whole = sums.whole()
            left[seconds] += sum(_left_out("hysteresis", sums, whole, k) for k in range(len(own)))
    return best_mean(left)


def best_mean(left: Mapping[float, float]) -> float:
    """The running mean [s] with the least error; of about the same errors the longer one."""
    best = MEAN_SECONDS
    for seconds, error in left.items():
        best = seconds if error < BETTER * left[best] else best
    return best


def _felt(one: Pressed, n: int) -> BoolArray:
    """Channels (n,) that felt the load of a recording."""
    return np.isin(np.arange(n), np.arange(n) if one.channels is None else one.channels)


def _aligned(one: Pressed) -> tuple[ClockLine, ...]:
    own = one.samples if one.channels is None else one.samples[:, one.channels]
    try:
        lines = align(own, one.reference, rate=one.rate)
        check_lines(one, lines)
    except InvalidArrayError as error:
        words = str(error).removeprefix(f"{one.name}: ")
        raise InvalidArrayError(f"{one.name}: {words}{_at_one_end(own)}") from error
    return lines


def _at_one_end(samples: FloatArray) -> str:
    """A hint where most channels that move stand at one of their ends in many rows."""
    few = samples[:: max(1, len(samples) // MOST_ROWS)]
    few = few[:, few.std(axis=0) > LEAST_SPREAD]
    stand = np.maximum(*((few == end).mean(axis=0) for end in (few.min(axis=0), few.max(axis=0))))
    count = int((stand > FULL_ROWS).sum())
    if not 2 * count > few.shape[1]:
        return ""
    return f"; {count} of {few.shape[1]} channels stand at one end of their counts: saturated?"


def check_lines(one: Pressed, lines: tuple[ClockLine, ...]) -> None:
    """Refuse clocks of a file that do not align."""
    if lines[0].unexplained > UNEXPLAINED:
        advice = "" if one.timed else "; give reference_times if the rates of both differ"
        raise InvalidArrayError(
            f"{one.name}: the clocks do not align: at the best lag the skin explains "
            f"{100 * (1 - lines[0].unexplained):.0f} % of the reference, "
            f"{100 * (1 - UNEXPLAINED):.0f} % are needed{advice}"
        )


def _saturated(one: Pressed, reference: FloatArray, told: BoolArray) -> BoolArray:
    """Taxels (n,) that stand at their last count while the load goes on; most of them: an error."""
    every = max(EVERY, len(reference) // MOST_ROWS)
    known = reference[::every]
    few, known = one.samples[::every][np.isfinite(known)], known[np.isfinite(known)]
    found = np.zeros(few.shape[1], bool)
    high = known > np.median(known)
    for k in np.flatnonzero(told):
        end = few[:, k].max() if few[high, k].mean() > few[~high, k].mean() else few[:, k].min()
        at = known[few[:, k] == end]
        wide = np.ptp(np.quantile(at, (0.05, 0.95)))
        found[k] = len(at) > FULL_ROWS * len(few) and wide > FULL_RANGE * np.ptp(known)
    if 2 * found.sum() > told.sum():
        raise InvalidArrayError(
            f"{one.name}: {found.sum()} of {told.sum()} taxels are saturated: their counts stand "
            "at one end while the load goes on"
        )
    return found


def _scales(
    one: Pressed, reference: FloatArray, told: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray, bool, float]:
    """Rest before load, signed span and recovery of each channel [counts]; whether it was seen.

    The last is what the reference reads at rest [bar].
    """
    every = max(EVERY, len(reference) // MOST_ROWS)
    few, known = one.samples[::every], reference[::every]
    good = np.isfinite(known)
    few, known = few[good].astype(np.float64), known[good]
    idle = known <= np.quantile(known, 0.02) + 0.02 * np.ptp(known)
    full = known >= np.quantile(known, 0.98)
    rest, loaded = np.median(few[idle], axis=0), np.median(few[full], axis=0)
    sign = np.where(loaded < rest, -1.0, 1.0)
    ends = np.percentile(few, (0.1, 99.9), axis=0)
    before, after, stood = None, None, 0.0
    if told.any():
        width = np.maximum(np.abs(loaded - rest), 1.0) * sign
        level = skin_level(one.samples, told, rest, width)
        before, after = calm_rests(one.samples, level, one.rate)
        # A load that holds still at an end is no rest.
        held = np.quantile(known, 0.02) + AT_REST * np.ptp(known)
        edge = max(2, round(REST_SECONDS * one.rate))
        first, last = (
            np.nanmin(np.append(own, np.inf)) for own in (reference[:edge], reference[-edge:])
        )
        before = None if np.isfinite(first) and first > held else before
        after = None if np.isfinite(last) and last > held else after
        stood = _stood(one.name, reference, level, (before is not None, after is not None), edge)
    recovery = np.zeros(len(rest))
    if before is not None:
        rest = before
        if after is not None:
            recovery = after - before
            if np.median((recovery * sign)[told]) < 0.0:  # no foam rises above its rest: it moved
                rest, recovery = rest + recovery / 2.0, np.zeros(len(rest))
    span = np.where(sign < 0, ends[0], ends[1]) - rest
    return rest, np.where(span * sign > 0, span, sign), recovery, before is not None, stood


def _moved(one: Pressed, reference: FloatArray, told: BoolArray, span: FloatArray) -> float:
    """Median share of its span by which a taxel's rest moves from the first half of rests on."""
    idle = np.nanquantile(reference, 0.02) + AT_REST * (np.nanmax(reference) - np.nanmin(reference))
    halves = np.array_split(one.samples[reference <= idle], 2)
    if not told.any() or len(halves[1]) < EVERY:
        return 0.0
    first, second = (np.median(half[:, told], axis=0) for half in halves)
    return float(np.median(np.abs(second - first) / np.abs(span[told])))


def _stood(
    name: str, reference: FloatArray, level: FloatArray, rests: tuple[bool, bool], edge: int
) -> float:
    """What a reference reads [bar] while the skin rests before load, else after it.

    0 where neither is seen, or where it is as good as zero.
    """
    known = np.flatnonzero(np.isfinite(reference))
    wide = float(np.ptp(reference[known]))
    ends = [(known[:edge], level[:edge]), (known[-edge:], level[-edge:])]
    reads = [float(np.median(reference[rows])) for rows, _ in ends]
    if min(reads) > np.quantile(reference[known], 0.98) - AT_REST * wide:
        raise InvalidArrayError(
            f"{name}: the reference begins and ends at its highest, {max(reads):.3g} bar: does it "
            "fall under load? A recording begins and ends with rest, which reads 0"
        )
    calm = (
        read
        for seen, (rows, own), read in zip(rests, ends, reads, strict=True)
        if seen and abs(np.median(level[rows]) - np.median(own)) < REST_CALM
    )
    found = next(calm, 0.0)
    if abs(found) > AT_REST * wide:
        raise InvalidArrayError(
            f"{name}: the reference reads {found:.3g} bar while the skin rests, "
            f"{100 * abs(found) / wide:.0f} % of its range: an absolute pressure, no tare, or the "
            "other sign?"
        )
    return found if abs(found) > SEEN_AT_REST * wide else 0.0


def _sums(
    one: Pressed, reference: FloatArray, rest: FloatArray, span: FloatArray, mean_s: float
) -> Sums:
    """Go through a recording once."""
    n = len(rest)
    square = np.zeros((FOLDS, n, FEATURES, FEATURES))
    toward = np.zeros((FOLDS, n, FEATURES))
    power, rows = np.zeros((FOLDS, n)), np.zeros((FOLDS, n))
    state = None
    for part in chunks(len(one.samples)):
        scaled = (one.samples[part] - rest) / span
        state = state or MemoryState(scaled[0], one.rate, mean_s)
        found = state.steps(scaled)[::EVERY].transpose(2, 0, 1)  # (n, rows, features)
        known = reference[part][::EVERY]
        fold = (np.arange(part.start, part.start + len(scaled), EVERY)) * FOLDS * 4
        fold = fold // max(len(one.samples), 1) % FOLDS  # each fold has four stretches
        for which in np.unique(fold):
            use = (fold == which) & np.isfinite(known)
            if not use.any():
                continue
            own = np.concatenate([np.ones((n, int(use.sum()), 1)), found[:, use]], axis=2)
            square[which] += own.transpose(0, 2, 1) @ own
            toward[which] += known[use] @ own
            power[which] += known[use] @ known[use]
            rows[which] += use.sum()
    keep = _felt(one, n).astype(np.float64)
    return Sums(square * keep[:, None, None], toward * keep[:, None], power * keep, rows * keep)


def _weights(model: str, square: FloatArray, toward: FloatArray, rows: float) -> FloatArray:
    """Weights (FEATURES,) of a model of one taxel from its sums."""
    count = {"linear": 2, "cubic": 4, "hysteresis": FEATURES}[model]
    found = np.zeros(FEATURES)
    if model == "cubic":
        return _monotone(square, toward)
    own = square[:count, :count] + rows * np.diag(RIDGE[:count])
    own[np.diag_indices(count)] += 1e-9 * rows
    found[:count] = np.linalg.solve(own, toward[:count])
    return found


# Rising cubics on 0 to 1: a constant, and sums of Bernstein polynomials with weights above 0.
RISING = np.array([[1.0, 0, 0, 0], [0, 3, -3, 1], [0, 0, 3, -2], [0, 0, 0, 1]])


def _monotone(square: FloatArray, toward: FloatArray) -> FloatArray:
    """Weights of the cubic that rises everywhere."""
    basis = np.vstack([RISING[:1], -RISING[:1], RISING[1:]])  # the constant of either sign
    inner = basis @ square[:4, :4] @ basis.T
    inner[np.diag_indices(5)] += 1e-9 * max(float(inner[0, 0]), 1.0)
    factor = np.linalg.cholesky(inner)
    parts, _ = nnls(factor.T, np.linalg.solve(factor, basis @ toward[:4]))
    found = np.zeros(FEATURES)
    found[:4] = parts @ basis
    return found


def _error(weights: FloatArray, square: FloatArray, toward: FloatArray, power: float) -> float:
    """Sum of squared errors."""
    return max(float(power - 2 * weights @ toward + weights @ square @ weights), 0.0)


def _solved(
    sums: Sums, told: BoolArray, dead: BoolArray, lines: list[tuple[ClockLine, ...]],
    rest: FloatArray, span: FloatArray, recovery: FloatArray, *,
    top: float, rested: bool, rate: float, when: float, area_mm2: float, fingerprint: str,
    mean_s: float,
) -> LoadFit:  # fmt: skip
    """Choose the model by its held-out error, and fit it on all."""
    n = len(rest)
    told &= sums.rows.sum(axis=0) >= 20 * FEATURES
    own = np.flatnonzero(told)
    if not len(own):
        raise InvalidArrayError(
            "no taxel follows the reference: "
            f"{int(dead.sum())} of {n} never move, the others do not go with it"
        )
    whole = sums.whole()
    errors = {name: np.full(n, np.nan) for name in LADDER}
    memoryless = np.full(n, np.nan)
    for k in own:
        for name in LADDER:
            errors[name][k] = np.sqrt(_left_out(name, sums, whole, int(k)) / whole.rows[k])
        weights = _monotone(whole.square[k], whole.toward[k])
        memoryless[k] = np.sqrt(
            _error(weights, whole.square[k], whole.toward[k], float(whole.power[k])) / whole.rows[k]
        )
    held_out = {name: float(np.nanmedian(errors[name])) for name in LADDER}
    model = min(LADDER, key=lambda name: held_out[name])
    weights = np.full((n, FEATURES), np.nan)
    for k in own:
        weights[k] = _weights(model, whole.square[k], whole.toward[k], float(whole.rows[k]))
    error = errors[model].copy()
    shared = _share(weights, error, whole, own)
    # A quiet recording hides how far sessions differ.
    least = REST_DOUBT * float(np.median(top / np.abs(span[own]))) * (1 if rested else 2)
    calibration = LoadCalibration(
        weights, rest, span, recovery, np.full(n, top), error,
        doubt=max(float(SHRINK * np.nanmedian(memoryless)), least), rate=rate, model=model,
        shift=np.zeros(n), zeroed=when, area_mm2=area_mm2, fingerprint=fingerprint, mean_s=mean_s,
    )  # fmt: skip
    return LoadFit(
        calibration, lines, held_out, np.flatnonzero(dead).tolist(),
        np.flatnonzero(~told & ~dead).tolist(), shared,
    )  # fmt: skip


def _left_out(model: str, sums: Sums, whole: Sums, k: int) -> float:
    """Sum of squared errors of taxel k, each fold by the weights of the others."""
    left = 0.0
    for fold in range(FOLDS):
        square, toward = sums.square[fold, k], sums.toward[fold, k]
        rows = float(whole.rows[k] - sums.rows[fold, k])
        weights = _weights(model, whole.square[k] - square, whole.toward[k] - toward, rows)
        left += _error(weights, square, toward, float(sums.power[fold, k]))
    return left


def _share(weights: FloatArray, error: FloatArray, whole: Sums, own: IntArray) -> int:
    """Give taxels the shape of all, scaled, where that does better than their own held out."""
    shape = np.median(weights[own], axis=0)
    changed = 0
    for k in own:
        size = shape @ whole.square[k] @ shape
        scaled = shape * float(shape @ whole.toward[k] / max(size, 1e-12))
        left = _error(scaled, whole.square[k], whole.toward[k], float(whole.power[k]))
        now = np.sqrt(left / whole.rows[k])
        if now < error[k]:
            weights[k], error[k] = scaled, now
            changed += 1
    return changed


def _agree(
    evidence: Sequence[Pressed], sums: Sequence[Sums], told: BoolArray, span: FloatArray
) -> None:
    """Refuse recordings of which one's curves mistake the other's loads."""
    own = np.flatnonzero(told)
    curves = []
    for one in sums:
        square, toward = one.square.sum(axis=0), one.toward.sum(axis=0)
        rows = one.rows.sum(axis=0)
        curves.append({k: _monotone(square[k], toward[k]) for k in own if rows[k] > 20 * FEATURES})
    for i, first in enumerate(curves):
        for j in range(i + 1, len(curves)):
            both = [k for k in first if k in curves[j]]
            if not both:
                continue
            heights = np.array([1.0, 0.5, 0.25, 0.125])
            pair = np.array([[one[k][:4] @ heights for one in (first, curves[j])] for k in both])
            each = np.maximum(pair[:, 1], 1e-9) / np.maximum(pair[:, 0], 1e-9)
            ratio = float(np.median(each))
            # Forces press unevenly, each time elsewhere: only a chamber shows gains of taxels.
            even = evidence[i].channels is None and evidence[j].channels is None
            wide = [float((own.power.sum() / own.rows.sum()) ** 0.5) for own in (sums[i], sums[j])]
            most = MOST_OFF if even and max(wide) < LIKE_RANGE * min(wide) else MOST_OFF_FAR
            if not 1.0 / most < ratio < most:
                raise InvalidArrayError(
                    f"{evidence[i].name} and {evidence[j].name} contradict each other: where the "
                    f"first reads 1 bar, the second reads {ratio:.2g} bar at the same counts"
                )
            apart = float(np.median(np.abs(np.log(each / ratio)))) / HALF_INSIDE
            if not even or len(both) < LEAST_ALIKE or apart <= APART:
                continue
            # Gains may differ that much from day to day, but a taxel with a high one keeps it.
            rank = np.argsort(np.argsort(pair / np.abs(span[both])[:, None], axis=0), axis=0)
            if np.corrcoef(rank.T).min() < max(ALIKE, CHANCE / np.sqrt(len(both))):
                raise InvalidArrayError(
                    f"{evidence[i].name} and {evidence[j].name} contradict each other: gains of "
                    f"the taxels differ by {100 * apart:.0f} % from one to the other, and high "
                    "ones of one are not high in the other: are their channels in the same order?"
                )

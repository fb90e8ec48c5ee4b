"""Loads by a force/torque sensor behind the skin, and areas by prints.

Gains of taxels come from force and moment over the mesh.

The sensor feels the sum of pressure times normal over the curved surface, and its moment about the
origin of the link. A gain for each taxel, held to the gain of all, makes that sum; how strongly it
is held is chosen on stretches of the recording that are left out.

Area and spread of contacts from touches whose print is known: a stamp, ink, a picture of glass.

Pressure reaches taxels through foam and covers more than what touches. The covered skin grows by
4 pi s^2 of a spread with standard deviation s, which is found beside a gain of all areas.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.stats import t

from calibration.response.load_fit import (
    FOLDS,
    LEAST_SPAN,
    MEANS,
    LoadFit,
    Pressed,
    best_mean,
    check_lines,
)
from skinmap.arrays import BoolArray, FloatArray
from skinmap.clock_lines import align, reference_at
from skinmap.errors import InvalidArrayError
from skinmap.io.recordings.load_evidence import LoadEvidence
from skinmap.live.response.loads import FELT, SPREAD, PartForces, heaviest_load
from skinmap.memory_features import FEATURES
from skinmap.skin.skin import Skin
from skinmap.touch.load_calibration import (
    GAIN_SD,
    NORMAL_90,
    REST_DOUBT,
    ROUND,
    WANDER,
    Covering,
    LoadCalibration,
)
from skinmap.touch.prepared_skin import PreparedSkin

HELD = (0.003, 0.03, 0.3, 3.0, 30.0)  # tried: of the mean square of a taxel's own force
PASCALS = 1e5  # a bar
IDLE = 0.02  # of the range of the force: below it nothing is touched
HARDEST = 0.95  # share of the touched taxels whose highest counts lie below the range of all
PRESSED = 0.1  # of its span: a taxel above it is pressed
COUNT_NOISE = 0.5  # counts


def fit_wrench(one: Pressed, skin: Skin, *, when: float = 0.0, fingerprint: str = "") -> LoadFit:
    """Fit the pressures of a part's taxels to a wrench.

    Parameters
    ----------
    one : Pressed
        Its reference is (u, 6): force [N], moment about the origin of the link [N m], of either
        sign.
    skin : Skin
        Of n taxels, with its mesh.

    Returns
    -------
    LoadFit
        A linear model; taxels that were hardly touched have no pressure.

    Raises
    ------
    InvalidArrayError
        Clocks that do not align, or a wrench that the skin does not explain.
    """
    forces = PartForces(PreparedSkin(skin))
    counts, n = one.samples.astype(np.float64), len(skin)
    middle = np.median(counts, axis=0)
    size = np.linalg.norm(one.reference[:, :3] - np.median(one.reference[:, :3], axis=0), axis=1)
    active = np.abs(counts - middle).sum(axis=1, keepdims=True)
    try:
        lines = align(active, size, rate=one.rate)
    except InvalidArrayError as error:
        raise InvalidArrayError(f"{one.name}: {error}") from error
    check_lines(one, lines)
    wrench = np.column_stack([reference_at(lines, c, len(counts)) for c in one.reference.T])
    known = np.isfinite(wrench).all(axis=1)
    known &= True if one.lost is None else ~one.lost
    idle = active[:, 0] <= np.quantile(active, 0.02) + IDLE * np.ptp(active)
    rest = np.median(counts[idle], axis=0)
    wrench -= np.median(wrench[idle & known], axis=0)
    away = counts - rest
    ends = np.percentile(away, (0.1, 99.9), axis=0)
    falls = -ends[0].sum() > ends[1].sum()
    span = np.where(np.abs(ends[0 if falls else 1]) < 1, 1.0, ends[0 if falls else 1])
    touched = (span < 0) == falls
    touched &= np.abs(span) >= LEAST_SPAN
    if not touched.any():
        raise InvalidArrayError(f"{one.name}: no taxel moves: nothing to lay the wrench on")
    radius = float(np.sqrt((skin.positions**2).sum(axis=1).mean()))
    sums = np.hstack([forces.vectors, forces.moments / radius])[touched] * PASCALS
    signed = away[:, touched] * np.sign(span[touched])
    told = wrench[known] / [1, 1, 1, *[radius] * 3]
    tried = {
        seconds: _Tried.of(_averaged(signed, seconds * one.rate)[known], told, sums)
        for seconds in MEANS
    }
    mean_s = best_mean({seconds: one.left for seconds, one in tried.items()})
    square, toward, common, held, left, power = tried[mean_s]
    felt = _averaged(signed, mean_s * one.rate)[known]
    rows = len(felt)
    if left > 0.2 * power:
        raise InvalidArrayError(
            f"{one.name}: the skin explains {100 * (1 - left / power):.0f} % of the wrench, 80 % "
            "are needed: is it in the frame of the link, its moment about the link's origin?"
        )
    gains = _gains(square, toward, common, held)
    ridge = held * float(np.mean(np.diag(square)))
    doubt = np.diag(np.linalg.inv(square + ridge * np.eye(len(gains))))
    # Neighbouring rows tell the same: a second of them counts as one.
    spread = np.sqrt(doubt * left / rows * one.rate)
    pressed = felt > PRESSED * np.abs(span[touched])
    level = np.sqrt((felt**2 * pressed).sum(axis=0) / np.maximum(pressed.sum(axis=0), 1))
    away_share = np.hypot(spread, gains * np.sqrt(left / power))
    # One shape for all: a taxel that was touched lightly answers as far as those touched hard do,
    # and the doubt of its gain grows with its range.
    wide = np.maximum(np.abs(span[touched]), np.quantile(np.abs(span[touched]), HARDEST))
    level *= wide / np.abs(span[touched])
    span[touched] = np.sign(span[touched]) * wide
    own_error = np.full(n, np.nan)
    own_error[touched] = np.hypot(away_share * level, COUNT_NOISE * gains)
    weights = np.full((n, FEATURES), np.nan)
    top = np.full(n, float((gains * np.abs(span[touched])).max()))
    weights[touched] = 0.0
    weights[touched, 1] = gains * np.abs(span[touched])
    top[touched] = np.maximum(weights[touched, 1], 1e-3)
    calibration = LoadCalibration(
        weights, rest, span, np.zeros(n), top, own_error,
        doubt=REST_DOUBT * float(np.median(gains)), rate=one.rate, model="linear",
        shift=np.zeros(n), zeroed=when, fingerprint=fingerprint, mean_s=mean_s,
    )  # fmt: skip
    dead = np.ptp(ends, axis=0) < 1
    idle_ones = ~touched & ~dead & (np.ptp(ends, axis=0) < 2 * LEAST_SPAN)  # noise alone
    return LoadFit(
        calibration, [lines], {"linear": float(np.median(own_error[touched]))},
        np.flatnonzero(dead).tolist(), np.flatnonzero(~touched & ~dead & ~idle_ones).tolist(),
        int((spread > 0.5 * gains).sum()), unloaded=np.flatnonzero(idle_ones).tolist(),
    )  # fmt: skip


def _averaged(counts: FloatArray, rows: float) -> FloatArray:
    """Running mean of counts (t, k), with the lag that a calibration reads them with."""
    wide = max(1, round(rows))
    total = np.cumsum(np.pad(counts, ((wide, 0), (0, 0))), 0)
    return np.asarray((total[wide:] - total[:-wide]) / wide)


class _Tried(NamedTuple):
    """Equations of the gains with one running mean, and their error on held-out folds (`left`)."""

    square: FloatArray
    toward: FloatArray
    common: float
    held: float
    left: float
    power: float

    @classmethod
    def of(cls, felt: FloatArray, told: FloatArray, sums: FloatArray) -> _Tried:
        """Of counts (t, k), wrenches (t, 6) and the wrench of a count (k, 6)."""
        fold = np.arange(len(felt)) * FOLDS * 4 // len(felt) % FOLDS
        parts = [_sums(felt[fold == k], told[fold == k], sums) for k in range(FOLDS)]
        square = np.sum([part[0] for part in parts], 0)
        toward = np.sum([part[1] for part in parts], 0)
        power = float(sum(part[2] for part in parts))
        common = float(toward.sum() / square.sum())
        if common < 0:  # the sensor feels the reaction
            toward, common = -toward, -common
            parts = [(own, -to, size) for own, to, size in parts]
        tried = {}
        for held in HELD:
            tried[held] = 0.0
            for own, to, part_power in parts:
                gains = _gains(square - own, toward - to, common, held)
                tried[held] += float(part_power - 2 * gains @ to + gains @ own @ gains)
        held = min(tried, key=tried.__getitem__)
        return cls(square, toward, common, held, max(tried[held], 0.0), power)


def _sums(
    felt: FloatArray, told: FloatArray, sums: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Squares (n, n) and products (n,) of the gains' equations, and the wrench's own square."""
    return (
        (felt.T @ felt) * (sums @ sums.T),
        ((felt.T @ told) * sums).sum(axis=1),
        float((told**2).sum()),
    )


def _gains(square: FloatArray, toward: FloatArray, common: float, held: float) -> FloatArray:
    """Gains (n,) [bar a count], none below 0, held to the gain of all."""
    ridge = held * float(np.mean(np.diag(square)))
    own = square + ridge * np.eye(len(square))
    factor = np.linalg.cholesky(own)
    found, _ = nnls(factor.T, np.linalg.solve(factor, toward + ridge * common))
    return np.asarray(found)


LEAST = 5  # prints that are needed
VARIED = 1.5  # largest print over the smallest from which the spread is found beside the gain
FELT_COUNTS = 3.0  # that a taxel of a touch moves by at least
DAYS = 8  # that are drawn for each print
WORST = 1.0  # scatter of the logarithm of areas from which prints are refused


class PrintFit(NamedTuple):
    """Prints that taught, and the median error of each by the others."""

    covering: Covering
    prints: int
    error: float


def fit_prints(
    evidence: Sequence[LoadEvidence], calibration: LoadCalibration, skin: Skin
) -> PrintFit:
    """Fit how pressures of a skin cover areas.

    Parameters
    ----------
    evidence : sequence of LoadEvidence
        Of prints, on the n taxels of the skin.
    calibration : LoadCalibration
        Of the same taxels.
    skin : Skin

    Returns
    -------
    PrintFit

    Raises
    ------
    InvalidArrayError
        Too few prints that are felt, or areas that pressures do not follow.
    """
    forces = PartForces(PreparedSkin(skin), calibration.answered, Covering(0.0, 1.0, 0.0))
    pairs = np.array([pair for one in evidence for pair in _felt(one, calibration, forces)])
    if len(pairs) < LEAST:
        raise InvalidArrayError(
            f"{evidence[0].name}: {len(pairs)} prints are felt, {LEAST} are needed"
        )
    guess, true, days = pairs[:, 0], pairs[:, 1], pairs[:, 2:]
    left = np.array([
        _predicted(guess[k], _fitted(np.delete(guess, k), np.delete(true, k))) / true[k]
        for k in range(len(true))
    ])  # fmt: skip
    gain, spread = _fitted(guess, true)
    free = len(true) - 2
    doubt = float(
        np.sqrt((np.log(np.maximum(left, 1e-9)) ** 2).mean()) * t.ppf(0.95, free) / NORMAL_90
    )
    if doubt > WORST or gain <= 0:
        raise InvalidArrayError(
            f"{evidence[0].name}: the areas of pressed taxels do not follow the prints: are they "
            "in mm2, one for each touch of `events`?"
        )
    error = float(np.median(np.abs(left - 1.0)))
    # Prints of one session share its zero and gains: another day's area differs by them as well.
    moved = np.log(_predicted(days, (gain, spread)) / _predicted(guess, (gain, spread))[:, None])
    doubt = float(np.hypot(doubt, np.sqrt(np.nanmean(moved**2))))
    return PrintFit(Covering(spread, gain, doubt), len(true), error)


def _felt(
    one: LoadEvidence, calibration: LoadCalibration, forces: PartForces
) -> Iterator[tuple[float, ...]]:
    """Area of the pressed taxels, of the print, and the first on `DAYS` others, of each touch [m2].

    Touches that are not felt are left out; days on which one is not are NaN.
    """
    found = np.stack(calibration.pressures(one.samples, one.times))
    rng = np.random.default_rng(0)
    for k, area in enumerate(1e-6 * one.reference):
        own = found[:, one.events == k]
        highest = own[0].max(axis=0, initial=0.0)
        taxels = highest > max(FELT * np.nanmax(highest), FELT_COUNTS * calibration.count_bar)
        felt = _area(own, calibration, forces, taxels) if taxels.any() else np.nan
        if np.isnan(felt):
            continue
        days, half = [], own[2] - own[0]
        # A shared shift is taken over only as far as it exceeds its doubt: at most that is left.
        for shared in rng.uniform(-calibration.doubt, calibration.doubt, DAYS):
            gains, zeros = rng.normal(0.0, 1.0, (2, len(calibration)))
            zeros = shared + WANDER * calibration.count_bar * zeros
            other = np.maximum(own[0] * (1.0 + GAIN_SD * gains) + zeros, 0.0)
            other = np.stack([other, np.maximum(other - half, 0.0), other + half])
            days.append(_area(other, calibration, forces, taxels))
        yield felt, float(area), *days


def _area(
    found: FloatArray, calibration: LoadCalibration, forces: PartForces, taxels: BoolArray
) -> float:
    """Area of one touch on some taxels (n,) by values, low and high (3, t, n) [bar]."""
    every = np.arange(found.shape[1])
    load = heaviest_load(forces, calibration, (found[0], found[1], found[2]), every, taxels)
    return float("nan") if load.refused else load.area.value


def _fitted(guess: FloatArray, true: FloatArray) -> tuple[float, float]:
    """Gain of areas and spread [m] with the least relative errors."""
    if true.max() > VARIED * true.min():
        gain, less = nnls(np.column_stack([guess, -np.ones(len(guess))]) / true[:, None],
                          np.ones(len(guess)))[0].tolist()  # fmt: skip
        return gain, float(np.sqrt(less / max(gain, 1e-12) / (ROUND * 4.0 * np.pi)))
    return float(np.median(true / _predicted(guess, (1.0, SPREAD)))), SPREAD


def _predicted(guess: FloatArray, fitted: tuple[float, float]) -> FloatArray:
    return Covering(fitted[1], fitted[0], 0.0).area(guess)

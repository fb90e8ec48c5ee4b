"""Area and spread of contacts from touches whose print is known: a stamp, ink, a picture of glass.

Pressure reaches taxels through foam and covers more than what touches. The covered skin grows by
4 pi s^2 of a spread with standard deviation s, which is found beside a gain of all areas.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.stats import t

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.io.recordings.load_evidence import LoadEvidence
from skinmap.live.contacts.contact_forces import FELT, SPREAD, PartForces
from skinmap.live.response.loads import heaviest_load
from skinmap.skin.skin import Skin
from skinmap.touch.load_calibration import NORMAL_90, ROUND, Covering, LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin

LEAST = 5  # prints that are needed
VARIED = 1.5  # largest print over the smallest from which the spread is found beside the gain
FELT_COUNTS = 3.0  # that a taxel of a touch moves by at least
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
    guess, true = pairs.T
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
    return PrintFit(Covering(spread, gain, doubt), len(true), error)


def _felt(
    one: LoadEvidence, calibration: LoadCalibration, forces: PartForces
) -> Iterator[tuple[float, float]]:
    """Area of the pressed taxels, and of the print, for each touch that is felt [m2]."""
    found = calibration.pressures(one.samples, one.times)
    for k, area in enumerate(1e-6 * one.reference):
        rows = np.flatnonzero(one.events == k)
        highest = found[0][rows].max(axis=0, initial=0.0)
        taxels = highest > max(FELT * np.nanmax(highest), FELT_COUNTS * calibration.count_bar)
        if taxels.any():
            load = heaviest_load(forces, calibration, found, rows, taxels)
            if not load.refused:
                yield load.area.value, float(area)


def _fitted(guess: FloatArray, true: FloatArray) -> tuple[float, float]:
    """Gain of areas and spread [m] with the least relative errors."""
    if true.max() > VARIED * true.min():
        gain, less = nnls(np.column_stack([guess, -np.ones(len(guess))]) / true[:, None],
                          np.ones(len(guess)))[0].tolist()  # fmt: skip
        return gain, float(np.sqrt(less / max(gain, 1e-12) / (ROUND * 4.0 * np.pi)))
    return float(np.median(true / _predicted(guess, (1.0, SPREAD)))), SPREAD


def _predicted(guess: FloatArray, fitted: tuple[float, float]) -> FloatArray:
    return Covering(fitted[1], fitted[0], 0.0).area(guess)

"""What the sensors make of a load: gains, dead taxels, drift, noise, saturation, rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray
from skinmap.errors import InvalidArrayError

FULL_SCALE = 160.0  # counts at the middle of a pad of strength 1
DRIFT_TIME = 20.0  # the baseline forgets in this time [s]


@dataclass(frozen=True, slots=True)
class Sensing:
    """How taxels answer.

    Attributes
    ----------
    rate : float
        Samples a second; the iCub sends 50.
    foam : float
        Spread of the pressure through the foam, standard deviation [m].
    noise : float
        Standard deviation of a sample [counts].
    gain_spread : float
        Standard deviation of the taxels' gains, 0.15 = 15 %.
    drift : float
        Standard deviation of the slow wandering of each taxel's baseline [counts].
    dead : float
        Share of the taxels that always send 0.
    saturation : float
        No taxel sends more [counts].
    bits : int
        Resolution: 8 bits are steps of one count, 4 bits steps of 16.
    """

    rate: float = 50.0
    foam: float = 2.5e-3
    noise: float = 1.2
    gain_spread: float = 0.15
    drift: float = 0.5
    dead: float = 0.0
    saturation: float = 255.0
    bits: int = 8

    def __post_init__(self) -> None:
        for name in ("noise", "gain_spread", "drift", "dead", "foam", "rate", "saturation"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InvalidArrayError(f"{name} must be finite and not negative, got {value}")
        if not 0 < self.rate <= 10_000 or self.foam == 0:
            raise InvalidArrayError(
                f"rate must lie in 0..10000 and foam above 0, got {self.rate} and {self.foam}"
            )
        if self.dead > 1 or self.saturation > 255 or not 1 <= self.bits <= 8:
            raise InvalidArrayError(
                "dead is a share of 0..1, saturation at most 255 counts and bits 1..8, "
                f"got {self.dead}, {self.saturation} and {self.bits}"
            )


class Sensors:
    """The taxels of one skin: their gains and baselines, drawn once.

    Parameters
    ----------
    count : int
    sensing : Sensing
    rng : numpy.random.Generator
    """

    def __init__(self, count: int, sensing: Sensing, *, rng: np.random.Generator) -> None:
        self.sensing = sensing
        self.gains: FloatArray = np.clip(rng.normal(1.0, sensing.gain_spread, count), 0.4, 1.6)
        self.dead: BoolArray = np.zeros(count, bool)
        self.dead[rng.permutation(count)[: round(sensing.dead * count)]] = True
        self._baseline = rng.normal(0.0, sensing.drift, count)

    def read(self, loads: FloatArray, *, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Counts (t, n) of loads (t, n), 1 = a firm finger; time goes on from call to call."""
        sensing = self.sensing
        keep = np.exp(-len(loads) / sensing.rate / DRIFT_TIME)
        # Ornstein-Uhlenbeck, stepped once a call and straight in between: it is slow.
        fresh = rng.normal(0.0, sensing.drift, len(self.gains))
        after = keep * self._baseline + np.sqrt(1.0 - keep**2) * fresh
        along = np.linspace(0.0, 1.0, len(loads))[:, None]
        counts = FULL_SCALE * loads * self.gains + self._baseline + along * (after - self._baseline)
        self._baseline = after
        counts += rng.normal(0.0, sensing.noise, counts.shape)
        step = 2.0 ** (8 - sensing.bits)
        counts = step * np.rint(np.clip(counts, 0.0, sensing.saturation) / step)
        counts[:, self.dead] = 0.0
        return np.minimum(counts, 255.0).astype(np.uint8)

"""What is known of a simulated touch that goes on in time: its way, its beats and its speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, check_finite, freeze

NOTHING = np.zeros((0, 3))


@dataclass(frozen=True, eq=False, slots=True)
class TrueMotion:
    """The truth of one touch in time.

    Attributes
    ----------
    onsets, ends : (k,) float
        When each press begins and ends [s]: one of a stroke, several of a double pat.
    times : (p,) float
        Of the places [s]; none where the touch stays.
    places : (p, 3) float
        Where the middle of the hand was on the skin, in the link's frame [m].
    turned : float
        How far it was twisted [rad].
    """

    onsets: FloatArray
    ends: FloatArray
    times: FloatArray
    places: FloatArray
    turned: float = 0.0

    def __post_init__(self) -> None:
        onsets = check_finite(self.onsets, "onsets", (None,))
        times = check_finite(self.times, "times", (None,))
        ends = check_finite(self.ends, "ends", onsets.shape)
        places = check_finite(self.places, "places", (len(times), 3))
        freeze(self, onsets=onsets, ends=ends, times=times, places=places)

    @property
    def steps(self) -> FloatArray:
        """(p - 1,) lengths between the places [m]."""
        return np.asarray(np.linalg.norm(np.diff(self.places, axis=0), axis=1))

    @property
    def length(self) -> float:
        """Of the way [m]."""
        return float(self.steps.sum())

    @property
    def speed(self) -> float:
        """Median while it moves [m/s]; 0 where it stays."""
        if len(self.times) < 2:
            return 0.0
        speed = self.steps / np.diff(self.times)
        moving = speed[speed > 0.2 * speed.max(initial=0.0)]
        return float(np.median(moving)) if len(moving) else 0.0

    def shifted(self, seconds: float) -> TrueMotion:
        """The same, later."""
        return TrueMotion(
            self.onsets + seconds, self.ends + seconds, self.times + seconds, self.places,
            self.turned,
        )  # fmt: skip

    def to_arrays(self) -> dict[str, FloatArray]:
        """What a recording keeps, by name."""
        return {
            "presses": np.column_stack([self.onsets, self.ends]),
            "way": np.column_stack([self.times, self.places]),
            "turned": np.array([self.turned]),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any]) -> TrueMotion:
        """Of what `to_arrays` gave."""
        presses = np.asarray(arrays["presses"], np.float64).reshape(-1, 2)
        way = np.asarray(arrays["way"], np.float64).reshape(-1, 4)
        turned = float(np.asarray(arrays["turned"], np.float64).reshape(-1)[0])
        return cls(presses[:, 0], presses[:, 1], way[:, 0], way[:, 1:], turned)

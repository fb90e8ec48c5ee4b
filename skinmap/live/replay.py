"""Replay: several parts touched at once, sample by sample, each touch named while it lasts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinmap.classify.classifier import NO_CONTACT, Prediction, TouchClassifier
from skinmap.classify.descriptors import Touch
from skinmap.live.touches import NamedTouch
from skinmap.touch.contacts import ACTIVE, find_contacts
from skinmap.touch.prepared import PreparedSkin

QUIET = 5  # samples (0.1 s at 50 Hz) without an active taxel that end a touch
RENAME = 5  # samples between two namings: labels at 10 Hz, a calm pace for the eye


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One moment: pressures (n,) of each part and the touches on it."""

    time: float
    pressures: Mapping[str, NDArray[np.uint8]]
    touches: tuple[NamedTouch, ...]


class TouchNamer:
    """Names the touch on one part, sample by sample, from all samples since it began."""

    def __init__(self, skin: PreparedSkin, classifier: TouchClassifier) -> None:
        self.skin, self.classifier = skin, classifier
        self._samples: list[NDArray[np.uint8]] = []
        self._quiet = 0
        self._name: Prediction | None = None

    def feed(self, sample: NDArray[np.uint8]) -> NamedTouch | None:
        """Take one sample (n,) of 0 to 255 counts; the touch on the part now, if any."""
        pressures = sample.astype(np.float64)
        active, _ = find_contacts(self.skin.geometry, pressures)
        if not active.any():
            self._quiet += 1
            if self._quiet >= QUIET:
                self._samples, self._name = [], None
            return None
        self._quiet = 0
        self._samples.append(sample)
        if self._name is None or len(self._samples) % RENAME == 0:
            touch = Touch(self.skin, np.array(self._samples))
            self._name = self.classifier.predict(touch)
        if self._name.label == NO_CONTACT:
            return None
        taxels = np.flatnonzero(active)
        centre = centre_of_pressure(self.skin, pressures)
        return NamedTouch(
            self.skin.skin.part, taxels, centre, self._name.label, self._name.confidence
        )


def centre_of_pressure(skin: PreparedSkin, pressures: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position (3,) [m] of the active taxel nearest to the weighted mean: a point on the skin."""
    active = np.flatnonzero(pressures > ACTIVE)
    points = skin.skin.positions[active]
    mean = np.average(points, axis=0, weights=pressures[active])
    return points[np.argmin(np.linalg.norm(points - mean, axis=1))]


def replay(
    skins: Mapping[str, PreparedSkin],
    tracks: Mapping[str, NDArray[np.uint8]],
    classifier: TouchClassifier,
    *,
    rate: float,
) -> Iterator[Frame]:
    """Frames of parts played together; a track (t, n) that ends before others rests at zero.

    Parameters
    ----------
    skins, tracks : mapping of part to PreparedSkin and to samples
    classifier : TouchClassifier
    rate : float
        Samples a second.
    """
    namers = {part: TouchNamer(skins[part], classifier) for part in tracks}
    for step in range(max((len(track) for track in tracks.values()), default=0)):
        now = {
            part: track[step] if step < len(track) else np.zeros(track.shape[1], np.uint8)
            for part, track in tracks.items()
        }
        named = [namers[part].feed(sample) for part, sample in now.items()]
        yield Frame(step / rate, now, tuple(touch for touch in named if touch is not None))

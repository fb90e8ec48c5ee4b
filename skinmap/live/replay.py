"""Replay: several parts touched at once, sample by sample, each touch named while it lasts."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray
from skinmap.classify.classifier import TouchClassifier
from skinmap.classify.naming import Named, name_touches
from skinmap.live.moment import Moment
from skinmap.live.touches import NamedTouch
from skinmap.touch.contacts import ACTIVE, check_pressures
from skinmap.touch.grouping import RULE, GroupingRule
from skinmap.touch.prepared import PreparedSkin

QUIET = 5  # samples (0.1 s at 50 Hz) without an active taxel that end a touch
RENAME = 5  # samples between two namings: labels at 10 Hz, a calm pace for the eye
MEMORY = 200  # samples (4 s) that a touch is named from; what lasts longer forgets its beginning


class TouchNamer:
    """Names the touches on one part, sample by sample, from all samples since they began.

    Parameters
    ----------
    skin : PreparedSkin
    classifier : TouchClassifier
        Trained.
    rule : GroupingRule
        When contacts are one grip.
    """

    def __init__(
        self, skin: PreparedSkin, classifier: TouchClassifier, *, rule: GroupingRule = RULE
    ) -> None:
        self.skin, self.classifier, self.rule = skin, classifier, rule
        classifier.prepare(skin)
        self._samples: deque[NDArray[np.uint8]] = deque(maxlen=MEMORY)
        self._felt = np.full(len(skin), -QUIET)  # when each taxel was active last [samples]
        self._now = 0
        self._named: tuple[Named, ...] = ()

    def feed(self, sample: NDArray[np.uint8]) -> tuple[NamedTouch, ...]:
        """Take one sample (n,) of 0 to 255 counts; the touches on the part now.

        Raises
        ------
        SkinMismatchError, InvalidArrayError
            A sample of another skin, NaN or infinity.
        """
        sample = check_pressures(sample, self.skin.geometry)
        self._now += 1
        active = sample > ACTIVE
        self._felt[active] = self._now
        if not active.any():
            if self._samples and self._now - self._felt.max() >= QUIET:
                self._samples.clear()
                self._named = ()
            return ()
        # A place that has been quiet starts anew, while other touches go on.
        over = self._now - self._felt >= QUIET
        self._samples.append(np.where(over, 0, sample))
        if not self._named or len(self._samples) % RENAME == 0 or self._now % RENAME == 0:
            history = np.where(over, 0, np.array(self._samples))
            self._named = name_touches(
                self.classifier, self.skin, history, rule=self.rule, ended=False
            )
        return self._show(sample, active)

    def _show(self, sample: NDArray[np.uint8], active: BoolArray) -> tuple[NamedTouch, ...]:
        """The named touches that are felt now; a fresh taxel belongs to the nearest of them."""
        points = self.skin.skin.positions
        index = np.flatnonzero(active)
        named = [touch for touch in self._named if (touch.taxels & active).any()]
        if not named:
            return ()
        owner = np.zeros(len(index), np.int64)
        if len(named) > 1:
            gaps = [
                np.linalg.norm(points[index][:, None] - points[touch.taxels][None], axis=2).min(1)
                for touch in named
            ]
            owner = np.argmin(gaps, axis=0)
        pressures = sample.astype(np.float64)
        shown = []
        for number, touch in enumerate(named):
            taxels = index[owner == number]
            if len(taxels):
                own = np.zeros(len(pressures))
                own[taxels] = pressures[taxels]
                name = touch.prediction
                shown.append(
                    NamedTouch(
                        self.skin.skin.part,
                        taxels,
                        centre_of_pressure(self.skin, own),
                        name.label,
                        name.confidence,
                    )
                )
        return tuple(shown)


def centre_of_pressure(skin: PreparedSkin, pressures: FloatArray) -> FloatArray:
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
) -> Iterator[Moment]:
    """Moments of parts played together; a track (t, n) that ends before others rests at zero.

    Parameters
    ----------
    skins, tracks : mapping of part to PreparedSkin and to samples
    classifier : TouchClassifier
    rate : float
        Samples a second.
    """
    rule = GroupingRule(rate=rate)
    namers = {part: TouchNamer(skins[part], classifier, rule=rule) for part in tracks}
    for step in range(max((len(track) for track in tracks.values()), default=0)):
        now = {
            part: track[step] if step < len(track) else np.zeros(track.shape[1], np.uint8)
            for part, track in tracks.items()
        }
        named = [touch for part, sample in now.items() for touch in namers[part].feed(sample)]
        yield Moment(step / rate, now, tuple(named))

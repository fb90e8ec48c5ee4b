"""For tests: several parts touched at once, sample by sample, each touch named while it lasts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import StreamInfo
from skinmap.recognition.classifier import TouchClassifier
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin

PACE = 10.0  # labels a second: calm for the eye


def replay(
    robot: Robot,
    tracks: Mapping[str, NDArray[np.uint8]],
    classifier: TouchClassifier,
    *,
    rate: float,
    skins: Mapping[str, PreparedSkin] | None = None,
) -> Iterator[Moment]:
    """Moments of parts played together; a track (t, n) that ends before others rests at zero.

    Parameters
    ----------
    robot : Robot
    tracks : mapping of part to samples
    classifier : TouchClassifier
        Trained.
    rate : float
        Samples a second.
    skins : mapping of part to PreparedSkin, optional
        Where they are prepared already.
    """
    longest = max((len(track) for track in tracks.values()), default=0)
    if longest == 0:
        return
    values = np.concatenate(
        [np.pad(track, ((0, longest - len(track)), (0, 0))) for track in tracks.values()], axis=1
    )
    widths = tuple(track.shape[1] for track in tracks.values())
    info = StreamInfo("replay", tuple(tracks), widths, rate, robot=robot.name)
    source = Playback(RecordedStream(info, np.arange(longest) / rate, values), speed=float("inf"))
    yield from TouchLoop(robot, source, classifier=classifier, skins=skins, pace=PACE)

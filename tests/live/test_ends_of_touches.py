"""Every touch that is over has an end: one that a mark can be written with."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import SourceEnded, StreamInfo
from skinmap.recognition.classifier import GivenName


@pytest.mark.parametrize("noise", [8.0, 10.0, 14.0])
def test_noise_that_is_taken_for_touches_gives_none_without_an_end(noise):
    """Presses all over the skin fold into each other, those that beat as well."""
    robot = skinmap.load_robot("icub")
    n = len(robot.skin("torso"))
    values = np.random.default_rng(1).normal(0, noise, (200, n)).clip(0, 255).astype(np.float32)
    info = StreamInfo("noise", ("torso",), (n,), 50.0)
    source = Playback(RecordedStream(info, np.arange(200) / 50, values), speed=np.inf)
    loop = TouchLoop(robot, source, classifier=GivenName("poke"), live=False, singly=True)
    ends: list[tuple[float, float]] = []
    try:
        while True:
            loop.step(0.5)
            ends += [(one.began, one.ended) for one in loop.finished()]
    except SourceEnded:
        pass
    assert ends
    assert all(0.0 <= began <= ended <= 4.0 for began, ended in ends)


def test_a_touch_that_the_end_of_the_samples_cuts_off_is_unfinished_and_no_tap():
    robot = skinmap.load_robot("icub")
    skin = robot.skin("left_forearm")
    away = np.linalg.norm(skin.positions - skin.positions[100], axis=1)
    times = np.arange(250) / 50
    rise = np.clip(np.minimum((times - 2) / 0.1, (4 - times) / 0.1), 0, 1)
    values = np.outer(150 * rise, np.exp(-((away / 7e-3) ** 2))).astype(np.float32)
    info = StreamInfo("press", ("left_forearm",), (len(skin),), 50.0)
    ends = []
    for count in (107, 250):
        source = Playback(RecordedStream(info, times[:count], values[:count]), speed=np.inf)
        loop = TouchLoop(robot, source, classifier=skinmap.default_model())
        list(loop)
        ends += loop.finished()
    cut, whole = ends
    assert cut.unfinished
    assert cut.label != "tap"
    assert not whole.unfinished

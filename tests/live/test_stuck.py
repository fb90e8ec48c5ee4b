"""Taxels that hang are never a touch: not before they are known to hang, and not afterwards."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.simulated_source import SimulatedSource
from skinmap.live.sources.source import StreamInfo
from skinmap.recognition.classifier import GivenName
from skinmap.touch.simulation.variety import Sensing

PART, RATE = "left_hand", 50.0


def played(prepared, samples):
    """The loop over samples (t, n), all of it done, and its moments."""
    skin = prepared(PART)
    info = StreamInfo("planted", (PART,), (len(skin),), RATE)
    source = Playback(RecordedStream(info, np.arange(len(samples)) / RATE, samples), speed=np.inf)
    loop = TouchLoop(
        skinmap.load_robot("icub"), source, classifier=GivenName("x"), skins={PART: skin}
    )
    return loop, list(loop)


def quiet(prepared, seconds, rng):
    shape = round(seconds * RATE), len(prepared(PART))
    return np.clip(rng.normal(0.0, 1.2, shape), 0, 255).astype(np.uint8)


def area(prepared, taxel=20, count=4):
    """Some taxels that lie beside each other."""
    skin = prepared(PART).skin
    return np.sort(np.linalg.norm(skin.positions - skin.positions[taxel], axis=1).argsort()[:count])


def test_what_hangs_from_the_first_sample_is_no_touch(prepared, rng):
    samples, own = quiet(prepared, 4, rng), area(prepared)
    samples[:, own] = 120
    loop, moments = played(prepared, samples)
    assert not any(moment.touches for moment in moments)
    assert loop.finished() == loop.withdrawn() == []
    assert set(moments[10].states[PART][own]) == {"unheard"}
    assert set(moments[-1].states[PART][own]) == {"stuck"}
    channels = prepared(PART).skin.channels[own].tolist()
    nothing = {"noisy": [], "dead": [], "unheard": []}
    assert loop.health() == {PART: {"stuck": channels, **nothing}}


def test_a_touch_whose_taxels_turn_out_to_hang_is_taken_back(prepared, rng):
    samples, own = quiet(prepared, 12, rng), area(prepared)
    samples[200:, own] = 120
    samples[110:150, area(prepared, 40)] = 90
    loop, moments = played(prepared, samples)
    assert moments[210].touches  # nobody can know it yet
    assert not moments[-1].touches
    (real,) = loop.finished()
    assert real.began == pytest.approx(110 / RATE)
    assert set(real.channels) >= set(prepared(PART).skin.channels[area(prepared, 40)].tolist())
    (hung,) = loop.withdrawn()
    assert hung.began == pytest.approx(200 / RATE)
    assert hung.channels == tuple(prepared(PART).skin.channels[own].tolist())


def test_a_touch_over_some_taxels_that_hang_later_stays_and_leaves_them_out(prepared, rng):
    samples, own = quiet(prepared, 13, rng), area(prepared, count=12)
    hang = own[:3]
    trembling = rng.integers(80, 100, (len(samples), len(own)), dtype=np.uint8)
    samples[150:600, own] = trembling[150:600]
    samples[150:, hang] = 120
    loop, _ = played(prepared, samples)
    touches = loop.finished()
    channels = prepared(PART).skin.channels
    assert touches
    assert loop.withdrawn() == []
    assert not {*channels[hang].tolist()} & {one for touch in touches for one in touch.channels}


def test_the_rest_can_be_learnt_before_the_first_moment(prepared, rng):
    samples, own, finger = quiet(prepared, 6, rng), area(prepared), area(prepared, 40)
    samples[:, own] = 120
    samples[:60, finger] = rng.integers(80, 100, (60, len(finger)))
    skin = prepared(PART)
    info = StreamInfo("planted", (PART,), (len(skin),), RATE)
    times = np.arange(len(samples)) / RATE
    source = Playback(RecordedStream(info, times, samples), speed=np.inf)
    loop = TouchLoop(skinmap.load_robot("icub"), source, skins={PART: skin})
    loop.learn_rest(Playback(RecordedStream(info, times, samples), speed=np.inf))
    moment = loop.step(1.0)
    assert moment is not None
    assert set(moment.states[PART][own]) == {"stuck"}
    (touch,) = moment.touches  # it was let go later: a finger, from the first sample on
    assert touch.taxels.tolist() == finger.tolist()


@pytest.mark.parametrize("name", ["icub", "kaspar", "baxter-forearm", "ur10e-cyskin"])
def test_no_touch_of_the_simulator_consists_of_stuck_taxels(name):
    """The short form of twenty seeds: every part hangs somewhere."""
    robot = skinmap.load_robot(name)
    parts = sorted(robot.parts, key=lambda part: -len(robot.skin(part)))[:2]
    source = SimulatedSource(
        robot, parts=parts, seed=3, speed=np.inf, sensing=Sensing(stuck=0.03), seconds=12.0
    )
    stages = source._stages
    hang = {
        stage.skin.part: set(stage.skin.channels[stage.sensors.stuck].tolist()) for stage in stages
    }
    loop = TouchLoop(robot, source, classifier=GivenName("x"))
    for _ in loop:
        pass
    touches = loop.finished()
    assert touches
    assert any(hang.values())
    for touch in touches:
        assert not set(touch.channels) & hang[touch.part]
    loop.close()

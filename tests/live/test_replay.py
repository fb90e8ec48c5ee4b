from __future__ import annotations

import numpy as np
import pytest

from skinmap.classify.classifier import classifiers
from skinmap.classify.descriptors import Touch
from skinmap.live.replay import QUIET, TouchNamer, centre_of_pressure, replay
from skinmap.touch.simulator import RATE, simulate


@pytest.fixture(scope="module")
def played(prepared):
    """A classifier trained on a foot, and a track with one touch on another part."""
    rng = np.random.default_rng(8)
    foot, leg = prepared("left_foot"), prepared("right_leg_lower")
    touches = [
        Touch(foot, samples, label)
        for _, label, samples in simulate(foot.skin, rng=rng, per_gesture=10).touches()
    ]
    model = classifiers.get("contact-geometry")().fit(touches, rng=rng)
    recording = simulate(leg.skin, rng=rng, per_gesture=1, gestures=["poke"])
    return model, leg, recording


def test_replay_names_the_touch_while_it_lasts(played):
    model, leg, recording = played
    part = leg.skin.part
    frames = list(replay({part: leg}, {part: recording.pressures}, model, rate=RATE))
    assert len(frames) == len(recording.pressures)
    named = np.array([len(frame.touches) for frame in frames])
    touched = (recording.pressures > 12).any(axis=1)
    np.testing.assert_array_equal(named, touched)
    last = [frame for frame in frames if frame.touches][-1].touches[0]
    assert last.label == "poke"
    assert 0 < last.confidence <= 1
    assert frames[1].time == pytest.approx(1 / RATE)


def test_replay_rests_parts_whose_track_has_ended(played, prepared):
    model, leg, recording = played
    foot = prepared("left_foot")
    tracks = {leg.skin.part: recording.pressures, "left_foot": np.zeros((1, 250), np.uint8)}
    frames = list(replay({leg.skin.part: leg, "left_foot": foot}, tracks, model, rate=RATE))
    assert len(frames) == len(recording.pressures)
    assert not frames[-1].pressures["left_foot"].any()


def test_namer_forgets_a_touch_after_quiet(played):
    model, leg, recording = played
    namer = TouchNamer(leg, model)
    (samples,) = [samples for _, _, samples in recording.touches()]
    for sample in samples:
        namer.feed(sample)
    assert namer._samples
    for _ in range(QUIET):
        assert namer.feed(np.zeros(len(leg), np.uint8)) == ()
    assert not namer._samples


def test_centre_of_pressure_is_a_taxel_under_the_load(prepared):
    leg = prepared("right_leg_lower")
    pressures = np.zeros(len(leg))
    pressures[[10, 11]] = [200.0, 50.0]
    np.testing.assert_array_equal(centre_of_pressure(leg, pressures), leg.skin.positions[10])

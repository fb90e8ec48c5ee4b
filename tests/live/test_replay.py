from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import SkinMismatchError
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.touch.simulation.simulator import RATE, simulate
from tests.replay import replay


@pytest.fixture(scope="module")
def played(prepared):
    """A classifier trained on a foot, and a track with one touch on another part."""
    rng = np.random.default_rng(8)
    foot, leg = prepared("left_foot"), prepared("right_leg_lower")
    touches = [
        Touch(foot, samples, label, rate=50.0)
        for _, label, samples in simulate(foot.skin, rng=rng, per_gesture=10, variety=0.0).touches()
    ]
    model = classifiers.get("contact-geometry")().fit(touches, rng=rng)
    recording = simulate(leg.skin, rng=rng, per_gesture=1, gestures=["poke"], variety=0.0)
    return model, leg, recording


def test_replay_names_the_touch_while_it_lasts(icub, played):
    model, leg, recording = played
    part = leg.skin.part
    moments = list(replay(icub, {part: recording.pressures}, model, rate=RATE, skins={part: leg}))
    assert len(moments) == len(recording.pressures)
    named = np.array([len(moment.touches) for moment in moments])
    touched = (recording.pressures > 12).any(axis=1)
    # A taxel that was active stays so down to 9 counts: never less than what is above 12.
    assert (named >= touched).all()
    assert not named[~(recording.pressures > 9).any(axis=1)].any()
    last = [moment for moment in moments if moment.touches][-1].touches[0]
    assert last.label == "poke"
    assert 0 < last.confidence <= 1
    assert moments[1].time == pytest.approx(1 / RATE)


def test_replay_rests_parts_whose_track_has_ended(icub, played, prepared):
    model, leg, recording = played
    tracks = {leg.skin.part: recording.pressures, "left_foot": np.zeros((1, 250), np.uint8)}
    moments = list(replay(icub, tracks, model, rate=RATE))
    assert len(moments) == len(recording.pressures)
    assert not moments[-1].pressures["left_foot"].any()


def test_replay_refuses_another_skin(icub, played):
    model, _, _ = played
    with pytest.raises(SkinMismatchError, match="3 channels for 'left_foot'"):
        list(replay(icub, {"left_foot": np.zeros((2, 3), np.uint8)}, model, rate=RATE))


def test_replay_of_nothing_is_nothing(icub, played):
    assert list(replay(icub, {}, played[0], rate=RATE)) == []

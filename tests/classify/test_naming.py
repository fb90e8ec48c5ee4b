from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import SkinMismatchError
from skinmap.recognition.classifier import NO_CONTACT, Prediction, classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.naming import Named, all_right, name_touches, not_felt, true_labels
from skinmap.recognition.prediction_sets import UNKNOWN
from skinmap.skin.skin import skin_from_points
from skinmap.touch.contacts.rest import usual_rest
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import RATE, simulate, simulate_pairs
from tests.replay import replay


@pytest.fixture(scope="module")
def model(prepared):
    """Contact geometry that learnt on a foot and an upper leg."""
    rng = np.random.default_rng(9)
    touches = [
        Touch(prepared(part), samples, label, rate=50.0)
        for part in ("left_foot", "left_leg_upper")
        for _, label, samples in simulate(
            prepared(part).skin, rng=rng, per_gesture=20, variety=0.0
        ).touches()
    ]
    return classifiers.get("contact-geometry")().fit(touches, rng=rng)


def test_a_skin_far_coarser_than_those_learnt_is_named_with_doubt(model, prepared):
    """20 mm apart: the old names were sure to 1.00, of `no_contact` too, and seldom right."""
    flat = 0.02 * np.array([[x, y, 0.0] for x in range(12) for y in range(8)])
    pad = PreparedSkin(skin_from_points(flat, np.tile([0.0, 0.0, 1.0], (96, 1)), part="pad"))
    made = simulate(pad.skin, rng=3, per_gesture=3)
    named = [one for _, _, samples in made.touches() for one in name_touches(model, pad, samples)]
    assert len(named) > 3
    assert max(one.prediction.confidence for one in named) < 0.65
    assert "20 mm apart are far from those learnt" in model.difference(pad.skin).message
    for part in ("left_foot", "torso"):
        assert model.trust(prepared(part).pitch) == 1.0
    one = np.zeros((3, 96), np.uint8)
    rest = usual_rest(96)
    assert not_felt(model, pad, one, rest).confidence == 1.0
    one[:, 40] = 90
    assert name_touches(model, pad, one) == ()
    assert not_felt(model, pad, one, rest).confidence == 0.5


def test_two_touches_at_once_get_two_right_labels(model, prepared):
    leg = prepared("right_leg_upper")
    pairs = simulate_pairs(leg.skin, rng=np.random.default_rng(11), count=16, variety=0.0)
    right = [
        all_right(name_touches(model, leg, samples), samples, label, pairs.owners[event])
        for event, label, samples in pairs.touches()
    ]
    # 85 % is asked for; 16 pairs at 0.91 (the benchmark) fall below 12 once in 100 seeds.
    assert len(right) >= 12
    assert np.mean(right) >= 0.75


def test_whole_hands_over_the_patches_of_an_arm_are_one_touch(model, prepared):
    arm = prepared("left_arm")
    recording = simulate(
        arm.skin,
        rng=np.random.default_rng(12),
        per_gesture=12,
        gestures=["whole_hand"],
        variety=0.0,
    )
    named = [name_touches(model, arm, samples) for _, _, samples in recording.touches()]
    assert np.mean([len(touches) == 1 for touches in named]) >= 0.9
    labels = [touches[0].prediction.label for touches in named]
    # Half of them before patches were seen together.
    assert len(labels) >= 6
    assert labels.count("whole_hand") >= 0.9 * len(labels)


def test_two_touches_are_followed_live(icub, model, prepared):
    leg = prepared("right_leg_upper")
    pairs = simulate_pairs(
        leg.skin, rng=np.random.default_rng(15), count=1, gestures=["poke"], variety=0.0
    )
    moments = list(replay(icub, {"right_leg_upper": pairs.pressures}, model, rate=RATE))
    assert max(len(moment.touches) for moment in moments) == 2
    both = next(one.touches for one in reversed(moments) if len(one.touches) == 2)
    assert {touch.label for touch in both} == {"poke"}
    own = [set(pairs.owners[0][touch.taxels].tolist()) - {-1} for touch in both]
    assert sorted(own, key=min) == [{0}, {1}]
    assert moments[-1].touches == ()


def test_no_contact_is_never_a_class(model, prepared):
    foot = prepared("left_foot")
    for counts in (0, 9):
        samples = np.full((20, len(foot)), counts, np.uint8)
        assert name_touches(model, foot, samples) == ()
        assert model.predict(Touch(foot, samples, rate=50.0)).label == NO_CONTACT


def test_a_foot_pressed_all_over_is_one_touch(model, prepared):
    foot = prepared("left_foot")
    (touch,) = name_touches(model, foot, np.full((20, len(foot)), 255, np.uint8))
    assert touch.taxels.all()
    assert touch.prediction.label in (*model.labels, UNKNOWN)


def test_dead_taxels_change_few_names(model, prepared):
    leg = prepared("right_leg_upper")
    recording = simulate(leg.skin, rng=np.random.default_rng(13), per_gesture=6, variety=0.0)
    alive = np.random.default_rng(1).random(len(leg)) >= 0.03
    right = [
        all_right(name_touches(model, leg, samples * alive), samples, label)
        for _, label, samples in recording.touches()
    ]
    assert np.mean(right) >= 0.9


def test_unsure_touches_are_unknown(model, prepared):
    foot = prepared("left_foot")
    samples = np.zeros((20, len(foot)), np.uint8)
    samples[:, 10] = 100
    before = model.estimator.reject_
    model.estimator.reject_ = 1.1
    try:
        said = model.predict(Touch(foot, samples, rate=50.0))
    finally:
        model.estimator.reject_ = before
    assert said.label == UNKNOWN
    assert 0 < said.confidence <= 1


def touch(taxels, label="poke"):
    mask = np.zeros(4, bool)
    mask[taxels] = True
    return Named(mask, Prediction(label, 0.9))


def test_all_right_asks_for_each_touch_at_its_place():
    samples = np.array([[90, 80, 0, 70]], np.uint8)
    owners = np.array([0, 0, -1, 1])
    label = "poke+ball"
    here, there = touch([0, 1]), touch([3], "ball")
    assert all_right([here, there], samples, label, owners)
    assert true_labels([there, here], samples, label, owners) == ["ball", "poke"]
    assert not all_right([touch([0, 1], "ball"), touch([3])], samples, label, owners)
    assert not all_right([touch([0, 1, 3])], samples, label, owners)
    assert not all_right([here, touch([1]), there], samples, label, owners)
    with pytest.raises(SkinMismatchError, match="3 owners for 4 taxels"):
        all_right([here], samples, label, np.zeros(3, np.int64))


def test_health_is_that_of_all_recordings_of_a_part(icub, prepared):
    from dataclasses import replace

    from skinmap.cli.classify.live_naming import _health

    skin = prepared("left_hand")
    sound = simulate(skin.skin, per_gesture=2, gestures=["poke"], rng=np.random.default_rng(0))
    pressures = sound.pressures.copy()
    pressures[:, 3] = 120
    hangs = replace(sound, pressures=pressures)
    for recordings in ([hangs, sound], [sound, hangs]):
        assert skin.skin.channels[3] in _health(recordings, {"left_hand": skin})["left_hand"].stuck

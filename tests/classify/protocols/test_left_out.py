"""Groups left out: what is tested was learnt from others, at the rate it was recorded at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.protocols.recordings import (
    MAX_GROUPS,
    Control,
    Judged,
    _at,
    _split_samples,
    at_chance,
    group_folds,
    meaning_of,
)
from skinmap.touch.contacts.motion_features import MOTION_FEATURES, motion_features
from skinmap.touch.simulation.simulator import simulate

SLOWER = 2.7  # 135 Hz against 50


def people_with(*rare: str) -> tuple[np.ndarray, np.ndarray]:
    """Twelve people, three pokes and three rubs each; some have made a pat."""
    people, labels = [], []
    for number in range(12):
        own = ["poke"] * 3 + ["rub"] * 3 + ["pat"] * (f"p{number:02}" in rare)
        labels += own
        people += [f"p{number:02}"] * len(own)
    return np.array(people), np.array(labels)


@pytest.mark.parametrize("rare", [("p00", "p10"), ("p00", "p01"), ("p03", "p11", "p07")])
def test_every_label_that_is_tested_was_learnt(rare):
    people, labels = people_with(*rare)
    folds = group_folds("person", people, labels)
    assert len(folds) == MAX_GROUPS
    for train, test in folds:
        assert set(labels[test]) <= set(labels[train])
        assert not set(people[test]) & set(people[train])
    tested = np.concatenate([test for _, test in folds])
    np.testing.assert_array_equal(np.sort(tested), np.arange(len(labels)))


def test_pairs_of_groups_that_hold_a_label_each_are_dealt_apart(rng):
    """Many labels of two people each: more than there are folds to keep apart by luck."""
    for _ in range(30):
        count = int(rng.integers(11, 25))
        pairs = [rng.choice(count, 2, replace=False) for _ in range(2 * count)]
        people = np.array([f"p{one}" for pair in pairs for one in pair] + ["p0", "p1"])
        labels = np.array([f"l{k}" for k in range(len(pairs)) for _ in range(2)] + ["l", "l"])
        for train, test in group_folds("person", people, labels):
            assert set(labels[test]) <= set(labels[train])


def test_a_label_of_one_person_is_refused_with_the_name():
    with pytest.raises(InvalidArrayError, match=r"one person only: pat \(p04\)"):
        group_folds("person", *people_with("p04"))


def test_a_touch_has_no_usual_rate(prepared):
    skin = prepared("left_foot")
    with pytest.raises(TypeError, match="rate"):
        Touch(skin, np.zeros((3, len(skin)), np.uint8))


@pytest.fixture(scope="module")
def recorded(prepared):
    """A recording, and the same with its times scaled: the clock of a sensor at 135 Hz."""
    skin = prepared("left_foot")
    one = simulate(skin.skin, rng=5, per_gesture=6, gestures=("poke", "full_finger"), variety=0.0)
    return skin, one, replace(one, times=one.times / SLOWER)


def durations(touches):
    """(m,) how long the touches last [ms]."""
    column = MOTION_FEATURES.index("contact_ms")
    return np.array([motion_features(t.skin.geometry, t.samples, t.rate)[column] for t in touches])


def test_scaled_times_scale_the_durations_of_touches(recorded):
    skin, one, faster = recorded
    assert faster.rate == pytest.approx(SLOWER * one.rate)
    slow, fast = (durations(recorded_touches(skin, each)) for each in (one, faster))
    assert (slow > 0).all()
    np.testing.assert_allclose(fast, slow / SLOWER, rtol=1e-6)


def test_controls_are_asked_at_the_rate_of_the_recording(recorded):
    """The skin before a touch was read at the same rate as the touch."""
    skin, _, faster = recorded
    touches = recorded_touches(skin, faster)
    asked = _at(touches, [touch.samples[:3] for touch in touches])
    np.testing.assert_allclose([touch.rate for touch in asked], SLOWER * 50.0)


def test_samples_dealt_out_last_as_long_as_the_touch_that_they_are_of(recorded, rng):
    skin, _, faster = recorded
    touches = recorded_touches(skin, faster)
    whole = [len(touch.samples) / touch.rate for touch in touches]
    for sides in _split_samples(touches, 4, rng):
        for side in sides:
            assert len(side) == len(touches)
            np.testing.assert_allclose([len(t.samples) / t.rate for t in side], whole)


QUIET = {name: Control(0.5, "no") for name in ("control", "first", "raw")}


@pytest.mark.parametrize(
    ("figure", "nested", "meaning", "word"),
    [
        (1.0, False, "yes", "means something"),
        (0.85, False, "yes", "means something"),
        (0.55, False, "no", "is not above chance"),
        (0.0, False, "no", "far below chance: labels are exchanged"),
        (1.0, True, "doubtful", "each session recorded one label only"),
    ],
)
def test_a_figure_is_held_against_chance(recorded, figure, nested, meaning, word):
    """Forty touches of two labels and four sessions, with controls at chance."""
    labels = np.repeat(["full_finger", "poke"], 20)
    sessions = (
        np.repeat(["a", "b", "c", "d"], 10) if nested else np.array(["a", "b", "c", "d"] * 10)
    )
    one = recorded_touches(*recorded[:2])[0]
    touches = tuple(replace(one, label=str(label)) for label in labels)
    before = (one.samples[:3],) * len(touches)
    judged = Judged(touches, {"session": sessions}, before, before)
    right = np.arange(40) % 20 < 20 * figure
    named = np.where(right, labels, labels[::-1])
    got, verdict = meaning_of(named, QUIET, "session", judged)
    assert (got, word in verdict) == (meaning, True)


def test_uneven_labels_may_mean_something_below_the_share_of_the_frequent_one():
    """Chance of a figure is that of names as frequent as they were given."""
    labels = np.array(["poke"] * 90 + ["rub"] * 10)
    named = labels.copy()
    named[:12] = "rub"
    assert at_chance(named, labels) is None
    assert at_chance(np.full(100, "poke"), labels) == ("no", "is not above chance")

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, NotFittedError
from skinmap.io.robots.manifest import load_robot
from skinmap.recognition.classifier import NO_CONTACT, Prediction, classifiers
from skinmap.recognition.descriptors import recorded_touches
from skinmap.recognition.model_file import load_classifier, save_classifier
from skinmap.recognition.named_classifiers import histogram_classifier
from skinmap.recognition.naming import in_words
from skinmap.recognition.prediction_sets import (
    DOUBT,
    FAMILIAR,
    LEAST,
    SetCalibration,
    enough_names,
    felt_rows,
    held_out,
    left_out_by,
    left_out_quantile,
    quantile,
)
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

USUAL = FAMILIAR**-DOUBT  # of surprise where nothing is strange
PARTS = ("left_foot", "right_leg_lower", "left_leg_upper")


def kept(shares, skins, *, strange=None, shapes=None, people=None) -> SetCalibration:
    """A calibration of touches that are all as strange, each skin of a shape of its own."""
    strange = np.zeros(len(shares)) if strange is None else strange
    nobody = ("",) * len(shares)
    return SetCalibration(
        np.asarray(shares, float), strange, tuple(skins), tuple(shapes or skins), people or nobody
    )


@pytest.fixture(scope="module")
def calibrated(prepared):
    touches = []
    for number, part in enumerate(PARTS):
        rng = np.random.default_rng([4, number])
        skin = prepared(part)
        touches += recorded_touches(skin, simulate(skin.skin, rng=rng, per_gesture=10))
    model = classifiers.get("contact-geometry")()
    return model.fit(touches, rng=np.random.default_rng(0), sets=True), touches


def test_coverage_is_kept_for_exchangeable_scores():
    """Averaged over draws the share covered is k / (m + 1), k = ceil((m + 1) c): exact."""
    rng = np.random.default_rng(0)
    held = []
    for _ in range(400):
        shares = rng.random(121)
        sets = kept(shares[:99], ("a",) * 99)
        held.append((sets.surprise(shares[99:], 0.0) <= sets.threshold(0.9, "a")).mean())
    # 400 draws of 22: three standard errors are 0.01.
    assert np.mean(held) == pytest.approx(0.9, abs=0.012)


@pytest.mark.parametrize("count", [3, 5, 9, 10, 13, 20])
def test_a_new_group_is_held_as_often_as_promised_where_groups_differ_in_all(count):
    """Each group has one score of its own: what a new one asks for lies beyond few of them."""
    rng = np.random.default_rng(count)
    held = []
    for _ in range(400):
        own = rng.random(count + 1)
        groups = np.repeat(np.arange(count), LEAST)
        held.append(own[-1] <= left_out_quantile(own[groups], groups, 0.9))
    # Three standard errors of 400 draws are 0.045; the old rule held 75 to 91 %.
    assert np.mean(held) > 0.9 - 0.045
    if count <= 9:  # the largest of them holds a new one in count / (count + 1)
        assert np.mean(held) == 1.0


def test_groups_that_are_alike_need_no_more_than_their_touches():
    rng = np.random.default_rng(1)
    held, finite = [], []
    for _ in range(200):
        scores, groups = rng.normal(size=(8, 40)), np.repeat(np.arange(7), 40)
        limit = left_out_quantile(scores[:7].ravel(), groups, 0.9)
        held.append((scores[7] <= limit).mean())
        finite.append(np.isfinite(limit))
    assert all(finite)
    assert 0.89 < np.mean(held) < 0.93


def test_another_skin_of_the_same_name_does_not_take_the_threshold_of_the_one_that_was_learnt():
    """Of the iCub's and KASPAR's `torso`, as every model of one robot meets another."""
    icub, kaspar = (PreparedSkin(load_robot(name).skin("torso")) for name in ("icub", "kaspar"))
    assert icub.skin.part == kaspar.skin.part
    skins = [icub.fingerprint] * 40 + ["b"] * 40 + ["c"] * 40
    shares = np.concatenate([np.full(40, 0.99), np.linspace(0.3, 1.0, 80)])
    sets = kept(shares, skins)
    assert sets.threshold(0.9, icub.fingerprint) == pytest.approx(-USUAL * np.log(0.99))
    assert sets.threshold(0.9, kaspar.fingerprint) > -USUAL * np.log(0.5)
    assert sets.threshold(0.9, kaspar.fingerprint) == sets.threshold(0.9)


def test_mirror_images_are_left_out_together(prepared):
    """A copy that never saw an arm is asked about it; the old folds showed it the other arm."""
    parts = ("left_foot", "right_foot", "torso", "left_arm", "right_arm")
    touches = []
    for number, part in enumerate(parts):
        skin = prepared(part)
        made = simulate(skin.skin, rng=number, per_gesture=3, gestures=("poke", "full_finger"))
        touches += recorded_touches(skin, made)
    learnt: list[set[str]] = []

    class Spy:
        labels = ("full_finger", "poke")

        def fit(self, touches, *, rng, least):
            del rng, least
            self.parts = {touch.skin.skin.part for touch in touches}
            learnt.append(self.parts)

        def probabilities(self, touch):
            assert touch.skin.skin.part not in self.parts
            return np.array([0.5, 0.5])

        def strangeness(self, touch):
            return float(len(touch.samples))

    sets, _ = held_out(Spy, touches, rng=np.random.default_rng(0))
    assert sorted(map(sorted, learnt)) == sorted(
        map(sorted, [set(parts) - {"left_foot", "right_foot"}, set(parts) - {"torso"},
                     set(parts) - {"left_arm", "right_arm"}])
    )  # fmt: skip
    assert len(set(sets.shapes)) == 3
    assert len(set(sets.skins)) == 5


def test_people_are_told_apart_by_name_and_not_by_a_number(prepared):
    """Recorded by ada, bob and cyd, all of them subject 0: each is left out whole."""
    skin = prepared("left_foot")
    made = simulate(skin.skin, rng=3, per_gesture=6, subjects=1)
    names = tuple("abc"[k % 3] for k in range(len(made.labels)))
    assert set(made.subjects) == {0}
    touches = recorded_touches(skin, replace(made, people=names))
    assert tuple(touch.person for touch in touches) == names
    by, groups = left_out_by(["foot"] * len(touches), names)
    assert by == "people"
    assert len(set(zip(names, groups.tolist(), strict=True))) == 3
    unnamed = recorded_touches(skin, replace(made, subjects=made.subjects + 5))
    assert {touch.person for touch in unnamed} == {""}


def test_a_person_who_is_known_has_an_own_threshold_and_another_that_of_all():
    people = tuple(name for name in "abcd" for _ in range(LEAST))
    shares = np.repeat([0.9, 0.8, 0.7, 0.6], LEAST)
    sets = kept(shares, ["arm"] * 80, people=people)
    assert sets.threshold(0.7, "arm", "b") == pytest.approx(-USUAL * np.log(0.8))
    assert sets.threshold(0.7, "arm") == pytest.approx(-USUAL * np.log(0.6))
    assert sets.threshold(0.7, "arm", "e") == sets.threshold(0.7, "arm")
    assert sets.threshold(0.7, "leg", "b") == np.inf  # one skin says nothing about another
    assert sets.threshold(0.99, "arm", "b") == np.inf  # 20 touches promise 20 of 21


def test_a_new_person_on_a_calibrated_skin_needs_what_each_person_left_out_needed():
    """Of three parts and three people; the old threshold was the skin's own quantile only."""
    who, where = np.repeat(np.arange(3), 3 * LEAST), np.tile(np.repeat(np.arange(3), LEAST), 3)
    shares = np.select([(who == 2) & (where == 2), who == 1], [0.1, 0.7], 0.9)
    people, parts = [[word[k] for k in of] for word, of in (("abc", who), ("xyz", where))]
    sets = kept(shares, parts, people=tuple(people))
    own = -USUAL * np.log(0.7)
    assert sets.threshold(0.7, "x", "b") == pytest.approx(own)  # who is known needs no more
    assert sets.threshold(0.8, "x", "d") == pytest.approx(-USUAL * np.log(0.1))
    assert sets.threshold(0.8, "x") == sets.threshold(0.8, "x", "d")


def test_that_sets_of_a_new_person_hold_all_names_is_stated(calibrated):
    """Two people were named in training: the old note looked at touches by nobody only."""
    model, skin = copy(calibrated[0]), calibrated[1][0].skin
    people = ("ada",) * 40 + ("ben",) * 40
    model.sets = kept(np.linspace(0.5, 1, 80), [skin.fingerprint] * 80, people=people)
    model.promise(0.9)
    assert "all names" not in model.difference(skin.skin, ("", "ada")).message
    assert model.difference(skin.skin, ("ada", "cat")).message.endswith(
        "sets of names on 'left_foot' hold all names by cat: cat was not in training; "
        "name three persons or more there"
    )
    assert model.no_contact(skin, "cat").names != (NO_CONTACT,)


def test_what_few_groups_cannot_show_gives_all_names():
    two = kept(np.linspace(0.5, 1.0, 80), ["a"] * 40 + ["b"] * 40)
    assert two.threshold(0.9, "c") == np.inf
    assert two.names(np.array([0.2, 0.8]), "xy", 0.0, np.inf) == ("y", "x")
    assert np.isfinite(two.threshold(0.9, "a"))
    assert two.threshold(0.9, "a", "ada") == np.inf  # nobody was named
    assert np.isfinite(two.threshold(0.9, "a", ""))


def test_that_a_set_holds_all_names_is_stated(calibrated, prepared):
    model, touches = calibrated
    arm = prepared("left_arm").skin
    assert "all names" not in model.difference(arm).message
    model.promise(0.99)
    try:
        message = model.difference(arm).message
    finally:
        model.coverage = None
    assert message.startswith("'left_arm' was not trained on")
    assert (
        "sets of names on 'left_arm' hold all names: too few parts or touches were held" in message
    )
    assert model.predict(touches[0]).names is None


def test_strange_touches_have_wider_sets():
    strange = np.linspace(0.5, 1.5, 99)
    sets = kept(np.linspace(0.9, 1.0, 99), ["a"] * 99, strange=strange)
    share, limit = np.array([0.6, 0.3, 0.1]), sets.threshold(0.9, "a")
    sizes = [len(sets.names(share, "xyz", one, limit)) for one in (0.0, 1.0, 3.0, 10.0)]
    assert sizes == sorted(sizes)
    assert sizes[0] == 0
    assert sizes[-1] == 3
    # Against touches as strange as the median; what is nearer than a share of that is all alike.
    assert sets.surprise(0.5, [0.0, FAMILIAR, 1.0, 2.0]) == pytest.approx(
        np.log(2.0) / np.array([FAMILIAR, FAMILIAR, 1.0, 2.0]) ** DOUBT
    )


def test_sets_hold_the_likely_names_in_order_and_may_be_empty():
    share, sets = np.array([0.2, 0.5, 0.3]), kept([0.5], ["a"])
    assert sets.names(share, "abc", 0.0, -USUAL * np.log(0.25)) == ("b", "c")
    assert sets.names(share, "abc", 0.0, -USUAL * np.log(0.6)) == ()
    assert enough_names(share, "abc", 0.8) == ("b", "c")
    assert enough_names(share, "abc", 0.1) == ("b",)
    assert enough_names(share, "abc", 0.99) == ("b", "c", "a")
    assert in_words(Prediction("b", 0.5, ("b", "c"))) == "b or c"
    assert in_words(Prediction("b", 0.5, ())) == "unknown"
    assert in_words(Prediction("b", 0.5)) == "b"


def test_a_descriptor_that_learns_is_learnt_anew_without_the_touches_it_is_asked_about(prepared):
    """The codebook of a histogram; the old copies kept that of all touches."""
    touches = []
    for number, part in enumerate(PARTS):
        skin = prepared(part)
        made = simulate(skin.skin, rng=number, per_gesture=6, gestures=("poke", "full_finger"))
        touches += recorded_touches(skin, made)
    model, seen = histogram_classifier(), []
    fit = type(model.descriptor).fit

    class Watched(type(model.descriptor)):
        def fit(self, touches, *, rng):
            seen.append(frozenset(touch.skin.skin.part for touch in touches))
            fit(self, touches, rng=rng)

    model.descriptor.__class__ = Watched
    model.fit(touches, rng=np.random.default_rng(0), sets=True)
    assert seen[0] == frozenset(PARTS)
    assert set(seen[1:]) == {frozenset(set(PARTS) - {part}) for part in PARTS}


def test_a_model_promises_and_keeps_its_promise_in_a_file(calibrated, tmp_path):
    model, touches = calibrated
    save_classifier(model, tmp_path / "m.skinmodel")
    back = load_classifier(tmp_path / "m.skinmodel")
    back.promise(0.9)
    held = [touch.label in (back.predict(touch).names or ()) for touch in touches]
    # Of the calibration's own touches, which the model has learnt: at least what was promised.
    assert np.mean(held) >= 0.87
    model.promise(0.9)
    assert back.predict(touches[3]) == model.predict(touches[3])
    model.promise(0.5)
    small = np.mean([len(model.predict(touch).names or ()) for touch in touches])
    model.promise(0.99)
    assert small < np.mean([len(model.predict(touch).names or ()) for touch in touches])
    model.coverage = None


def test_no_contact_is_alone_in_its_set_only_where_a_promise_can_be_kept(calibrated, prepared):
    """The old set was `no_contact` whatever the coverage; touches not felt count in the promise."""
    model, touches = calibrated
    skin = touches[0].skin
    quiet = replace(touches[0], samples=np.zeros((5, len(skin)), np.uint8))
    model.promise(0.9)
    assert model.predict(quiet).names == (NO_CONTACT,)
    model.promise(0.999)
    assert model.predict(quiet).names == (NO_CONTACT, *model.labels)
    few = [replace(one, samples=one.samples * 0) for one in touches[:5]]
    sets, _ = held_out(model._copy, [*touches, *few], rng=np.random.default_rng(0))
    assert (sets.shares[-5:] == 0.0).all()
    assert sets.threshold(0.9) >= model.sets.threshold(0.9)
    model.coverage = None


def test_a_young_touch_has_a_name_at_least(prepared):
    """The old sets compared doubted shares with thresholds of whole touches: all were empty."""
    touches = []
    for number, part in enumerate(PARTS):
        skin = prepared(part)
        made = simulate(skin.skin, rng=number, per_gesture=8, gestures=("poke", "stroke", "tap"))
        touches += recorded_touches(skin, made)
    model = classifiers.get("contact-geometry")()
    model.fit(touches, rng=np.random.default_rng(0), sets=True)
    assert model.doubt is not None
    model.promise(0.9)
    sizes = {0.1: [], 0.3: []}
    for age, found in sizes.items():
        for touch in touches:
            felt = felt_rows(touch)
            if len(felt) and felt[-1] - felt[0] > age * touch.rate:
                begun = replace(touch, samples=touch.samples[: felt[0] + round(age * touch.rate)])
                found.append(len(model.predict(begun, ended=False).names))
        assert min(found) >= 1
    assert np.mean(sizes[0.1]) >= np.mean(sizes[0.3])


def test_promises_that_cannot_be_kept_are_refused(calibrated):
    model, _ = calibrated
    for wrong in (0.0, 1.0, float("nan")):
        with pytest.raises(InvalidArrayError, match="coverage must lie between 0 and 1"):
            model.promise(wrong)
    with pytest.raises(NotFittedError, match="keeps no held-out touches"):
        classifiers.get("raw-rbf")().promise(0.9)
    with pytest.raises(InvalidArrayError, match="2 shares of 1 touches"):
        kept(np.zeros(2), ("a",))
    assert quantile(np.arange(9.0), 0.9) == 8.0
    assert quantile(np.arange(8.0), 0.9) == np.inf

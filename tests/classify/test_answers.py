"""Kind, motion and hand beside the label: their words, their files, and what they are worth."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.recognition import Classifier, default_model
from skinmap.recognition.answering import (
    NETWORKS,
    NO_HAND,
    SURE,
    check_groups,
    check_motions,
    hand_answer,
    hand_row,
    lacking,
    read_groups,
    shape_row,
    shipped_answers,
    three_answers_from,
)
from skinmap.recognition.answers import answers_object
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.model_file import ANSWERS
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import save_recordings
from skinmap.touch.simulation.gestures import FOUR
from skinmap.touch.simulation.hands import HAND, OTHER

GROUPS = "hand=poke,whole_hand;other=ball"


@pytest.fixture(scope="module")
def torso():
    """A skin that the model that ships did not learn on."""
    return PreparedSkin(skinmap.load_robot("kaspar").skin("torso"))


@pytest.fixture(scope="module")
def told(torso):
    """Touches that nobody learnt from, with their answers."""
    names = (*FOUR, "elbow", "ball", "edge", "stroke", "rub")
    made = skinmap.simulate(torso.skin, rng=41, per_gesture=8, gestures=names)
    answers = shipped_answers()
    return [(touch, answers.of(touch)) for touch in recorded_touches(torso, made)]


def test_sets_are_never_empty_and_begin_with_the_answer(told):
    for _, found in told:
        for one in (found.kind, found.motion):
            assert one.set
            assert one.set[0] == one.answer
            assert 0.0 < one.probability <= 1.0


def test_things_are_named_only_where_it_is_surely_no_hand(told):
    for _, found in told:
        assert (found.kind.answer in FOUR) == (found.hand.probability > NO_HAND)
    assert SURE[0] >= NO_HAND


def test_a_kind_is_no_likelier_than_the_hand_or_thing_that_it_is_of(told):
    for _, found in told:
        hand = found.hand.probability
        assert found.kind.probability <= (hand if found.kind.answer in FOUR else 1.0 - hand)
        if NO_HAND < hand < SURE[1]:  # it may be a thing: the set names some
            assert set(found.kind.set) & set(OTHER)
    # Things that were not ruled out as hands are not named kinds of them surely.
    things = [a.kind for t, a in told if t.label in OTHER and a.kind.answer in FOUR]
    assert np.mean([one.probability >= 0.9 for one in things]) < 0.3


def test_answers_are_right_more_often_than_chance(told):
    # Chance is a quarter, an eighth and, of sure answers, a half; on a skin left out.
    kinds = [(t.label == a.kind.answer) for t, a in told if t.label in FOUR]
    moves = [(t.label == a.motion.answer) for t, a in told if t.label in ("stroke", "rub")]
    sure = [
        (t.label in HAND) == (a.hand.answer == "hand")
        for t, a in told
        if t.label in (*HAND, *OTHER) and a.hand.answer != "unsure"
    ]
    assert np.mean(kinds) > 0.7
    assert np.mean(moves) > 0.6
    assert len(sure) > 20
    assert np.mean(sure) > 0.85


def test_no_answer_where_nothing_is_felt(torso):
    nothing = Touch(torso, np.zeros((3, len(torso)), np.uint8), rate=50.0)
    assert shipped_answers().of(nothing) is None
    assert answers_object(None) == {"kind": None, "motion": None, "hand": None}


def test_the_shape_of_what_moves_is_that_of_a_moment(told):
    stroke = next(touch for touch, _ in told if touch.label == "stroke")
    moment = stroke.samples[stroke.samples.sum(axis=1, dtype=int).argmax()]
    alone = Touch(stroke.skin, moment[None], rate=stroke.rate)
    np.testing.assert_array_equal(shape_row(stroke), shape_row(alone))


def test_hand_has_three_words():
    low, high = SURE
    middle = 0.5 * (low + high)
    assert [hand_answer(one).answer for one in (low, middle, high)] == ["other", "unsure", "hand"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hand=poke", "the group 'other' is missing"),
        ("poke", "groups are written hand=LABEL"),
        ("hand=poke;hand=ball;other=edge", "each once; got 'hand=ball'"),
        ("hand=;other=ball", "got 'hand='"),
    ],
)
def test_groups_are_refused_as_they_are_typed(text, message):
    with pytest.raises(InvalidArrayError, match=message):
        read_groups(text)


def test_groups_hold_each_label_once():
    labels = ["ball", "poke", "whole_hand"]
    check_groups(read_groups(GROUPS), labels)
    with pytest.raises(InvalidArrayError, match="ball in both groups"):
        check_groups({"hand": ["poke", "ball"], "other": ["ball"]}, labels)
    with pytest.raises(InvalidArrayError, match="the groups miss whole_hand"):
        check_groups({"hand": ["poke"], "other": ["ball"]}, labels)
    with pytest.raises(UnknownNameError, match="no recorded label 'edge'"):
        check_groups({"hand": ["poke"], "other": ["edge"]}, labels)


def test_motions_are_the_known_ones_and_those_given():
    assert check_motions((), ["caress", "poke", "rub"]) == ("rub",)
    assert check_motions(("caress",), ["caress", "poke", "rub"]) == ("caress", "rub")
    with pytest.raises(UnknownNameError, match="no recorded label 'wave'"):
        check_motions(("wave",), ["poke"])


def test_a_model_learns_its_own_groups_and_keeps_them(torso, tmp_path):
    robot = skinmap.load_robot("kaspar")
    names = ["poke", "full_finger", "ball", "rub"]
    made = skinmap.simulate(torso.skin, rng=0, per_gesture=8, gestures=names)
    groups = {"hand": ["poke", "full_finger", "rub"], "other": ["ball"]}
    model = skinmap.train(made, robot, groups=groups)
    path = tmp_path / "own.skinmodel"
    model.save(path)
    read = Classifier.load(path)
    assert set(read.own_answers.machines) == {"hand", "motion", "kind"}
    assert read.own_answers.machines["motion"].labels == ("rub", "still")
    # Its hand is asked alone, and its kinds too; of all others the model that ships knows more.
    assert set(read.answers.machines) == {"hand", "motion", "kind"}
    touches = recorded_touches(torso, made)
    assert [read.answers.of(one) for one in touches] == [model.answers.of(one) for one in touches]
    right = [
        (one.label != "ball") == (read.answers.of(one).hand.probability > 0.5) for one in touches
    ]
    assert np.mean(right) > 0.8


def test_a_model_of_before_is_read_and_what_it_lacks_is_told_once(torso, tmp_path):
    made = skinmap.simulate(torso.skin, rng=0, per_gesture=6, gestures=["poke", "ball"])
    save_recordings([made], tmp_path / "t.npz")
    new, old = tmp_path / "new.skinmodel", tmp_path / "old.skinmodel"
    default_model().save(new)
    with zipfile.ZipFile(new) as whole, zipfile.ZipFile(old, "w") as less:
        for name in whole.namelist():
            if name != ANSWERS:
                less.writestr(name, whole.read(name))
    assert lacking(Classifier.load(old))
    assert not lacking(Classifier.load(new))
    run = ["classify", str(old), str(tmp_path / "t.npz"), "--robot", "kaspar", "--json"]
    result = CliRunner().invoke(cli, run)
    assert result.exit_code == 0
    assert result.stderr.count("has no answers of its own") == 1
    touch = json.loads(result.stdout)["touches"][0]
    assert set(touch["kind"]) == set(touch["motion"]) == {"answer", "probability", "set"}
    assert set(touch["hand"]) == {"answer", "probability"}


def test_a_hand_is_the_mean_of_networks_that_name_hands_and_things(told):
    shipped = shipped_answers()
    assert set(HAND) < set(shipped.networks.labels.tolist())
    touch, found = next((t, a) for t, a in told if t.label == "poke")
    row = (hand_row(touch, shape_row(touch)) - shipped.networks.mean) / shipped.networks.scale
    each = []
    for layers in zip(*(getattr(shipped.networks, one) for one in NETWORKS[3:]), strict=True):
        value = row
        for number, layer in enumerate(layers):
            value = (np.maximum(value, 0.0) if number else value) @ layer[:-1] + layer[-1]
        share = np.exp(value - value.max())
        each.append(share[np.isin(shipped.networks.labels, HAND)].sum() / share.sum())
    assert len(each) > 1
    assert found.hand.probability == pytest.approx(np.mean(each), abs=1e-9)


@pytest.mark.parametrize("wrong", ["short", "narrow", "nan", "lost", "flat"])
def test_networks_that_do_not_fit_together_are_refused(wrong):
    arrays = dict(shipped_answers().to_arrays())
    head = "networks."
    if wrong == "short":
        arrays[head + "second"] = arrays[head + "second"][:1]
    elif wrong == "narrow":
        arrays[head + "mean"] = arrays[head + "mean"][:-1]
    elif wrong == "nan":
        arrays[head + "third"] = np.full_like(arrays[head + "third"], np.nan)
    elif wrong == "lost":
        del arrays[head + "first"]
    else:
        arrays[head + "scale"] = 0.0 * arrays[head + "scale"]
    with pytest.raises(InvalidArrayError, match="its networks for hands"):
        three_answers_from(arrays)


def test_live_touches_have_answers():
    robot = skinmap.load_robot("kaspar")
    source = skinmap.open_source(
        "sim:whole_hand", robot=robot, parts=["torso"], seed=3, speed=float("inf")
    )
    loop = skinmap.TouchLoop(robot, source, classifier=default_model())
    ended = []
    for moment in loop:
        for touch in moment.touches:
            if touch.answers is not None:
                assert touch.motion.answer == touch.answers.motion.answer
                assert touch.kind is touch.answers.kind
        ended += loop.finished()
        if len(ended) >= 3:
            break
    loop.close()
    assert all(one.hand.answer in ("hand", "other", "unsure") for one in ended)
    assert {one.kind.answer for one in ended} <= {"whole_hand", "three_finger"}

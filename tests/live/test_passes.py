"""Touches of a recording that is played again, and touches that are held for long."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.contacts.sample_contacts import Track
from skinmap.live.loop import TouchLoop
from skinmap.live.namer import Namer
from skinmap.live.robot_skin import JoinedSkin
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import StreamInfo
from skinmap.recognition.classifier import GivenName, Prediction
from skinmap.recognition.named_classifiers import default_model
from skinmap.recognition.naming import Named
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR, TIME
from skinmap.touch.simulation.simulator import simulate

RATE = 50.0
REST = 150  # quiet samples before and after: the levels are learnt


@pytest.fixture(scope="module")
def torso():
    return PreparedSkin(skinmap.load_robot("kaspar").skin("torso"))


@pytest.fixture(scope="module")
def model():
    return default_model()


def looped(skin, values, model, robot="kaspar"):
    part = skin.skin.part
    info = StreamInfo("looped", (part,), (len(skin),), RATE)
    source = Playback(
        RecordedStream(info, np.arange(len(values)) / RATE, values), speed=np.inf, loop=True
    )
    robot = skinmap.load_robot(robot)
    return TouchLoop(robot, source, classifier=model, skins={part: skin})


@pytest.mark.parametrize("gesture", [*FOUR, *TIME])
def test_names_of_each_pass_of_a_loop_are_those_of_the_first(prepared, model, gesture):
    arm = prepared("left_forearm")
    touch = simulate(arm.skin, gestures=[gesture], per_gesture=1, rng=np.random.default_rng(4))
    quiet = np.zeros((REST, len(arm)), np.uint8)
    values = np.concatenate([quiet, touch.pressures, quiet])
    loop = looped(arm, values, model, "icub")
    passes = []
    for _ in range(3):
        for _ in range(len(values)):
            loop.step(1.0)
        passes.append([(one.label, one.confidence, one.began) for one in loop.finished()])
    assert passes[0]
    assert passes[1] == passes[0]
    assert passes[2] == passes[0]


def test_a_seek_back_does_not_change_the_name_of_what_is_played_again(torso, model):
    touch = simulate(torso.skin, gestures=["poke"], per_gesture=1, rng=np.random.default_rng(4))
    values = np.concatenate([np.zeros((REST, len(torso)), np.uint8), touch.pressures])
    loop = looped(torso, values, model)
    for _ in range(len(values) - 5):
        loop.step(1.0)
    first = loop.finished()
    loop.seek(0.0)
    for _ in range(len(values) - 5):
        loop.step(1.0)
    again = loop.finished()
    assert [(one.label, one.confidence) for one in again] == [
        (one.label, one.confidence) for one in first
    ]


@pytest.mark.soak
def test_two_presses_apart_stay_two_for_minutes(torso, whole):
    rng, rate = np.random.default_rng(7), 10.0  # what is kept is forgotten after 20 s
    seconds = 600 if whole else 120
    away = np.linalg.norm(torso.skin.positions - torso.skin.positions[:, None], axis=2)
    one, other = np.unravel_index(np.abs(away - 0.103).argmin(), away.shape)
    assert away[one, other] == pytest.approx(0.103, abs=0.001)
    values = np.zeros((round(seconds * rate), len(torso)), np.uint8)
    for place, begin in ((one, 1.0), (other, 2.2)):
        near = np.argsort(away[place])[:8]
        held = values[round(begin * rate) :]
        held[:, near] = rng.integers(85, 110, (len(held), len(near)))  # a hand trembles
    info = StreamInfo("held", ("torso",), (len(torso),), rate)
    source = Playback(RecordedStream(info, np.arange(len(values)) / rate, values), speed=np.inf)
    robot = skinmap.load_robot("kaspar")
    loop = TouchLoop(robot, source, classifier=GivenName("x"), skins={"torso": torso}, pace=1.0)
    felt = {}
    for moment in loop:
        if moment.time > 2.5:
            felt.setdefault(tuple(touch.identity for touch in moment.touches), moment.time)
    assert set(felt) == {(0, 1)}, felt
    assert [round(touch.duration) for touch in loop.finished()] == [seconds - 1, seconds - 2]
    assert not loop.withdrawn()


def track(identity, touch, taxels):
    return Track(
        identity, 0, 0.0, 0.0, np.array(taxels), np.zeros(3), np.array([0.0, 0.0, 1.0]), touch=touch
    )


def grouped(count, *groups):
    return [
        Named(np.isin(np.arange(count), taxels), Prediction(str(number), 1.0))
        for number, taxels in enumerate(groups)
    ]


def test_contacts_in_new_groups_always_find_a_number(torso):
    """Groups {2}, {6, 7} and {5}, after 6 was of touch 2 and 7 of touch 5."""
    namer = Namer(JoinedSkin({"torso": torso}), GivenName("x"), rate=RATE)
    tracks = [track(2, 2, [0]), track(5, 5, [1]), track(6, 2, [2]), track(7, 5, [3])]
    namer._hand_out(grouped(len(torso), [0], [2, 3], [1]), tracks, 0)
    touches = {one.identity: one.touch for one in tracks}
    assert touches[2] == 2
    assert touches[5] == 5
    assert touches[6] == touches[7]
    assert len(set(touches.values())) == 3


@pytest.mark.parametrize("seed", range(200))
def test_touches_of_different_groups_differ_however_often_they_change(torso, seed):
    rng = np.random.default_rng(seed)
    namer = Namer(JoinedSkin({"torso": torso}), GivenName("x"), rate=RATE)
    tracks = [track(k, k, [k]) for k in range(6)]
    for _ in range(20):
        group = rng.integers(0, 4, len(tracks))
        namer._hand_out(
            grouped(len(torso), *(np.flatnonzero(group == k) for k in np.unique(group))), tracks, 0
        )
        touches = [one.touch for one in tracks]
        assert len(set(zip(group.tolist(), touches, strict=True))) == len(set(touches))
        assert len(set(touches)) == len(np.unique(group))

"""A taxel that hangs is drawn as such: never inside an outline, and named by the health layer."""

from __future__ import annotations

import itertools
from contextlib import closing

import numpy as np
import pytest

import skinmap
from tests.viewer.unpacking import unpack
from viewer import Layers
from viewer.drawing.skin.skin_layer import SkinLayer
from viewer.drawing.touches.touch_marks import touch_field
from viewer.layers import STATES, STUCK, UNHEARD
from viewer.view_files import Best
from viewer.view_options import Look, Session
from viewer.web.sample import UNKNOWN, SampleWriter
from viewer.web.scene_data import WebScene

# Parts that the simulator gives stuck taxels with these seeds, one of each robot and size of taxel.
CASES = (
    ("icub", "torso", 0),
    ("icub", "left_hand", 3),
    ("kaspar", "torso", 2),
    ("ur10e-cyskin", "upper_arm_2", 1),
    ("baxter-forearm", "forearm", 1),
)
SECONDS = 4.0


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"{case[0]}-{case[1]}-{case[2]}")
def played(request):
    """A simulated stream of one part, which of its taxels hang in truth, and its moments."""
    name, part, seed = request.param
    robot = skinmap.load_robot(name)
    session = Session(robot, (part,), source=f"sim:seed={seed}")
    session.prepare()
    source = session.open(hurry=True)
    (stage,) = source._stages
    source.close()
    assert len(stage.sensors.stuck), "another seed: this one gives no stuck taxel"
    return session, part, stage.sensors.stuck, list(session.moments(SECONDS))


def live(session):
    """The same stream as it is met for the first time: nothing is known before it begins."""
    with closing(session.touch_loop(session.open(hurry=True), None, singly=True)) as loop:
        yield from itertools.takewhile(lambda moment: moment.time <= SECONDS, loop)


def held(layer, touch, touches):
    """Taxels inside the outline of a touch."""
    values, level = touch_field(layer, touch, touches)
    return layer.fine.taxels[values[: len(layer.fine.taxels)] > level]


@pytest.mark.parametrize("learned", [True, False], ids=["stills", "live"])
def test_no_outline_holds_a_stuck_taxel(played, learned):
    session, part, stuck, moments = played
    layers, layer = Layers(session.skins), SkinLayer(session.skins[part].mesh)
    drawn = 0
    for moment in moments if learned else live(session):
        layers.observe(moment)
        layer.set_pressures(layers.felt(moment)[part])
        for touch in moment.touches:
            assert not np.isin(held(layer, touch, moment.touches), stuck).any()
            drawn += 1
    assert drawn > 10


def test_layers_draw_stuck_taxels_as_their_sign_and_not_as_pressure(played):
    session, part, stuck, moments = played
    layers = Layers(session.skins)
    layers.observe(moments[0])
    states = layers.get("health").values(part, moments[0])
    np.testing.assert_array_equal(np.flatnonzero(states == STUCK), np.sort(stuck))
    for name in ("pressure", "binary"):
        values = layers.get(name).values(part, moments[0])
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(values)), np.sort(stuck))


def test_stream_that_has_just_begun_marks_what_was_never_at_rest(played):
    session, part, stuck, _ = played
    layers = Layers(session.skins)
    moment = next(iter(live(session)))
    layers.observe(moment)
    states = layers.get("health").values(part, moment)
    assert (states[stuck] == UNHEARD).all()
    assert np.isnan(layers.felt(moment)[part][stuck]).all()


def test_page_gets_the_same_signs_and_no_pressure(played, opengl):
    session, _, stuck, moments = played
    layers = Layers(session.skins)
    layers.observe(moments[-1])
    scene = WebScene(session.robot, session.skins, links=())
    sent, arrays = unpack(SampleWriter(scene, layers).write(moments[-1], layers.counts, {}))
    assert sent["signs"] == {STATES[STUCK]: np.sort(stuck).tolist()}
    assert (arrays["values"][stuck] == UNKNOWN).all()


def test_moment_that_a_still_shows_has_touches_of_sound_taxels_alone(played):
    session, _, stuck, _ = played
    best = Best(session, Look())
    for _ in best.watch(session.moments(SECONDS)):
        pass
    assert best.moment is not None
    assert best.moment.touches
    assert not np.isin(np.concatenate([one.taxels for one in best.moment.touches]), stuck).any()

"""A running loop takes a classifier later: names come from then on, contacts all the time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skinmap.classify.classifier import DEFAULT, classifiers
from skinmap.classify.descriptors import Touch
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import StreamInfo
from skinmap.touch.simulator import simulate


@pytest.fixture(scope="module")
def trained(prepared):
    rng = np.random.default_rng(3)
    skin = prepared("left_foot")
    events = simulate(skin.skin, rng=rng, per_gesture=10, variety=0.0).touches()
    touches = [Touch(skin, samples, label) for _, label, samples in events]
    return classifiers.get(DEFAULT)().fit(touches, rng=rng)


def test_loop_names_touches_from_the_step_after_it_got_a_classifier(icub, prepared, trained):
    skin = prepared("left_foot")
    near = np.linalg.norm(skin.skin.positions - skin.skin.positions[60], axis=1) < 0.02
    values = np.tile(np.where(near, 150, 0).astype(np.uint8), (60, 1))
    info = StreamInfo("press", ("left_foot",), (len(skin),), 50.0)
    source = Playback(info, np.arange(60) / 50.0, values, speed=np.inf)
    loop = TouchLoop(icub, source, skins={"left_foot": skin})
    before = [loop.step(1.0) for _ in range(20)]
    assert {touch.label for moment in before for touch in moment.touches} == {"touch"}
    loop.name_with(trained)
    after = [loop.step(1.0) for _ in range(30)]
    assert len({touch.identity for moment in (*before, *after) for touch in moment.touches}) == 1
    (last,) = after[-1].touches
    assert last.label in trained.labels
    assert math.isfinite(last.confidence)
    loop.close()

"""The model that comes with Skinmap: small, quick to read, made by its script, and worth having."""

from __future__ import annotations

import importlib.util
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skinmap.io.robots.manifest import load_robot
from skinmap.recognition.classifier import felt_rows
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.evaluate import likeliest
from skinmap.recognition.named_classifiers import DEFAULT_FILE, default_model
from skinmap.skin.skin import fingerprint
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR, TIME
from skinmap.touch.simulation.simulator import simulate

SCRIPT = Path(__file__).parents[2] / "scripts" / "default_model.py"


@pytest.fixture(scope="module")
def script():
    """What makes the model."""
    spec = importlib.util.spec_from_file_location("default_model_script", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def model():
    return default_model()


def test_it_is_small_and_read_at_once_without_what_trains():
    assert DEFAULT_FILE.stat().st_size < 1_000_000
    with zipfile.ZipFile(DEFAULT_FILE) as archive:
        assert "estimator.skops" not in archive.namelist()
    began = time.process_time()
    default_model()
    assert time.process_time() - began < 0.3


def test_it_knows_what_stays_and_what_goes_on_in_time(model, icub):
    assert set(model.labels) == {*FOUR, *TIME}
    assert model.descriptor.moving
    known = {one.part: one.fingerprint for one in model.trained_on}
    assert known == {part: fingerprint(icub.skin(part)) for part in icub.parts}


def test_its_sets_know_parts_by_their_layout_and_leave_mirror_images_out_together(model, icub):
    assert set(model.sets.skins) == {fingerprint(icub.skin(part)) for part in icub.parts}
    assert len(set(model.sets.shapes)) == 7  # the torso, and six pairs


def test_its_vectors_are_touches_of_the_script(model, script, icub, prepared):
    """A part in one state anew: many of its touches are support vectors, none of another seed."""
    skin, number = prepared("left_forearm"), icub.parts.index("left_forearm")

    def share(state: int) -> float:
        machine = model.estimator
        touches = script.our_touches(skin, number, state)
        rows = np.concatenate([model.descriptor.describe(touch) for touch in touches])
        scaled = (np.log1p(rows) - machine.mean_) / machine.scale_
        away = np.abs(scaled[:, None, :] - machine.vectors_).max(axis=2).min(axis=1)
        return float((away < 1e-3).mean())

    assert share(0) > 0.1
    assert share(script.STATES + 1) == 0.0


def test_it_names_touches_on_a_robot_that_it_never_saw_by_how_they_go_on(model):
    skin = PreparedSkin(load_robot("kaspar").skin("torso"))
    recording = simulate(skin.skin, rng=99, per_gesture=5, gestures=(*FOUR, *TIME))
    touches, rng = recorded_touches(skin, recording), np.random.default_rng(0)

    def right(kinds: tuple[str, ...], order: bool) -> float:
        own = [touch for touch in touches if touch.label in kinds]
        shown = (
            own if order else [replace(one, samples=rng.permutation(one.samples)) for one in own]
        )
        return float(np.mean([likeliest(model, one).label == one.label for one in shown]))

    assert right(FOUR, order=True) > 0.8
    assert right(TIME, order=True) > 0.8
    assert right(TIME, order=False) < 0.6


def test_a_touch_that_has_just_begun_is_named_with_as_much_confidence_as_it_is_named_right(model):
    """On a robot that it never saw; the control names what goes on as if it were over."""
    skin = PreparedSkin(load_robot("kaspar").skin("torso"))
    recording = simulate(skin.skin, rng=77, per_gesture=5, gestures=(*FOUR, *TIME))
    touches = recorded_touches(skin, recording)

    def gap(age: float, ended: bool) -> float:
        """Confidence over share of right names, of the touches that go on so long."""
        sure, right = [], []
        for touch in touches:
            felt = felt_rows(touch)
            end = int(felt[0]) + round(age * touch.rate)
            if end > felt[-1]:
                continue
            begun = Touch(skin, touch.samples[:end], rate=touch.rate)
            named, share = model.predict(begun, ended=ended), model.probabilities(begun)
            sure.append(named.confidence)
            right.append(model.labels[int(np.argmax(share))] == touch.label)
        return float(np.mean(sure) - np.mean(right))

    for age in (0.1, 0.2, 0.4):
        assert abs(gap(age, ended=False)) < 0.15
        assert gap(age, ended=True) > 0.25
    assert (np.diff(model.doubt) <= 0).all()
    assert model.doubt[0] > 0.7
    assert model.doubt[-1] == 0.0

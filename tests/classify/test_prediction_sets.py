from __future__ import annotations

import numpy as np
import pytest

from skinmap.classify.classifier import NO_CONTACT, Prediction, classifiers
from skinmap.classify.descriptors import Touch, recorded_touches
from skinmap.classify.model_file import load_classifier, save_classifier
from skinmap.classify.naming import in_words
from skinmap.classify.prediction_sets import (
    LEAST,
    NOBODY,
    SetCalibration,
    likely_names,
)
from skinmap.errors import InvalidArrayError, NotFittedError
from skinmap.touch.simulator import simulate


@pytest.fixture(scope="module")
def calibrated(prepared):
    touches = []
    for number, part in enumerate(("left_foot", "right_leg_lower", "left_leg_upper")):
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
        scores = rng.random(121)
        kept = SetCalibration(scores[:99], ("a",) * 99, np.full(99, NOBODY))
        held.append((scores[99:] <= kept.threshold(0.9, "b")).mean())
    # 400 draws of 22: three standard errors are 0.01.
    assert np.mean(held) == pytest.approx(0.9, abs=0.012)


def test_a_known_part_has_its_own_quantile_and_a_person_where_no_part_is():
    scores = np.concatenate([np.full(LEAST, 0.1), np.full(LEAST, 0.6)])
    parts = ("arm",) * LEAST + ("leg",) * LEAST
    persons = np.repeat([3, 5], LEAST)
    kept = SetCalibration(scores, parts, persons)
    assert kept.threshold(0.9, "arm") == 0.1
    assert kept.threshold(0.9, "leg", person=3) == 0.6
    assert kept.threshold(0.9, "head", person=3) == 0.1
    assert kept.threshold(0.9, "head") == 0.6
    assert kept.threshold(0.99, "arm") == np.inf  # 20 touches promise no more than 20 of 21


def test_a_part_that_was_not_calibrated_gets_what_is_enough_for_most_parts():
    parts = tuple(name for name in "abcd" for _ in range(LEAST))
    scores = np.repeat([0.1, 0.2, 0.3, 0.4], LEAST)
    persons = np.tile([3, 5], 2 * LEAST)
    kept = SetCalibration(scores, parts, persons)
    assert kept.threshold(0.7, "e") == 0.4  # of all touches alike 0.3 would do
    assert kept.threshold(0.5, "e") == 0.3
    assert kept.threshold(0.5, "e", person=3) == 0.3
    assert kept.threshold(0.9, "b") == 0.2


def test_sets_hold_the_likely_names_in_order_and_may_be_empty():
    share = np.array([0.2, 0.5, 0.3])
    assert likely_names(share, "abc", 0.75) == ("b", "c")
    assert likely_names(share, "abc", 0.4) == ()
    assert in_words(Prediction("b", 0.5, ("b", "c"))) == "b or c"
    assert in_words(Prediction("b", 0.5, ())) == "unknown"
    assert in_words(Prediction("b", 0.5)) == "b"


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
    quiet = Touch(touches[0].skin, np.zeros((5, len(touches[0].skin)), np.uint8))
    assert back.predict(quiet).names == (NO_CONTACT,)
    model.promise(0.5)
    small = np.mean([len(model.predict(touch).names or ()) for touch in touches])
    model.promise(0.99)
    assert small < np.mean([len(model.predict(touch).names or ()) for touch in touches])
    model.coverage = None


def test_promises_that_cannot_be_kept_are_refused(calibrated):
    model, _ = calibrated
    for wrong in (0.0, 1.0, float("nan")):
        with pytest.raises(InvalidArrayError, match="coverage must lie between 0 and 1"):
            model.promise(wrong)
    with pytest.raises(NotFittedError, match="keeps no held-out touches"):
        classifiers.get("raw-rbf")().promise(0.9)
    with pytest.raises(InvalidArrayError, match="2 scores of 1 touches"):
        SetCalibration(np.zeros(2), ("a",), np.zeros(2, int))

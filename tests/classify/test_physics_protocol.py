"""The protocol `physics`: who trains, who is judged, and how confidences are."""

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.physics.variants import FROZEN, TUNING, VARIANTS
from skinmap.recognition.protocols.transfer import (
    BOTH,
    OURS,
    _trainings,
    calibration_error,
    evaluate_physics,
    judged,
    mirror_pairs,
)
from skinmap.skin.skin import Skin
from skinmap.touch.prepared_skin import PreparedSkin

PARTS = ["a", "b", "c"]
PAIRS = {"a": "a", "b": "b", "c": "c"}
# Stand for touches: which physics and part they are of.
TOUCHED = {(one, part): ((one, part),) for one in (OURS, *VARIANTS) for part in PARTS}


@pytest.mark.parametrize("part", PARTS)
def test_trainings_never_see_the_frozen_variant_or_a_tested_part(part: str) -> None:
    made = _trainings(TOUCHED, PAIRS, part)  # type: ignore[arg-type]
    assert {one["trained_on"] for one in made} == {OURS, BOTH, *TUNING}
    for one in made:
        physics = {touch[0] for touch in one["train"]}
        assert FROZEN not in physics
        trained = {touch[1] for touch in one["train"]}
        tested = {touch[1] for touches in one["test"].values() for touch in touches}
        assert tested == {part}
        assert trained == set(PARTS) - tested
        if one["trained_on"] == BOTH:
            assert not physics & set(one["test"])


def test_trainings_test_on_every_physics() -> None:
    made = _trainings(TOUCHED, PAIRS, "a")  # type: ignore[arg-type]
    pairs = {(one["trained_on"], tested) for one in made for tested in one["test"]}
    every = (OURS, *VARIANTS)
    assert pairs == {(a, b) for a in (OURS, BOTH, *TUNING) for b in every}


def test_judged_counts_names_and_means_over_classes() -> None:
    named = [("x", "x", 0.9)] * 3 + [("x", "y", 0.6)] + [("y", "no_contact", 0.0), ("y", "y", 1.0)]
    found = judged("ours", "foam", ("x", "y"), named)
    assert found.confusion == {
        "x": {"x": 3, "y": 1, "no_contact": 0},
        "y": {"x": 0, "y": 1, "no_contact": 1},
    }
    assert found.per_class == {"x": 0.75, "y": 0.5}
    assert found.mean == 0.625


def test_calibration_error_of_known_confidences() -> None:
    rng = np.random.default_rng(0)
    confidence = rng.uniform(0.3, 1.0, 20_000)
    honest = rng.random(20_000) < confidence
    # The noise of a bin of 2,900: 0.5 / sqrt(2900) = 0.009 at most.
    assert calibration_error(confidence, honest) < 0.012
    always = np.full(100, 0.9)
    np.testing.assert_allclose(calibration_error(always, np.arange(100) < 40), 0.5)
    assert calibration_error(np.ones(5), np.ones(5, bool)) == 0.0


def test_evaluate_physics_needs_two_parts() -> None:
    with pytest.raises(InvalidArrayError, match="two parts, got 1"):
        evaluate_physics({"a": None}, gestures=("poke",), per_gesture=1, seeds=[0])  # type: ignore[dict-item]


def test_a_part_without_one_module_is_still_a_mirror_image(icub) -> None:
    """By counts of taxels it would train what its mirror image is tested by."""
    skins = {part: icub.skin(part) for part in ("left_arm", "right_arm", "left_foot")}
    worn = skins["right_arm"]
    kept = worn.modules != worn.modules[0]
    columns = (worn.channels, worn.modules, worn.positions, worn.normals)
    skins["right_arm"] = Skin(worn.part, worn.link, *(column[kept] for column in columns))
    found = mirror_pairs({part: PreparedSkin(skin) for part, skin in skins.items()})
    assert found == {"left_arm": "left_arm", "right_arm": "left_arm", "left_foot": "left_foot"}


def test_mirror_images_are_never_on_both_sides() -> None:
    pairs = {"left": "left", "right": "left", "chest": "chest"}
    touched = {(OURS, part): ((OURS, part),) for part in pairs}
    touched |= {(one, part): ((one, part),) for one in VARIANTS for part in ("left", "chest")}
    for part in ("left", "chest"):
        for one in _trainings(touched, pairs, part):  # type: ignore[arg-type]
            trained = {pairs[touch[1]] for touch in one["train"]}
            assert part not in trained
            assert trained

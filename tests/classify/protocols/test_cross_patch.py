from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.recognition.protocols.transfer import (
    check_carries_over,
    cut_patches,
    score_patches,
    summarise,
    touch_patches,
)

THREE = ("poke", "full_finger", "three_finger")
NAMES = ("contact-geometry", "histogram")


@pytest.fixture(scope="module")
def patches():
    cut = cut_patches(skinmap.load_robot("icub"), ("left_forearm", "right_leg_lower"))
    return touch_patches(cut, seed=1, gestures=THREE, per_gesture=6)


@pytest.fixture(scope="module")
def scores(patches):
    return score_patches(patches, names=NAMES, seed=1)


def test_patches_share_out_the_taxels_of_a_part(patches):
    assert [patch.name for patch in patches] == [
        "left_forearm/0", "left_forearm/1", "right_leg_lower",
    ]  # fmt: skip
    assert [len(patch.skin) for patch in patches] == [160, 80, 380]
    channels = np.concatenate([patch.skin.skin.channels for patch in patches[:2]])
    assert len(set(channels)) == 240


def test_each_patch_is_tested_by_what_was_trained_on_the_others(patches, scores):
    for own in scores:
        assert list(own) == [patch.name for patch in patches]
        assert [own[patch.name].touches for patch in patches] == [
            len(patch.touches) for patch in patches
        ]
    left_out = score_patches(patches[2:], patches[:2], names=NAMES, seed=1)
    for own, alone in zip(scores, left_out, strict=True):
        assert own["right_leg_lower"] == alone["right_leg_lower"]


def test_rows_sum_up_patches_and_classes(patches, scores):
    row = summarise("contact-geometry", [scores[0], scores[0]])
    assert (row.features, row.classifier) == ("contact-geometry", "RbfMachine")
    assert row.mean == pytest.approx(np.mean(list(row.per_patch.values())))
    assert row.worst == min(row.per_patch.values()) == row.per_patch[row.worst_patch]
    assert row.std == 0.0  # the same scores twice
    assert row.touches == 2 * sum(len(patch.touches) for patch in patches)
    right = sum(own.accuracy * own.touches for own in scores[0].values())
    counts = {label: sum(t.label == label for p in patches for t in p.touches) for label in THREE}
    assert sum(row.per_class[label] * counts[label] for label in THREE) == pytest.approx(right)
    assert row.mean > 0.8  # three gestures; at full size 0.95 and more
    assert summarise("histogram", [scores[1]]).classifier == "IntersectionSVC"


def test_leaving_out_refuses_one_patch_and_classifiers_of_one_skin(patches):
    with pytest.raises(InvalidArrayError, match="needs two patches, got 1"):
        score_patches(patches[:1], seed=0)
    with pytest.raises(InvalidArrayError, match="'raw-rbf' learns the taxels of one part"):
        check_carries_over(["contact-geometry", "raw-rbf"])
    with pytest.raises(UnknownNameError, match="no classifier 'oracle'"):
        check_carries_over(["oracle"])

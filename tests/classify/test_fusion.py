from __future__ import annotations

import numpy as np
import pytest

from skinmap.classify.check import check_classifier
from skinmap.classify.fusion import (
    FusionClassifier,
    fusion_classifier,
    fusion_images_classifier,
    learn_pool,
    part_folds,
    pool,
)
from skinmap.classify.named_classifiers import contact_geometry_classifier
from skinmap.errors import InvalidArrayError, UnknownNameError

CLASSES = np.array(["a", "b", "c"])


def opinions(rng, labels, skill):
    """Probabilities of a member that favours the right label `skill` of the time."""
    scores = rng.normal(0.0, 1.0, (len(labels), 3))
    scores[np.arange(len(labels)), labels] += skill
    share = np.exp(scores)
    return share / share.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("skills", [(0.0, 3.0), (2.0, 2.0), (3.0, 0.1), (0.0, 0.0)])
def test_pool_is_never_worse_than_its_best_member_on_held_out_touches(skills):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        labels = rng.integers(0, 3, 60)
        found = learn_pool(
            np.array([opinions(rng, labels, skill) for skill in skills]), labels, CLASSES
        )
        assert found.held_out_pool_ >= found.held_out_.max()
        assert found.weights_.min() >= 0
        assert found.weights_.sum() == pytest.approx(1.0)


def test_independent_opinions_of_equal_worth_are_mixed():
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 3, 400)
    found = learn_pool(
        np.array([opinions(rng, labels, 1.5), opinions(rng, labels, 1.5)]), labels, CLASSES
    )
    assert found.weights_.max() < 1
    assert found.held_out_pool_ > found.held_out_.max()


def test_a_member_that_only_guesses_gets_no_weight():
    rng = np.random.default_rng(1)
    labels = rng.integers(0, 3, 400)
    found = learn_pool(
        np.array([opinions(rng, labels, 0.0), opinions(rng, labels, 3.0)]), labels, CLASSES
    )
    np.testing.assert_array_equal(found.weights_, [0, 1])


def test_nothing_held_out_leaves_the_first_member_alone():
    found = learn_pool(np.zeros((2, 0, 3)), np.zeros(0, int), CLASSES)
    np.testing.assert_array_equal(found.weights_, [1, 0])
    assert found.reject_ == 0


def test_pool_of_one_member_is_that_member(rng):
    share = opinions(rng, np.zeros(5, int), 1.0)
    np.testing.assert_allclose(pool(np.array([share, share[::-1]]), np.array([1.0, 0.0])), share)


def test_pool_multiplies_with_exponents():
    shares = np.array([[[0.8, 0.2]], [[0.5, 0.5]]])
    wanted = np.sqrt(np.array([0.8 * 0.5, 0.2 * 0.5]))
    np.testing.assert_allclose(pool(shares, np.array([0.5, 0.5]))[0], wanted / wanted.sum())


def test_folds_keep_parts_together(prepared):
    from skinmap.classify.descriptors import Touch

    skins = [prepared(part) for part in ("left_foot", "left_hand", "torso")]
    touches = [Touch(skin, np.zeros((1, len(skin)), np.uint8)) for skin in skins for _ in range(5)]
    fold = part_folds(touches, rng=np.random.default_rng(0)).reshape(3, 5)
    assert (fold == fold[:, :1]).all()
    assert len(np.unique(fold)) == 3
    alone = part_folds(touches[:5], rng=np.random.default_rng(0))
    assert len(np.unique(alone)) == 4


def test_fusion_and_contact_geometry_keep_the_contract():
    check_classifier(contact_geometry_classifier)
    check_classifier(fusion_classifier)


def test_fusion_with_images_keeps_the_contract():
    pytest.importorskip("mahotas", reason="the extra `images` is not installed")
    check_classifier(fusion_images_classifier)


def test_fusion_refuses_members_that_it_cannot_use():
    with pytest.raises(InvalidArrayError, match="a fusion needs two members, got histogram"):
        FusionClassifier(members=["histogram"])
    with pytest.raises(UnknownNameError, match="no classifier 'oracle'"):
        FusionClassifier(members=["oracle", "histogram"])

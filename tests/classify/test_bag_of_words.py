from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from skinmap.errors import InvalidArrayError
from skinmap.recognition.images.bag_of_words import (
    ACTIVE,
    LEARNT_FROM,
    SCALES,
    STEP,
    BagOfVisualWords,
    as_images,
    count_words,
    dense_points,
    learn_words,
    local_features,
)


def blob(row, column, size=(66, 100), width=4.0):
    """A round touch."""
    rows, columns = np.indices(size)
    distance = (rows - row) ** 2 + (columns - column) ** 2
    return np.uint8(255 * np.exp(-0.5 * distance / width**2))


def test_count_words_are_roots_of_the_nearest_words(rng):
    features, words = rng.random((200, 8)), rng.random((12, 8))
    owner = np.sort(rng.integers(0, 5, 200))
    owner[owner == 3] = 4  # image 3 has none
    nearest = cdist(features, words).argmin(axis=1)
    expected = np.zeros((5, 12))
    np.add.at(expected, (owner, nearest), 1)
    np.testing.assert_array_equal(count_words(words, features, owner, 5), np.sqrt(expected))
    assert count_words(words, features[:0], owner[:0], 2).shape == (2, 12)


def test_learn_words_finds_planted_words(rng):
    planted = 10.0 * rng.standard_normal((6, 8))
    features = planted[rng.integers(0, 6, LEARNT_FROM + 500)]
    features = features + 0.01 * rng.standard_normal(features.shape)
    found = learn_words(features, 6, np.random.default_rng(0))
    # Means of about 2,500 features with noise 0.01 each, in 8 directions.
    assert cdist(planted, found).min(axis=1).max() < 2e-3


def test_learn_words_needs_features_and_takes_few(rng):
    few = np.repeat(rng.random((3, 8)), 4, axis=0)
    np.testing.assert_array_equal(learn_words(few, 130, rng), np.unique(few, axis=0))
    with pytest.raises(InvalidArrayError, match="130 words cannot be learnt from 0 features"):
        learn_words(few[:0], 130, rng)
    with pytest.raises(InvalidArrayError, match="0 words"):
        learn_words(few, 0, rng)


def test_dense_points_lie_on_touched_places():
    image = blob(30, 50)
    row, column, scale = dense_points(image).T
    assert (image[row.astype(int), column.astype(int)] >= ACTIVE).all()
    touched = (image[STEP // 2 :: STEP, STEP // 2 :: STEP] >= ACTIVE).sum()
    assert len(row) == touched * len(SCALES)
    assert set(scale) == set(SCALES)
    assert len(dense_points(np.zeros((66, 100), np.uint8))) == 0


def test_as_images_refuses_what_is_none():
    with pytest.raises(InvalidArrayError, match="6600 pixels, got 7"):
        as_images(np.zeros((1, 7)), (66, 100))
    for bad in (-1.0, 256.0, np.nan):
        with pytest.raises(InvalidArrayError, match=r"must lie in 0\.\.255"):
            as_images(np.full((1, 4), bad), (2, 2))


def test_local_features_belong_to_their_images():
    pytest.importorskip("mahotas", reason="the extra `images` is not installed")
    images = np.stack([blob(30, 50), np.zeros((66, 100), np.uint8), blob(2, 3), blob(20, 70)])
    features, owner = local_features(images)
    assert features.shape == (len(owner), 64)
    assert np.isfinite(features).all()
    assert 1 not in owner  # nothing is touched there
    expected = [len(dense_points(image)) for image in images]
    np.testing.assert_array_equal(np.bincount(owner, minlength=4), expected)


def test_dense_surf_has_length_one_and_follows_the_touch():
    pytest.importorskip("mahotas", reason="the extra `images` is not installed")
    images = np.stack([blob(31, 40), blob(31 + 2 * STEP, 40 + 5 * STEP)])
    features, owner = local_features(images)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1.0, atol=1e-6)
    # Moved by whole steps, the same places are described; integral images round in double.
    np.testing.assert_allclose(features[owner == 0], features[owner == 1], atol=1e-9)


def test_bag_of_visual_words_tells_blobs_from_bars():
    pytest.importorskip("mahotas", reason="the extra `images` is not installed")
    from sklearn.pipeline import make_pipeline
    from sklearn.svm import LinearSVC

    rng = np.random.default_rng(0)
    places = rng.uniform([15, 25], [50, 75], (60, 2))
    round_ = [blob(*place).ravel() for place in places[:30]]
    long = [
        np.maximum.reduce([blob(r, c + step) for step in range(-15, 16, 3)]).ravel()
        for r, c in places[30:]
    ]
    table, labels = np.array(round_ + long), np.repeat(["blob", "bar"], 30)
    machine = make_pipeline(BagOfVisualWords(20), LinearSVC(C=0.01, dual=False))
    machine.fit(table[::2], labels[::2])
    assert machine.score(table[1::2], labels[1::2]) == 1.0

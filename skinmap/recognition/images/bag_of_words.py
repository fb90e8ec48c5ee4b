"""Bag of visual words: an image is counts of the visual words that its local features are.

G. Csurka, C. Dance, L. Fan, J. Willamowski and C. Bray, "Visual Categorization with Bags of
Keypoints", ECCV workshop, 2004; on contact images: Albini, Denei and Cannata, IROS 2017.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.recognition.images.visual_features import local_features
from skinmap.touch.images.contact_image import SIZE

WORDS = 130  # as published
LEARNT_FROM = 15_000  # features that k-means sees at most


class BagOfVisualWords(TransformerMixin, BaseEstimator):
    """Histograms of visual words of flattened grey images (n, rows * columns) of 0 to 255.

    Parameters
    ----------
    words : int
        Codewords.
    image_shape : (rows, columns)
    random_state : int
        Of k-means and of the features that it sees.
    """

    def __init__(
        self,
        words: int = WORDS,
        *,
        image_shape: tuple[int, int] = SIZE,
        random_state: int = 0,
    ) -> None:
        self.words, self.image_shape, self.random_state = words, image_shape, random_state

    def fit(self, X: ArrayLike, y: object = None) -> BagOfVisualWords:
        """Learn the codewords from images (n, rows * columns); labels are not looked at."""
        features, _ = self._features(validate_data(self, X))
        self.codewords_ = learn_words(
            features, self.words, np.random.default_rng(self.random_state)
        )
        return self

    def transform(self, X: ArrayLike) -> FloatArray:
        """(n, words) roots of the counts of each word."""
        check_is_fitted(self)
        images = validate_data(self, X, reset=False)
        features, owner = self._features(images)
        return count_words(self.codewords_, features, owner, len(images))

    def _features(self, table: NDArray[Any]) -> tuple[FloatArray, IntArray]:
        return local_features(as_images(table, self.image_shape))


def as_images(table: NDArray[Any], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """(n, rows, columns) uint8 of a table (n, rows * columns) of grey levels.

    Raises
    ------
    InvalidArrayError
        Another number of pixels, or levels outside 0 to 255.
    """
    if table.shape[1] != shape[0] * shape[1]:
        raise InvalidArrayError(
            f"images of {shape[0]} x {shape[1]} have {shape[0] * shape[1]} pixels, "
            f"got {table.shape[1]}"
        )
    if table.size and not (table.min() >= 0 and table.max() <= 255):
        raise InvalidArrayError(
            f"grey levels must lie in 0..255, got {table.min():g} to {table.max():g}"
        )
    return np.asarray(table, np.uint8).reshape(-1, *shape)


def learn_words(features: FloatArray, words: int, rng: np.random.Generator) -> FloatArray:
    """(k, d) codewords of features (n, d) by k-means; fewer where fewer features are distinct.

    Raises
    ------
    InvalidArrayError
        No feature at all: nothing is touched in any image.
    """
    from sklearn.cluster import KMeans

    if words < 1 or len(features) == 0:
        raise InvalidArrayError(f"{words} words cannot be learnt from {len(features)} features")
    if len(features) > LEARNT_FROM:
        features = features[rng.choice(len(features), LEARNT_FROM, replace=False)]
    distinct = np.unique(features, axis=0)
    if len(distinct) <= words:
        return distinct
    seed = int(rng.integers(2**31))
    means = KMeans(words, n_init=1, max_iter=50, random_state=seed).fit(features)
    return np.asarray(means.cluster_centers_)


def count_words(
    codewords: FloatArray, features: FloatArray, owner: IntArray, images: int
) -> FloatArray:
    """(images, k) square roots of how often each codeword is the nearest to a feature.

    Counts, not shares: how much is touched says as much as what it looks like. Their roots
    have about the same spread whether a word is rare or frequent (Poisson).
    """
    # |f - c|^2 = |f|^2 + |c|^2 - 2 f.c; the first term is the same for all words. Features have
    # length 1, so nothing is lost.
    cost = (codewords**2).sum(axis=1) - 2.0 * features @ codewords.T
    number = owner * len(codewords) + cost.argmin(axis=1)
    votes = np.bincount(number, minlength=images * len(codewords))
    return np.sqrt(votes.reshape(images, len(codewords)).astype(np.float64))

"""Bag of visual words: an image is counts of the visual words that its local features are.

G. Csurka, C. Dance, L. Fan, J. Willamowski and C. Bray, "Visual Categorization with Bags of
Keypoints", ECCV workshop, 2004; on contact images: Albini, Denei and Cannata, IROS 2017.

Local features of contact images: dense SURF (mahotas).

H. Bay, A. Ess, T. Tuytelaars and L. Van Gool, "Speeded-Up Robust Features", Computer Vision and
Image Understanding 110(3), 2008.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.imports import import_optional
from skinmap.touch.images.contact_image import SIZE

WIDTH = 64  # numbers a feature
STEP = 3  # pixels between points
SCALES = (1.0, 2.0, 3.0)  # of the points; a feature of scale s sees 20 s x 20 s pixels
ACTIVE = 25  # grey level from which a place is touched: a tenth of the largest pressure
# mahotas leaves out, without a word, points whose turned window may leave the image.
MARGIN = int(np.ceil(17.0 * max(SCALES))) + 1


def local_features(images: NDArray[np.uint8]) -> tuple[FloatArray, IntArray]:
    """Features on a grid over the touched places of all images, one below the other.

    Parameters
    ----------
    images : (t, rows, columns) array of uint8

    Returns
    -------
    features : (k, 64) array of float
    owner : (k,) array of int
        The image of each.

    Raises
    ------
    MissingLibraryError
        mahotas is not installed.
    """
    need = "bags of visual words need mahotas: pip install 'skinmap[images]'"
    surf = import_optional("mahotas.features.surf", need)
    each = [np.zeros((0, WIDTH))]
    for image in images:
        place = dense_points(image)
        if len(place):
            ones = np.ones((len(place), 2))  # score and sign, which describing does not look at
            spots = np.column_stack([place[:, :2] + MARGIN, place[:, 2], ones])
            padded = np.pad(image, MARGIN)
            each.append(np.asarray(surf.descriptors(padded, spots, descriptor_only=True)))
        else:
            each.append(each[0])
    owner = np.repeat(np.arange(len(images)), [len(features) for features in each[1:]])
    return np.concatenate(each), owner


def dense_points(image: NDArray[np.uint8], scales: Sequence[float] = SCALES) -> FloatArray:
    """(k, 3) row, column and scale of the grid points on touched places."""
    row, column = np.nonzero(image[STEP // 2 :: STEP, STEP // 2 :: STEP] >= ACTIVE)
    place = np.column_stack([row, column]) * STEP + STEP // 2
    return np.column_stack([np.tile(place, (len(scales), 1)), np.repeat(scales, len(place))])


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
        self, words: int = WORDS, *, image_shape: tuple[int, int] = SIZE, random_state: int = 0
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

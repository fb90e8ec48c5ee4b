"""Local features of contact images: dense SURF (mahotas).

H. Bay, A. Ess, T. Tuytelaars and L. Van Gool, "Speeded-Up Robust Features", Computer Vision and
Image Understanding 110(3), 2008.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.imports import import_optional

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

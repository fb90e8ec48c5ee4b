"""Local features of contact images: SURF (mahotas) and SIFT (OpenCV), dense or at keypoints.

H. Bay, A. Ess, T. Tuytelaars and L. Van Gool, "Speeded-Up Robust Features", Computer Vision and
Image Understanding 110(3), 2008; D. Lowe, "Distinctive Image Features from Scale-Invariant
Keypoints", IJCV 60(2), 2004.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.imports import import_optional

Kind = Literal["surf", "sift"]
Points = Literal["dense", "detected"]
STEP = 3  # pixels between dense points
SCALES = (1.0, 2.0, 3.0)  # of dense points; a feature of scale s sees 20 s x 20 s pixels
ACTIVE = 25  # grey level from which a place is touched: a tenth of the largest pressure
# mahotas leaves out, without a word, points whose turned window may leave the image.
MARGIN = 17.0
Features = Callable[[NDArray[np.uint8]], FloatArray]


def local_features(
    images: NDArray[np.uint8], *, kind: Kind = "surf", points: Points = "dense"
) -> tuple[FloatArray, IntArray]:
    """Features of all images, one below the other.

    Parameters
    ----------
    images : (t, rows, columns) array of uint8
    kind : {"surf", "sift"}
        64 numbers a feature, or 128.
    points : {"dense", "detected"}
        On a grid over the touched places, or where the method itself finds keypoints (few, on
        images as small as these: half of them have none).

    Returns
    -------
    features : (k, d) array of float
    owner : (k,) array of int
        The image of each.

    Raises
    ------
    MissingLibraryError
        mahotas (SURF) or OpenCV (SIFT) is not installed.
    """
    describe = (_surf if kind == "surf" else _sift)(points)
    each = [describe(image) for image in images]
    width = 64 if kind == "surf" else 128
    owner = np.repeat(np.arange(len(images)), [len(features) for features in each])
    return np.concatenate([np.zeros((0, width)), *each]), owner


def dense_points(image: NDArray[np.uint8], scales: Sequence[float] = SCALES) -> FloatArray:
    """(k, 3) row, column and scale of the grid points on touched places."""
    row, column = np.nonzero(image[STEP // 2 :: STEP, STEP // 2 :: STEP] >= ACTIVE)
    place = np.column_stack([row, column]) * STEP + STEP // 2
    return np.column_stack([np.tile(place, (len(scales), 1)), np.repeat(scales, len(place))])


def _surf(points: Points) -> Features:
    surf = _library("mahotas.features.surf", "mahotas")

    def dense(image: NDArray[np.uint8]) -> FloatArray:
        place = dense_points(image)
        if len(place) == 0:
            return np.zeros((0, 64))
        margin = int(np.ceil(MARGIN * max(SCALES))) + 1
        ones = np.ones((len(place), 2))  # score and sign, which describing does not look at
        spots = np.column_stack([place[:, :2] + margin, place[:, 2], ones])
        return np.asarray(surf.descriptors(np.pad(image, margin), spots, descriptor_only=True))

    def detected(image: NDArray[np.uint8]) -> FloatArray:
        return np.asarray(surf.surf(image.astype(np.float64), descriptor_only=True)).reshape(-1, 64)

    return dense if points == "dense" else detected


def _sift(points: Points) -> Features:
    cv2 = _library("cv2", "opencv-python-headless")
    detector = cv2.SIFT_create()

    def dense(image: NDArray[np.uint8]) -> FloatArray:
        # A keypoint's size is its diameter: half of it is the scale, about a fifth of a bin's.
        spots = [cv2.KeyPoint(float(c), float(r), 4.0 * s) for r, c, s in dense_points(image)]
        return described(detector.compute(image, spots)[1])

    def detected(image: NDArray[np.uint8]) -> FloatArray:
        return described(detector.detectAndCompute(image, None)[1])

    def described(found: Any) -> FloatArray:
        return np.zeros((0, 128)) if found is None else np.asarray(found, np.float64)

    return dense if points == "dense" else detected


def _library(module: str, package: str) -> Any:
    need = f"bags of visual words need {package}: pip install 'skinmap[images]'"
    return import_optional(module, need)

"""Contact images as files: a folder of pictures with `images.npz`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinmap.archive import read_arrays
from skinmap.errors import DataFormatError
from skinmap.imports import import_optional
from skinmap.io.text import check_file

ARRAYS = "images.npz"


@dataclass(frozen=True, eq=False, slots=True)
class LabelledImages:
    """Grey images of touches.

    Attributes
    ----------
    images : (n, rows, columns) uint8
    labels : (n,) str
    touches : (n,) int
        Touch that each image is of.
    parts : (n,) str
        Where it was; empty where nothing tells.
    """

    images: NDArray[np.uint8]
    labels: NDArray[np.str_]
    touches: NDArray[np.int64]
    parts: NDArray[np.str_]


def write_images(found: LabelledImages, folder: Path) -> list[str]:
    """Write each image as PNG, and all of them as `images.npz`; names of the files."""
    pillow = import_optional("PIL.Image", "pictures need Pillow: pip install pillow")
    names = []
    for number, (image, label, part) in enumerate(
        zip(found.images, found.labels, found.parts, strict=True)
    ):
        word = "".join(c if c.isalnum() or c in "-_" else "_" for c in f"{part}_{label}")
        names.append(f"{number:05d}_{word}.png")
        pillow.fromarray(image).save(folder / names[-1])
    np.savez_compressed(
        folder / ARRAYS,
        images=found.images,
        labels=found.labels,
        touches=found.touches,
        parts=found.parts,
        files=np.array(names),
    )
    return [ARRAYS, *names]


def read_images(path: Path) -> LabelledImages:
    """Read labelled grey images, all of one size.

    Parameters
    ----------
    path : Path
        A folder that `write_images` wrote, or its `images.npz`.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or images that are none.
    """
    path = path / ARRAYS if path.is_dir() else path
    check_file(path, "contact images (.npz)", 2**32)
    kept = read_arrays(path)
    missing = [name for name in ("images", "labels") if name not in kept]
    if missing:
        raise DataFormatError(
            f"no array {', '.join(missing)}; the arrays are: {', '.join(kept) or 'none'}", path
        )
    images, labels = kept["images"], kept["labels"]
    if labels.ndim != 1 or labels.dtype.kind != "U":
        raise DataFormatError(f"labels are texts (n,), got {labels.shape} {labels.dtype}", path)
    touches, parts = kept.get("touches", np.arange(len(labels))), kept.get("parts", labels)
    if touches.ndim != 1 or touches.dtype.kind not in "iu" or parts.dtype.kind != "U":
        raise DataFormatError("touches are whole numbers (n,), parts texts (n,)", path)
    if images.ndim != 3 or images.dtype != np.uint8:
        raise DataFormatError(
            f"images are (n, rows, columns) of 8 bits, got {images.shape} of {images.dtype}", path
        )
    if not len(images) == len(labels) == len(touches):
        raise DataFormatError(
            f"{len(images)} images, {len(labels)} labels, {len(touches)} touches", path
        )
    black = np.flatnonzero([image.size == 0 or image.max() == 0 for image in images])
    if len(black):
        raise DataFormatError(f"image {black[0]} is black everywhere: no touch", path)
    if not len(images):
        raise DataFormatError("no images", path)
    return LabelledImages(images, labels, touches.astype(np.int64), parts.astype(str))

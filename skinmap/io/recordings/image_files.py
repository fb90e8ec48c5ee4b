"""Contact images as files: a folder of pictures with `images.npz`, and what others bring."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinmap.archive import read_arrays
from skinmap.errors import DataFormatError, MissingFileError
from skinmap.imports import import_optional
from skinmap.io.text import check_file

ARRAYS = "images.npz"
PICTURES = (".png", ".bmp", ".tif", ".tiff", ".pgm", ".jpg", ".jpeg")
NEED = "pictures need Pillow: pip install pillow"


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
    pillow = import_optional("PIL.Image", NEED)
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
        A folder that `write_images` wrote, its `images.npz`, or a folder with one folder of
        pictures for each label.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or images that are none.
    """
    if not path.exists():
        raise MissingFileError(path, "contact images: a folder or an .npz")
    if path.is_dir() and (path / ARRAYS).exists():
        path = path / ARRAYS
    if path.is_dir():
        return _of_folders(path)
    if path.suffix.lower() == ".npz":
        return _of_arrays(path)
    raise DataFormatError("contact images are a folder or an .npz", path)


def _of_folders(path: Path) -> LabelledImages:
    files = [
        (one, folder.name)
        for folder in sorted(path.iterdir())
        if folder.is_dir()
        for one in sorted(folder.iterdir())
        if one.suffix.lower() in PICTURES
    ]
    if not files:
        raise DataFormatError(
            f"no pictures: a folder for each label (hand, other) or {ARRAYS} is expected", path
        )
    images = [_picture(one) for one, _ in files]
    for image, (one, _) in zip(images, files, strict=True):
        if image.shape != images[0].shape:
            here, first = (" x ".join(map(str, some.shape)) for some in (image, images[0]))
            raise DataFormatError(
                f"{here} pixels, {files[0][0].name} has {first}: images are of one size", one
            )
    labels = np.array([label for _, label in files])
    return LabelledImages(
        np.stack(images), labels, np.arange(len(labels)), np.full(len(labels), "")
    )


def _of_arrays(path: Path) -> LabelledImages:
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
    count = len(labels)
    touches, parts = kept.get("touches", np.arange(count)), kept.get("parts", np.full(count, ""))
    if touches.ndim != 1 or touches.dtype.kind not in "iu" or parts.dtype.kind != "U":
        raise DataFormatError("touches are whole numbers (n,), parts texts (n,)", path)
    if images.ndim != 3 or images.dtype != np.uint8:
        raise DataFormatError(
            f"images are (n, rows, columns) of 8 bits, got {images.shape} of {images.dtype}", path
        )
    if not len(images) == count == len(touches) == len(parts):
        raise DataFormatError(
            f"{len(images)} images, {count} labels, {len(touches)} touches, {len(parts)} parts",
            path,
        )
    for number, image in enumerate(images):
        _refuse_black(image, f"image {number}", path)
    if not len(images):
        raise DataFormatError("no images", path)
    return LabelledImages(images, labels, touches.astype(np.int64), parts.astype(str))


def _picture(path: Path) -> NDArray[np.uint8]:
    pillow = import_optional("PIL.Image", NEED)
    try:
        with pillow.open(path) as file:
            deep = file.mode.startswith("I;16")
            if not deep and file.mode not in ("L", "LA", "P", "1", "RGB", "RGBA"):
                raise DataFormatError(
                    f"grey images of 8 or 16 bits are read, this is {file.mode}", path
                )
            grey = np.asarray(file) / 257.0 if deep else np.asarray(file.convert("L"))
            if "A" in file.getbands():  # nothing is touched where the picture is transparent
                grey = grey * (np.asarray(file.getchannel("A")) / 255.0)
            image = np.rint(grey).astype(np.uint8)
    except (OSError, SyntaxError, ValueError) as error:
        if isinstance(error, DataFormatError):
            raise
        raise DataFormatError("not a picture", path) from error
    _refuse_black(image, "the image", path)
    return image


def _refuse_black(image: NDArray[np.uint8], name: str, path: Path) -> None:
    if image.size == 0 or image.max() == 0:
        raise DataFormatError(f"{name} is black everywhere: no touch", path)

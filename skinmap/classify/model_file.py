"""Model files (`.skinmodel`): JSON, arrays and a skops estimator in a zip, nothing executable."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from skinmap import __version__
from skinmap.classify.classifier import TouchClassifier, classifiers
from skinmap.classify.descriptors import Histograms
from skinmap.errors import DataFormatError, MissingFileError, NotFittedError, SkinError
from skinmap.neighbours.structures import Prototypes
from skinmap.touch.codebook import Codebook

FORMAT = "skinmap-model-1"
SUFFIX = ".skinmodel"
# What an estimator file may contain beside scikit-learn's own trusted types.
TRUSTED = [
    "skinmap.classify.bag_of_words.BagOfVisualWords",
    "skinmap.classify.cnn.ContactImageCNN",
    "skinmap.classify.intersection.IntersectionSVC",
    "sklearn.calibration._CalibratedClassifier",
    "sklearn.calibration._SigmoidCalibration",
]


def save_classifier(classifier: TouchClassifier, path: Path) -> None:
    """Write a trained classifier.

    Raises
    ------
    NotFittedError
        Before training.
    """
    from skops.io import dumps

    head: dict[str, Any] = {
        "format": FORMAT,
        "skinmap": __version__,
        "classifier": classifier.name,
        "labels": list(classifier.labels),
    }
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("estimator.skops", dumps(classifier.estimator))
        if isinstance(classifier.descriptor, Histograms):
            head["codebook"] = _write_codebook(archive, classifier.descriptor)
        archive.writestr("model.json", json.dumps(head, indent=1))
    path.write_bytes(buffer.getvalue())


def load_classifier(path: str | Path) -> TouchClassifier:
    """Read a classifier; nothing in the file is executed.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not a model of ours, or one that holds types that a model has no use for.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(path, f"a model made by `skinmap train` ({SUFFIX})")
    try:
        with zipfile.ZipFile(path) as archive:
            head = json.loads(archive.read("model.json"))
            if head["format"] != FORMAT:
                raise DataFormatError(f"format {head['format']!r}, expected {FORMAT!r}", path)
            classifier = classifiers.get(head["classifier"])()
            classifier.estimator = _read_estimator(archive.read("estimator.skops"), path)
            if isinstance(classifier.descriptor, Histograms):
                classifier.descriptor.codebook = _read_codebook(archive, head["codebook"])
            return classifier
    except SkinError:
        raise
    # A damaged file fails in zip, JSON, numpy or skops, each in its own way.
    except Exception as error:
        raise DataFormatError(f"not a model of ours: {error}", path) from error


def _read_estimator(data: bytes, path: Path) -> object:
    from skops.io import get_untrusted_types, loads

    foreign = sorted(set(get_untrusted_types(data=data)) - set(TRUSTED))
    if foreign:
        raise DataFormatError(f"refused: it holds {', '.join(foreign)}", path)
    return loads(data, trusted=TRUSTED)


def _write_codebook(archive: zipfile.ZipFile, descriptor: Histograms) -> dict[str, object]:
    book = descriptor.codebook
    if book is None:
        raise NotFittedError("no codebook to save: train the classifier first")
    shapes = book.prototypes
    buffer = io.BytesIO()
    np.savez(
        buffer,
        words=book.words,
        offsets=shapes.offsets,
        filled=shapes.filled,
        required=shapes.required,
    )
    archive.writestr("codebook.npz", buffer.getvalue())
    return {
        "literal": book.literal,
        "tolerance": shapes.tolerance,
        "rotations": shapes.rotations,
    }


def _read_codebook(archive: zipfile.ZipFile, head: dict[str, Any]) -> Codebook:
    with np.load(io.BytesIO(archive.read("codebook.npz")), allow_pickle=False) as arrays:
        shapes = Prototypes(
            arrays["offsets"],
            arrays["filled"],
            arrays["required"],
            float(head["tolerance"]),
            int(head["rotations"]),
        )
        return Codebook(shapes, arrays["words"], bool(head["literal"]))

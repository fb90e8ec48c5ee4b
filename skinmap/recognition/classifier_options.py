"""Classifiers with other settings than their own: what trades speed for accuracy."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, cast

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.neighbours.offsets import WIDEST
from skinmap.recognition.classifier import TouchClassifier, classifiers
from skinmap.recognition.descriptors import Histograms
from skinmap.recognition.images.image_descriptor import LARGEST, PaperImages

OF_HISTOGRAMS = ("radius_mm", "words", "rotations", "distance")
OF_IMAGES = ("image_size", "words", "network")
ROTATIONS = (1, 4, 6)
DISTANCES = ("euclidean", "geodesic")
MAX_WORDS = 250  # votes are counted with one byte a word


def tuned_classifier(name: str, knobs: Mapping[str, Any]) -> TouchClassifier:
    """An untrained classifier with some settings of its own changed.

    Parameters
    ----------
    name : str
    knobs : mapping of str to value
        `radius_mm`, `words`, `rotations` and `distance` of classifiers that count histograms;
        `image_size` ("66x100") and `words` of those that look at contact images, and `network`
        ("small", "paper") of `cnn`.
        Those that are None are left as they are.

    Raises
    ------
    UnknownNameError
        No such classifier, knob, or value of a knob.
    InvalidArrayError
        A number out of range, or a knob that does not concern the classifier.
    """
    model = classifiers.get(name)()
    given = {knob: value for knob, value in knobs.items() if value is not None}
    tuned: set[str] = set()
    if isinstance(model.descriptor, Histograms):
        tuned = _tune_histograms(model.descriptor, given)
    elif isinstance(model.descriptor, PaperImages):
        tuned = _tune_images(model, given)
    for knob in given:
        if knob not in (*OF_HISTOGRAMS, *OF_IMAGES):
            raise UnknownNameError(
                "knob of classifiers", knob, dict.fromkeys((*OF_HISTOGRAMS, *OF_IMAGES))
            )
        if knob not in tuned:
            raise InvalidArrayError(f"{knob} does not concern the classifier {name!r}")
    return model


def _tune_histograms(descriptor: Histograms, knobs: Mapping[str, Any]) -> set[str]:
    if "radius_mm" in knobs:
        descriptor.radius = _within("radius_mm", knobs["radius_mm"], 0.1, WIDEST * 1e3) * 1e-3
    if "words" in knobs:
        descriptor.words = int(_within("words", knobs["words"], 2, MAX_WORDS))
    if "rotations" in knobs:
        if knobs["rotations"] not in ROTATIONS:
            raise UnknownNameError("rotations", str(knobs["rotations"]), map(str, ROTATIONS))
        descriptor.rotations = int(knobs["rotations"])
    if "distance" in knobs:
        if knobs["distance"] not in DISTANCES:
            raise UnknownNameError("distance", str(knobs["distance"]), DISTANCES)
        descriptor.distance = knobs["distance"]
    return set(OF_HISTOGRAMS) & knobs.keys()


def _tune_images(model: TouchClassifier, knobs: Mapping[str, Any]) -> set[str]:
    steps = [step for _, step in getattr(model.estimator, "steps", [("", model.estimator)])]
    changed: set[str] = set()
    for step in steps:
        if "image_size" in knobs and hasattr(step, "image_shape"):
            cast("PaperImages", model.descriptor).size = read_size(knobs["image_size"])
            step.image_shape = read_size(knobs["image_size"])
            changed.add("image_size")
        if "network" in knobs and hasattr(step, "network"):
            from skinmap.recognition.images.cnn import RECIPES

            if knobs["network"] not in RECIPES:
                raise UnknownNameError("network", str(knobs["network"]), RECIPES)
            step.network = knobs["network"]
            changed.add("network")
        if "words" in knobs and hasattr(step, "words"):
            step.words = int(_within("words", knobs["words"], 2, MAX_WORDS))
            changed.add("words")
    return changed


def read_size(text: object) -> tuple[int, int]:
    """(rows, columns) of a text such as "66x100".

    Raises
    ------
    InvalidArrayError
        Another text, or sides that no contact image has.
    """
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", str(text))
    rows, columns = (int(match[1]), int(match[2])) if match else (0, 0)
    if not (0 < rows <= LARGEST and 0 < columns <= LARGEST):
        raise InvalidArrayError(
            f"image_size wants rows x columns of 1 to {LARGEST} as 66x100, got {text!r}"
        )
    return rows, columns


def _within(knob: str, value: Any, least: float, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise InvalidArrayError(f"{knob} must be {least:g} to {most:g}, got {value!r}")
    return float(value)

"""From recordings to a trained classifier, in one call.

Classifiers with other settings than their own: what trades speed for accuracy.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.neighbours.offsets import WIDEST
from skinmap.recognition.catalogue import DEFAULT
from skinmap.recognition.classifier import WITH_SETS, TouchClassifier, classifiers
from skinmap.recognition.descriptors import Histograms, recorded_touches
from skinmap.recognition.sample_descriptors import LARGEST, PaperImages
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import prepare_skins
from skinmap.touch.recording import Recording

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


def train(
    recordings: Recording | Sequence[Recording],
    robot: Robot,
    *,
    classifier: str = DEFAULT,
    parts: Sequence[str] | None = None,
    settings: Mapping[str, Any] | None = None,
    groups: Mapping[str, Sequence[str]] | None = None,
    motions: Sequence[str] = (),
    rng: np.random.Generator | int = 0,
) -> TouchClassifier:
    """Train a classifier of touches on labelled recordings.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        Pressures (t, n) of 0 to 255 counts with marked touches, one recording a part.
    robot : Robot
        Whose skins were touched.
    classifier : str
        Name of the classifier; those of plug-ins count too.
    parts : sequence of str, optional
        Train on these of the recorded parts only; on all by default.
    settings : mapping of str to value, optional
        As `skinmap train` has them: `words`, `radius_mm`, ...
    groups : mapping of str to sequence of str, optional
        Labels that are a `hand` and those that are something `other`, each label in one of the two:
        the model learns `hand` from them.
    motions : sequence of str
        Labels that name how a touch moves, beside those that are simulated.
    rng : numpy.random.Generator or int
        A number is its seed.

    Returns
    -------
    Classifier
        Trained.

    Raises
    ------
    UnknownNameError
        No such classifier, or a part that is not recorded or that the robot lacks; a group or
        motion of a label that is not there.
    SkinMismatchError
        A recording of another number of taxels than the skin's.
    InvalidArrayError
        Fewer than two labels, or a label with fewer than five touches; settings that do not
        concern the classifier; groups that overlap or miss a label.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> gestures = ["poke", "full_finger"]
    >>> touches = skinmap.simulate(robot.skin("torso"), gestures=gestures, per_gesture=8, rng=0)
    >>> skinmap.train(touches, robot).labels
    ('full_finger', 'poke')
    """
    from skinmap.recognition.answering import check_groups, check_motions, learn_answers

    untrained = tuned_classifier(classifier, dict(settings or {}))
    every = [recordings] if isinstance(recordings, Recording) else list(recordings)
    recorded = [one.part for one in every]
    for part in parts or ():
        if part not in recorded:
            raise UnknownNameError("recorded part", part, recorded)
    chosen = [one for one in every if parts is None or one.part in parts]
    skins = prepare_skins(robot, chosen)
    touches = [touch for one in chosen for touch in recorded_touches(skins[one.part], one)]
    names, rng = sorted({touch.label for touch in touches}), np.random.default_rng(rng)
    if groups is not None:
        check_groups(groups, names)
    moving = check_motions(motions, names)
    model = untrained.fit(touches, rng=rng, sets=untrained.name in WITH_SETS)
    learn_answers(model, touches, groups=groups, motions=moving, rng=rng)
    return model

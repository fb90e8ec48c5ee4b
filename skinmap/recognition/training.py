"""From recordings to a trained classifier, in one call.

Classifiers with other settings than their own: what trades speed for accuracy.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from skinmap.errors import InvalidArrayError, UnknownNameError, check_known
from skinmap.neighbours.offsets import WIDEST
from skinmap.recognition.catalogue import DEFAULT
from skinmap.recognition.classifier import WITH_SETS, TouchClassifier, classifiers
from skinmap.recognition.descriptors import LARGEST, recorded_touches
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import prepare_skins
from skinmap.touch.recording import Recording

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
    steps = [step for _, step in getattr(model.estimator, "steps", [("", model.estimator)])]
    given = {knob: value for knob, value in knobs.items() if value is not None}
    check_known("knob of classifiers", given, KNOBS)
    for knob, value in given.items():
        attributes, read = KNOBS[knob]
        things = [(one, own) for one in (model.descriptor, *steps) for own in attributes]
        held = [(one, own) for one, own in things if hasattr(one, own)]
        if not held:
            raise InvalidArrayError(f"{knob} does not concern the classifier {name!r}")
        for one, own in held:
            setattr(one, own, read(value))
    return model


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


def _within(knob: str, least: float, most: float, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise InvalidArrayError(f"{knob} must be {least:g} to {most:g}, got {value!r}")
    return float(value)


def _one_of(knob: str, known: Sequence[Any], value: Any) -> Any:
    if value not in known:
        raise UnknownNameError(knob, str(value), map(str, known))
    return value


# By knob, what it is called where it is kept, in a descriptor or a step of an estimator, and how
# its value is read.
KNOBS: dict[str, tuple[tuple[str, ...], Callable[[Any], Any]]] = {
    "radius_mm": (("radius",), lambda mm: 1e-3 * _within("radius_mm", 0.1, 1e3 * WIDEST, mm)),
    "words": (("words",), lambda count: int(_within("words", 2, MAX_WORDS, count))),
    "rotations": (("rotations",), lambda order: int(_one_of("rotations", (1, 4, 6), order))),
    "distance": (("distance",), partial(_one_of, "distance", ("euclidean", "geodesic"))),
    "image_size": (("size", "image_shape"), read_size),
    "network": (("network",), partial(_one_of, "network", ("paper", "small"))),
}


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
    check_known("recorded part", parts or (), recorded)
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

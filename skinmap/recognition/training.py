"""From recordings to a trained classifier, in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skinmap.errors import UnknownNameError
from skinmap.recognition.catalogue import DEFAULT
from skinmap.recognition.classifier import WITH_SETS, TouchClassifier
from skinmap.recognition.classifier_options import tuned_classifier
from skinmap.recognition.descriptors import recorded_touches
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import prepare_skins
from skinmap.touch.recording import Recording


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

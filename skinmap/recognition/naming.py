"""From recorded samples to named touches: grouped first, each named on its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, IntArray
from skinmap.errors import SkinMismatchError
from skinmap.recognition.classifier import NO_CONTACT, Prediction, TouchClassifier
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.prediction_sets import OR, UNKNOWN
from skinmap.skin.robot import Robot
from skinmap.touch.contacts.grouping import RULE, GroupingRule, group_touches
from skinmap.touch.contacts.rest import Rest, felt, usual_rest
from skinmap.touch.contacts.skin_geometry import check_pressures, pool_event
from skinmap.touch.prepared_skin import PreparedSkin, prepare_skins
from skinmap.touch.recording import JOIN, Recording

FINGERTIP = 15e-3  # its width [m]


@dataclass(frozen=True, eq=False, slots=True)
class Named:
    """One touch of an event: its taxels (n,) bool, and its name."""

    taxels: BoolArray
    prediction: Prediction


def name_touches(
    classifier: TouchClassifier,
    skin: PreparedSkin,
    samples: NDArray[np.uint8],
    *,
    rule: GroupingRule = RULE,
    ended: bool = True,
    rest: Rest | None = None,
    person: str = "",
    known: IntArray | None = None,
) -> tuple[Named, ...]:
    """Group the samples (k, n) of one event into touches and name each; empty without contact.

    Parameters
    ----------
    classifier : TouchClassifier
        Trained.
    skin : PreparedSkin
        n taxels.
    samples : (k, n) array of 0 to 255
    rule : GroupingRule
        When contacts are one grip.
    ended : bool
        Whether the event is over.
    rest : Rest, optional
        What the taxels read untouched; that of a skin with little noise by default. What is not
        more than that, or on one taxel alone, is nobody's touch.
    person : str
        Who touched, by name, where that is known.
    known : (n,) int, optional
        Touch of each taxel before the samples, where these are the last ones of a longer event;
        -1 for none.

    Returns
    -------
    tuple of Named
        Taxels (n,) bool and prediction of each touch, the heaviest first.

    Raises
    ------
    SkinMismatchError, InvalidArrayError
        Samples of another skin, NaN or infinity.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("torso")
    >>> recording = skinmap.simulate(skin, gestures=["poke"], per_gesture=5, rng=0)
    >>> _, _, samples = next(recording.touches())
    >>> from skinmap.recognition import default_model
    >>> [one.prediction.label for one in name_touches(default_model(), PreparedSkin(skin), samples)]
    ['poke']
    """
    samples = check_pressures(samples, skin.geometry)
    rest = usual_rest(len(skin)) if rest is None else rest
    samples = felt(samples, rest, skin.geometry.beside)
    answers = getattr(classifier, "answers", None)  # a plug-in of before has none
    groups = group_touches(
        skin.geometry, samples, rule=rule, ended=ended, levels=rest.begins, known=known
    )
    found = []
    for taxels in groups:
        # A touch that is alone keeps its faint rim, as in training.
        own = samples if len(groups) == 1 else np.where(taxels, samples, 0)
        touch = Touch(skin, own, person=person, rate=rule.rate)
        prediction = classifier.predict(touch, ended=ended)
        if prediction.label != NO_CONTACT:
            if answers is not None:
                prediction = replace(prediction, answers=answers.of(touch))
            found.append(Named(taxels, prediction))
    return tuple(found)


def not_felt(
    classifier: TouchClassifier,
    skin: PreparedSkin,
    samples: NDArray[np.uint8],
    rest: Rest,
    person: str = "",
) -> Prediction:
    """The name of samples (k, n) that hold no touch: `no_contact`, by a person of this name.

    It is half sure, and alone in no set, where a press on one taxel was dropped as a spike on a
    skin so coarse that it may have been a finger.
    """
    found = classifier.no_contact(skin, person)
    if skin.pitch <= FINGERTIP or not (samples > rest.begins)[:, ~rest.stuck].any():
        return found
    names = None if found.names is None else (NO_CONTACT, *classifier.labels)
    return replace(found, confidence=0.5, names=names)


def in_words(prediction: Prediction) -> str:
    """A name, or the names that hold the truth where they were asked for: "poke or edge"."""
    if prediction.names is None:
        return prediction.label
    return OR.join(prediction.names) or UNKNOWN


def true_labels(
    named: Sequence[Named], samples: NDArray[np.uint8], label: str, owners: IntArray | None
) -> list[str]:
    """The recorded label of each named touch: of the touch that owns most of its load."""
    kinds = label.split(JOIN)
    if owners is None or len(kinds) == 1:
        return [label] * len(named)
    load = pool_event(samples)
    found = []
    for touch in named:
        own = touch.taxels & (owners >= 0)
        weight = np.bincount(owners[own], load[own], minlength=len(kinds))
        found.append(kinds[int(np.argmax(weight))])
    return found


def all_right(
    named: Sequence[Named], samples: NDArray[np.uint8], label: str, owners: IntArray | None = None
) -> bool:
    """Whether an event was understood: as many touches as recorded, each under its own name.

    Raises
    ------
    SkinMismatchError
        Owners of another skin.
    """
    if owners is not None and owners.shape != (samples.shape[1],):
        raise SkinMismatchError(f"{owners.size} owners for {samples.shape[1]} taxels")
    kinds = label.split(JOIN)
    truth = true_labels(named, samples, label, owners)
    said = [touch.prediction.label for touch in named]
    return sorted(truth) == sorted(kinds) and said == truth


def named_events(
    classifier: TouchClassifier, skin: PreparedSkin, recording: Recording, rule: GroupingRule = RULE
) -> Iterator[tuple[int, NDArray[np.uint8], list[tuple[Named, str]], bool]]:
    """Name the marked touches of a recording, event by event.

    Yields
    ------
    event : int
    samples : (k, n) uint8
        What was felt; none (0, n) where nothing was.
    named : list of (Named, str)
        Each touch with its recorded label; one of no taxels where nothing was felt.
    understood : bool
        As `all_right` has it.
    """
    rest, rule = recording.rest(), replace(rule, rate=recording.rate)
    for event, label, samples in recording.touches():
        owners = None if recording.owners is None else recording.owners[event]
        person = recording.people[event]
        named = name_touches(classifier, skin, samples, rule=rule, rest=rest, person=person)
        truth = true_labels(named, samples, label, owners)
        understood = all_right(named, samples, label, owners)
        if not named:
            said = not_felt(classifier, skin, samples, rest, person)
            samples, named, truth = samples[:0], (Named(np.zeros(len(skin), bool), said),), [label]
        yield event, samples, list(zip(named, truth, strict=True)), understood


@dataclass(frozen=True, slots=True)
class ClassifiedTouch:
    """Name of one recorded touch.

    Attributes
    ----------
    part : str
    event, touch : int
        Number of the event in its recording, and of the touch within it.
    label : str
        `no_contact` where nothing is touched, `unknown` where the classifier is too unsure.
    confidence : float
        Confidence in the label, 0 to 1.
    recorded_label : str
        What the recording calls it.
    """

    part: str
    event: int
    touch: int
    label: str
    confidence: float
    recorded_label: str


def classify(
    recordings: Recording | Sequence[Recording],
    classifier: TouchClassifier,
    robot: Robot,
    *,
    rule: GroupingRule = RULE,
) -> list[ClassifiedTouch]:
    """Name the marked touches of recordings.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        Pressures (t, n) of 0 to 255 counts with marked touches, one recording a part.
    classifier : Classifier
        Trained.
    robot : Robot
        Whose skins were touched.
    rule : GroupingRule
        When contacts are one grip.

    Returns
    -------
    list of ClassifiedTouch
        In the order of the recordings; several of one event where several touches came at once.

    Raises
    ------
    UnknownNameError
        A recorded part that the robot lacks.
    SkinMismatchError
        A recording of another number of taxels, or a skin that the classifier cannot read.
    NotFittedError
        A classifier that is not trained.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> gestures = ["poke", "full_finger"]
    >>> touches = skinmap.simulate(robot.skin("torso"), gestures=gestures, per_gesture=8, rng=0)
    >>> named = skinmap.classify(touches, skinmap.train(touches, robot), robot)
    >>> sum(one.label == one.recorded_label for one in named) >= 14
    True
    """
    every = [recordings] if isinstance(recordings, Recording) else recordings
    skins = prepare_skins(robot, every)
    classifier.check_skins(skins.values())
    return [
        ClassifiedTouch(
            one.part, event, number, said.prediction.label, said.prediction.confidence, recorded
        )
        for one in every
        for event, _, named, _ in named_events(classifier, skins[one.part], one, rule)
        for number, (said, recorded) in enumerate(named)
    ]

"""How well classifiers do: on other touches of the same parts, and on parts never trained on.

Few touches of a label: the model learns from all of them, and each is tested by another.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress

import numpy as np

from skinmap.errors import InvalidArrayError, check_known
from skinmap.recognition.classifier import (
    CALIBRATION_FOLDS,
    NO_CONTACT,
    Classifier,
    Prediction,
    TouchClassifier,
)
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.prediction_sets import LEARNT
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording

HELD_OUT = 0.3  # share of the touches of the trained parts that only test


@dataclass(frozen=True, slots=True)
class Score:
    """How many of n touches got their right name; the name is the likeliest label.

    Attributes
    ----------
    accuracy : float
        Share, 0 to 1.
    touches : int
        n.
    per_label, per_part : mapping of str to float
        Shares of the touches of a label, and on a part.
    unknown : float
        Share of touches that the classifier would rather have left unnamed.
    counts : mapping of str to int
        Touches of each label.
    """

    accuracy: float
    touches: int
    per_label: Mapping[str, float]
    per_part: Mapping[str, float]
    unknown: float = 0.0
    counts: Mapping[str, int] = field(default_factory=dict)


@dataclass(slots=True)
class Split:
    """Touches to train on, other touches of the same parts, and touches of other parts."""

    train: tuple[Touch, ...]
    same_parts: tuple[Touch, ...]
    other_parts: tuple[Touch, ...]


def split_touches(
    skins: Mapping[str, PreparedSkin],
    recordings: Sequence[Recording],
    train_parts: Sequence[str],
    *,
    rng: np.random.Generator,
) -> Split:
    """Divide touch events, never samples of one event, into training and two tests.

    Raises
    ------
    UnknownNameError
        A part to train on that no recording is of.
    """
    check_known("recorded part", train_parts, [recording.part for recording in recordings])
    every = [(one.part, recorded_touches(skins[one.part], one)) for one in recordings]
    return split_parts(every, train_parts, rng=rng)


def split_parts(
    touches: Sequence[tuple[str, Sequence[Touch]]],
    train_parts: Sequence[str],
    *,
    rng: np.random.Generator,
    by_label: bool = False,
) -> Split:
    """Divide the touches of parts that were recorded, of each recording or skin apart.

    With `by_label` each label gives the same share, to within a touch.
    """
    found = Split((), (), ())
    for part, own in touches:
        if part not in train_parts:
            found.other_parts += (*own,)
            continue
        place = rng.permutation(len(own))
        if by_label:  # evenly along a list sorted by label
            order = place[np.argsort(np.array([own[k].label for k in place]), kind="stable")]
            held = np.zeros(len(own), bool)
            held[order] = np.diff(np.ceil(HELD_OUT * np.arange(len(own) + 1))) > 0
        else:
            held = place < HELD_OUT * len(own)
        found.same_parts += tuple(compress(own, held))
        found.train += tuple(compress(own, ~held))
    return found


def likeliest(classifier: TouchClassifier, touch: Touch) -> Prediction:
    """The likeliest label, however unsure the classifier is; `no_contact` where nothing is touched.

    Tests count by it: a classifier that says `unknown` more often must not look better or worse.

    Parameters
    ----------
    classifier : Classifier
        Trained.
    touch : Touch

    Returns
    -------
    Prediction
        Label, and its probability from 0 to 1.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("torso")
    >>> recording = skinmap.simulate(skin, gestures=["poke"], per_gesture=5, rng=0)
    >>> touches = recorded_touches(PreparedSkin(skin), recording)
    >>> from skinmap.recognition import default_model
    >>> likeliest(default_model(), touches[0]).label
    'poke'
    """
    share = classifier.probabilities(touch)
    if share is None:
        return Prediction(NO_CONTACT, 1.0)
    best = int(np.argmax(share))
    return Prediction(classifier.labels[best], float(share[best]))


def score(classifier: TouchClassifier, touches: Sequence[Touch]) -> Score:
    """Accuracy per touch event.

    Parameters
    ----------
    classifier : Classifier
        Trained.
    touches : sequence of Touch
        Labelled.

    Returns
    -------
    Score
        Shares from 0 to 1; NaN where there is no touch.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("torso")
    >>> recording = skinmap.simulate(skin, gestures=["poke"], per_gesture=5, rng=0)
    >>> touches = recorded_touches(PreparedSkin(skin), recording)
    >>> from skinmap.recognition import default_model
    >>> score(default_model(), touches).accuracy >= 0.8
    True
    """
    named = [likeliest(classifier, touch) for touch in touches]
    return score_of(named, touches, float(getattr(classifier.estimator, "reject_", 0.0)))


def score_of(named: Sequence[Prediction], touches: Sequence[Touch], least: float) -> Score:
    """Accuracy of names that were given; `unknown` is the share below a confidence."""
    right = np.array([one.label == touch.label for one, touch in zip(named, touches, strict=True)])
    unsure = np.array([one.confidence < least for one in named])
    labels = np.array([touch.label for touch in touches])
    parts = np.array([touch.skin.skin.part for touch in touches])
    return Score(
        float(right.mean()) if len(right) else float("nan"),
        len(right),
        {str(label): float(right[labels == label].mean()) for label in np.unique(labels)},
        {str(part): float(right[parts == part].mean()) for part in np.unique(parts)},
        float(unsure.mean()) if len(right) else float("nan"),
        dict(Counter(labels.tolist())),
    )


FOLDS = 5


def is_few(train: Sequence[Touch], held: Sequence[Touch] = ()) -> bool:
    """Whether what is held out leaves some label with too few touches to learn from.

    By its share, and by the touches that chance has left.
    """
    left = Counter(touch.label for touch in train)
    every = left + Counter(touch.label for touch in held)
    share = min(every.values(), default=0) * (1.0 - HELD_OUT)
    return share < CALIBRATION_FOLDS + 1 or min(left[one] for one in every) < CALIBRATION_FOLDS


def score_in_turn(
    make: Callable[[], Classifier],
    touches: Sequence[Touch],
    extra: Sequence[Touch] = (),
    *,
    rng: np.random.Generator,
) -> Score:
    """Every touch named by a model of the others, in five folds of equal shares of the labels.

    Parameters
    ----------
    make : callable
        An untrained classifier.
    touches : sequence of Touch
    extra : sequence of Touch
        To learn from in every fold, and never tested.
    rng : numpy.random.Generator

    Returns
    -------
    Score
        NaN where some fold's training is refused.
    """
    from sklearn.model_selection import StratifiedKFold

    labels = np.array([touch.label for touch in touches])
    split = StratifiedKFold(FOLDS, shuffle=True, random_state=int(rng.integers(2**31)))
    named, tested = [], []
    try:
        for train, test in split.split(labels, labels):
            learnt = [touches[k] for k in train] + list(extra)
            model = make().fit(learnt, rng=rng, least=LEARNT)
            named += [likeliest(model, touches[k]) for k in test]
            tested += [touches[k] for k in test]
    except (InvalidArrayError, ValueError):
        return score_of([], [], 0.0)
    return score_of(named, tested, 0.0)

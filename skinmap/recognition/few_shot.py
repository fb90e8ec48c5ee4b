"""Few touches of a label: the model learns from all of them, and each is tested by another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from skinmap.errors import InvalidArrayError
from skinmap.recognition.classifier import CALIBRATION_FOLDS, Classifier
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.evaluate import HELD_OUT, Score, likeliest, score_of

FOLDS = 5
LEAST = 2  # touches of a label that a model of a fold may learn from


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
            model = make().fit(learnt, rng=rng, least=LEAST)
            named += [likeliest(model, touches[k]) for k in test]
            tested += [touches[k] for k in test]
    except (InvalidArrayError, ValueError):
        return score_of([], [], 0.0)
    return score_of(named, tested, 0.0)

"""What a classifier is worth on touches that it did not learn from: scores of sets, and doubt."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skinmap.arrays import IntArray
from skinmap.recognition.sets.prediction_sets import FOLDS, SetCalibration, left_out_by
from skinmap.recognition.sets.rejection import AGES
from skinmap.skin.checks import twin_parts
from skinmap.touch.contacts.skin_geometry import ACTIVE

if TYPE_CHECKING:
    from skinmap.recognition.classifier import Classifier
    from skinmap.recognition.descriptors import Touch

YOUNG = 600  # touches at most whose beginnings are looked at
LEAST = 2  # touches of a label that a copy may learn from


def held_out(
    copy: Callable[[], Classifier], touches: Sequence[Touch], *, rng: np.random.Generator
) -> tuple[SetCalibration, list[list[float]]]:
    """How improbable copies of a classifier find the true names of touches they never saw.

    Groups are left out in turn: parts, with their mirror images, where there are three or more,
    else people by name, else touches at random. Each copy learns all anew, its descriptor too.

    Parameters
    ----------
    copy : callable
        Gives an untrained classifier.
    touches : sequence of Touch
        Labelled.
    rng : numpy.random.Generator

    Returns
    -------
    SetCalibration
        Of all touches.
    list of list of float
        For each of `AGES` the probabilities of the true names of touches that went on so long.
    """
    skins = dict.fromkeys(touch.skin for touch in touches)
    shape_of = twin_parts({skin.fingerprint: skin.skin for skin in skins})
    known = tuple(touch.skin.fingerprint for touch in touches)
    shapes = tuple(shape_of[one] for one in known)
    people = tuple(touch.person for touch in touches)
    fold = left_out_by(shapes, people)[1] % FOLDS
    young = rng.permutation(len(touches)) < YOUNG
    shares, strange = np.zeros(len(touches)), np.zeros(len(touches))
    early: list[list[float]] = [[] for _ in AGES]
    for number in np.unique(fold):
        model = copy()
        try:
            learnt = [one for one, own in zip(touches, fold, strict=True) if own != number]
            model.fit(learnt, rng=rng, least=LEAST)
        except ValueError:
            continue  # nothing to learn from: their names stay impossible
        for k in np.flatnonzero(fold == number).tolist():
            shares[k] = _of_the_truth(model, touches[k], touches[k].label)
            strange[k] = model.strangeness(touches[k])
            if young[k]:
                for age, begun in _beginnings(touches[k]):
                    early[age].append(_of_the_truth(model, begun, touches[k].label))
    return SetCalibration(shares, strange, known, shapes, people), early


def felt_rows(touch: Touch) -> IntArray:
    """Which of a touch's samples anything is felt in."""
    return np.flatnonzero((touch.samples > ACTIVE).any(axis=1))


def _of_the_truth(model: Classifier, touch: Touch, label: str) -> float:
    """The probability of a name; 0 of one that was not learnt, or where nothing is felt."""
    share = model.probabilities(touch)
    known = share is not None and label in model.labels
    return float(share[model.labels.index(label)]) if known and share is not None else 0.0


def _beginnings(touch: Touch) -> Iterator[tuple[int, Touch]]:
    """The touch as it was at each of `AGES` (by number) while it went on."""
    felt = felt_rows(touch)
    for number, age in enumerate(AGES):
        end = felt[0] + max(1, round(age * touch.rate)) if len(felt) else 0
        if len(felt) == 0 or end > felt[-1]:
            return  # over by then
        yield number, replace(touch, samples=touch.samples[:end])

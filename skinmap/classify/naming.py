"""From the samples of one event to named touches: grouped first, each named on its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, IntArray
from skinmap.classify.classifier import NO_CONTACT, Prediction, TouchClassifier
from skinmap.classify.descriptors import Touch
from skinmap.errors import SkinMismatchError
from skinmap.touch.contacts import pool_event
from skinmap.touch.grouping import RULE, GroupingRule, group_touches
from skinmap.touch.prepared_skin import PreparedSkin

JOIN = "+"  # between the labels of touches that overlap in time


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

    Raises
    ------
    SkinMismatchError, InvalidArrayError
        Samples of another skin, NaN or infinity.
    """
    samples = np.asarray(samples)
    groups = group_touches(skin.geometry, samples, rule=rule, ended=ended)
    found = []
    for taxels in groups:
        # A touch that is alone keeps its faint rim, as in training.
        own = samples if len(groups) == 1 else np.where(taxels, samples, 0)
        prediction = classifier.predict(Touch(skin, own))
        if prediction.label != NO_CONTACT:
            found.append(Named(taxels, prediction))
    return tuple(found)


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

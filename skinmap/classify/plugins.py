"""Plug-ins: scikit-learn classifiers of other distributions, made into classifiers of touches.

An entry point of the group `skinmap.classifiers` gives a class or a function without arguments.
What that makes is a `TouchClassifier`, or anything with scikit-learn's `fit` and `predict` and
an attribute `input_kind`: "raw", "histogram", "image" or "contact-geometry".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin, clone

from skinmap.arrays import FloatArray
from skinmap.classify.classifier import TouchClassifier, calibrated
from skinmap.classify.sample_descriptors import INPUT_KINDS, descriptor_of
from skinmap.errors import InvalidArrayError


class LabelsOnly(ClassifierMixin, BaseEstimator):
    """Probabilities of a classifier that gives labels only: one for the label, none for others.

    The confidence of a touch is then the share of its rows that agree.
    """

    def __init__(self, estimator: Any) -> None:
        self.estimator = estimator

    def fit(self, X: ArrayLike, y: ArrayLike) -> LabelsOnly:
        """Train a copy of the classifier."""
        self.classes_ = np.unique(np.asarray(y))
        self.estimator_ = clone(self.estimator, safe=False)
        self.estimator_.fit(X, y)
        return self

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """(n,) labels."""
        return np.asarray(self.estimator_.predict(X))

    def predict_proba(self, X: ArrayLike) -> FloatArray:
        """(n, classes) of 0 and 1."""
        return (self.predict(X)[:, None] == self.classes_).astype(np.float64)


def plugged_in(name: str, thing: object) -> Callable[[], TouchClassifier]:
    """A function that makes a touch classifier of what a plug-in's entry point gave."""

    def make() -> TouchClassifier:
        if not callable(thing):
            raise InvalidArrayError(
                f"the plug-in {name!r} must be a class or a function, got {type(thing).__name__}"
            )
        return touch_classifier(name, thing())

    return make


def touch_classifier(name: str, made: Any) -> TouchClassifier:
    """A touch classifier of what a plug-in made.

    Raises
    ------
    InvalidArrayError
        No `fit` and `predict`, or no `input_kind`.
    UnknownNameError
        An input kind that there is not.
    """
    if isinstance(made, TouchClassifier):
        made.name = name
        return made
    for method in ("fit", "predict"):
        if not callable(getattr(made, method, None)):
            raise InvalidArrayError(f"the plug-in {name!r} has no method {method!r}")
    kind = getattr(made, "input_kind", None)
    if kind is None:
        raise InvalidArrayError(
            f"the plug-in {name!r} names no input_kind; the input kinds are: "
            f"{', '.join(INPUT_KINDS)}"
        )
    return TouchClassifier(name, descriptor_of(kind), with_probabilities(made))


def with_probabilities(estimator: Any) -> Any:
    """The estimator itself, calibrated, or with its labels as probabilities."""
    if hasattr(estimator, "predict_proba"):
        return estimator
    if hasattr(estimator, "decision_function"):
        return calibrated(estimator)
    return LabelsOnly(estimator)

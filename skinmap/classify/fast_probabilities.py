"""Probabilities of rows that need no check: for one touch at a time, in the loop of a live skin."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.classify.intersection import IntersectionSVC, one_vs_rest

Probabilities = Callable[[FloatArray], FloatArray]


def quick_probabilities(estimator: Any) -> Probabilities:
    """A function that gives what `estimator.predict_proba` gives for sound rows (n, d).

    Checking a row costs scikit-learn more than a small classifier does. Estimators may offer
    `probabilities` themselves; calibrated intersection SVMs are evaluated from their arrays;
    for all others it is `predict_proba`.
    """
    if hasattr(estimator, "probabilities"):
        return estimator.probabilities
    inner = getattr(estimator, "calibrated_classifiers_", [])
    if len(inner) == 1 and isinstance(inner[0].estimator, IntersectionSVC):
        curves = inner[0].calibrators
        if all(hasattr(curve, "a_") and hasattr(curve, "b_") for curve in curves):
            slope, offset = np.array([(float(c.a_), float(c.b_)) for c in curves]).T
            return _Platt(inner[0].estimator, slope, offset)
    return estimator.predict_proba


def compile_decisions(estimator: Any) -> None:
    """Have the decision values of a calibrated intersection SVM computed by compiled code."""
    for inner in getattr(estimator, "calibrated_classifiers_", []):
        if isinstance(inner.estimator, IntersectionSVC):
            inner.estimator.function_.compile()


class _Platt:
    """Decision values through one sigmoid a class, as scikit-learn's calibration does it."""

    def __init__(self, svc: IntersectionSVC, slope: FloatArray, offset: FloatArray) -> None:
        self.svc, self.slope, self.offset = svc, slope, offset

    def __call__(self, rows: FloatArray) -> FloatArray:
        """(n, classes) probabilities of rows (n, d)."""
        values, classes = self.svc.decision_values(rows), len(self.svc.classes_)
        if classes > 2 and self.svc.one_vs_one_:
            values = one_vs_rest(values, classes)
        # tanh instead of exp: it cannot overflow.
        share = 0.5 - 0.5 * np.tanh(0.5 * (self.slope * values + self.offset))
        if classes == 2:
            return np.concatenate([1.0 - share, share], axis=1)
        total = share.sum(axis=1, keepdims=True)
        even = np.full_like(share, 1.0 / classes)
        return np.divide(share, total, out=even, where=total > 0)

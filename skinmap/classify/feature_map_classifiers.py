"""The classifiers `histogram-chi2` and `histogram-sqrt`: linear SVMs on mapped histograms."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinmap.classify.classifier import TouchClassifier, calibrated
from skinmap.classify.descriptors import Histograms

PENALTY = 10.0


def chi2_classifier() -> TouchClassifier:
    """Additive chi2 feature map (Vedaldi and Zisserman, PAMI 2012) and a linear SVM."""
    from sklearn.kernel_approximation import AdditiveChi2Sampler

    return _linear("histogram-chi2", AdditiveChi2Sampler())


def sqrt_classifier() -> TouchClassifier:
    """Square roots (the map of the Hellinger kernel) and a linear SVM."""
    from sklearn.preprocessing import FunctionTransformer

    return _linear("histogram-sqrt", FunctionTransformer(np.sqrt))


def _linear(name: str, feature_map: Any) -> TouchClassifier:
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import MaxAbsScaler
    from sklearn.svm import LinearSVC

    # Scaled so that the solver converges whatever the number of votes.
    machine = LinearSVC(C=PENALTY, random_state=0, max_iter=20_000, dual=False)
    return TouchClassifier(
        name, Histograms(), calibrated(make_pipeline(feature_map, MaxAbsScaler(), machine))
    )

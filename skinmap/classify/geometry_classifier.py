"""The classifier `contact-geometry`: lengths, areas and counts of the contacts on the skin."""

from __future__ import annotations

import numpy as np

from skinmap.classify.classifier import TouchClassifier, calibrated
from skinmap.classify.descriptors import ContactGeometry


def contact_geometry_classifier() -> TouchClassifier:
    """RBF SVM on the logarithms of lengths, areas and counts of the contacts."""
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer, StandardScaler
    from sklearn.svm import SVC

    # C and gamma by 4-fold cross-validation over parts on simulated touches; flat around here.
    machine = make_pipeline(
        FunctionTransformer(np.log1p), StandardScaler(), SVC(C=10.0, gamma=0.05)
    )
    return TouchClassifier("contact-geometry", ContactGeometry(), calibrated(machine))

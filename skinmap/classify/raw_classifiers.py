"""The classifiers `raw-rbf` and `raw-intersection`: baselines on bare taxel values of one part."""

from __future__ import annotations

from skinmap.classify.classifier import TouchClassifier, calibrated
from skinmap.classify.intersection import IntersectionSVC
from skinmap.classify.sample_descriptors import RawSamples

# Penalties over three decades; widths around "scale", 1 / (features x variance), scikit-learn's
# own choice, and three powers of ten round the inverse of the squared distances of pressures.
PENALTIES = (1.0, 10.0, 100.0)
WIDTHS = ("scale", 0.01, 0.1, 1.0)
GRID_FOLDS = 3


def raw_rbf_classifier() -> TouchClassifier:
    """RBF SVM, C and gamma by grid search: 3 penalties x 4 widths in 3 stratified folds."""
    from sklearn.model_selection import GridSearchCV
    from sklearn.svm import SVC

    grid = {"C": list(PENALTIES), "gamma": list(WIDTHS)}
    search = GridSearchCV(SVC(), grid, cv=GRID_FOLDS)
    return TouchClassifier("raw-rbf", RawSamples(), calibrated(search))


def raw_intersection_classifier() -> TouchClassifier:
    """Intersection-kernel SVM on the taxel values themselves."""
    return TouchClassifier("raw-intersection", RawSamples(), calibrated(IntersectionSVC()))

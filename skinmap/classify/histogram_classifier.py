"""The classifier `histogram`: the first paper's method, made to carry over between patches."""

from __future__ import annotations

from skinmap.classify.classifier import TouchClassifier, calibrated
from skinmap.classify.descriptors import Histograms
from skinmap.classify.intersection import IntersectionSVC


def histogram_classifier() -> TouchClassifier:
    """Histograms of periodic structures, rest dropped, and the intersection-kernel SVM."""
    return TouchClassifier("histogram", Histograms(), calibrated(IntersectionSVC()))

"""The classifier `paper`: the first paper's method to the letter."""

from __future__ import annotations

from skinmap.classify.classifier import TouchClassifier, calibrated
from skinmap.classify.descriptors import Histograms
from skinmap.classify.intersection import IntersectionSVC


def paper_classifier() -> TouchClassifier:
    """Rest counts, no rotation, a label a sample."""
    return TouchClassifier("paper", Histograms(literal=True), calibrated(IntersectionSVC()))

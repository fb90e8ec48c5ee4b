"""The classifier `bovw`: bags of visual words of contact images (the second paper)."""

from __future__ import annotations

from skinmap.classify.bag_of_words import BagOfVisualWords
from skinmap.classify.classifier import TouchClassifier, calibrated
from skinmap.classify.image_descriptor import PaperImages


def bovw_classifier() -> TouchClassifier:
    """Dense SURF, 130 codewords, linear SVM on the histograms."""
    from sklearn.pipeline import make_pipeline
    from sklearn.svm import LinearSVC

    # Calibrated on the histograms: the words are learnt without labels, and once is enough.
    # Roots of counts have squares that sum to the number of features, a hundred or so, hence C.
    machine = make_pipeline(BagOfVisualWords(), calibrated(LinearSVC(C=0.01, dual=False)))
    return TouchClassifier("bovw", PaperImages(), machine)

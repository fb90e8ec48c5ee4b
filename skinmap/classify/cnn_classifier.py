"""The classifier `cnn`: the small convolutional network on contact images (the second paper)."""

from __future__ import annotations

from skinmap.classify.classifier import TouchClassifier
from skinmap.classify.cnn import ContactImageCNN
from skinmap.classify.image_descriptor import PaperImages


def cnn_classifier() -> TouchClassifier:
    """8 kernels a layer on 33 x 50 pixels; training needs torch, naming touches does not."""
    return TouchClassifier("cnn", PaperImages(), ContactImageCNN("small"))

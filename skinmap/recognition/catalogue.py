"""The classifiers that there are, by name; each is imported when it is first looked up."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from skinmap.registry import Registry

if TYPE_CHECKING:
    from skinmap.recognition.classifier import TouchClassifier

DEFAULT = "contact-geometry"

# One line a classifier: a function without arguments that gives an untrained TouchClassifier.
BUILT_IN = {
    # the geometry of the contacts
    "contact-geometry": "skinmap.recognition.named_classifiers:contact_geometry_classifier",
    # the first paper
    "histogram": "skinmap.recognition.named_classifiers:histogram_classifier",
    "paper": "skinmap.recognition.named_classifiers:paper_classifier",
    # what it is compared with
    "raw-rbf": "skinmap.recognition.named_classifiers:raw_rbf_classifier",
    "raw-intersection": "skinmap.recognition.named_classifiers:raw_intersection_classifier",
    "histogram-chi2": "skinmap.recognition.named_classifiers:chi2_classifier",
    "histogram-sqrt": "skinmap.recognition.named_classifiers:sqrt_classifier",
    # the second paper
    "bovw": "skinmap.recognition.named_classifiers:bovw_classifier",
    "cnn": "skinmap.recognition.named_classifiers:cnn_classifier",
}
classifiers: Registry[Callable[[], TouchClassifier]] = Registry(
    "classifier",
    "skinmap.classifiers",
    built_in=BUILT_IN,
    adapt="skinmap.recognition.check:plugged_in",
)

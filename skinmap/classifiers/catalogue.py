"""The classifiers that there are, by name; each is imported when it is first looked up."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from skinmap.registry import Registry

if TYPE_CHECKING:
    from skinmap.classifiers.classifier import TouchClassifier

DEFAULT = "contact-geometry"

# One line a classifier: a function without arguments that gives an untrained TouchClassifier.
BUILT_IN = {
    # the geometry of the contacts
    "contact-geometry": "skinmap.classifiers.named_classifiers:contact_geometry_classifier",
    # the first paper
    "histogram": "skinmap.classifiers.named_classifiers:histogram_classifier",
    "paper": "skinmap.classifiers.named_classifiers:paper_classifier",
    # what it is compared with
    "raw-rbf": "skinmap.classifiers.named_classifiers:raw_rbf_classifier",
    "raw-intersection": "skinmap.classifiers.named_classifiers:raw_intersection_classifier",
    "histogram-chi2": "skinmap.classifiers.named_classifiers:chi2_classifier",
    "histogram-sqrt": "skinmap.classifiers.named_classifiers:sqrt_classifier",
    # the second paper
    "bovw": "skinmap.classifiers.named_classifiers:bovw_classifier",
    "cnn": "skinmap.classifiers.named_classifiers:cnn_classifier",
}
classifiers: Registry[Callable[[], TouchClassifier]] = Registry(
    "classifier",
    "skinmap.classifiers",
    built_in=BUILT_IN,
    adapt="skinmap.classifiers.check:plugged_in",
)

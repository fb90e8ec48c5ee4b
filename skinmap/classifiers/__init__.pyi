from skinmap.classifiers.catalogue import classifiers
from skinmap.classifiers.check import check_classifier
from skinmap.classifiers.classifier import Classifier
from skinmap.classifiers.descriptors import ContactGeometry, Histograms, Touch, recorded_touches
from skinmap.classifiers.evaluate import Score, likeliest, score
from skinmap.classifiers.model_file import load_classifier, save_classifier
from skinmap.classifiers.named_classifiers import default_model
from skinmap.classifiers.naming import classify, name_touches
from skinmap.classifiers.training import train

__all__ = [
    "Classifier",
    "ContactGeometry",
    "Histograms",
    "Score",
    "Touch",
    "check_classifier",
    "classifiers",
    "classify",
    "default_model",
    "likeliest",
    "load_classifier",
    "name_touches",
    "recorded_touches",
    "save_classifier",
    "score",
    "train",
]

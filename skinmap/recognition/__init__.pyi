from skinmap.recognition.catalogue import classifiers
from skinmap.recognition.check import check_classifier
from skinmap.recognition.classifier import Classifier
from skinmap.recognition.descriptors import ContactGeometry, Histograms, Touch, recorded_touches
from skinmap.recognition.evaluate import Score, likeliest, score
from skinmap.recognition.model_file import load_classifier, save_classifier
from skinmap.recognition.named_classifiers import default_model
from skinmap.recognition.naming import classify, name_touches
from skinmap.recognition.training import train

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

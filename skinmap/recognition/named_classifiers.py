"""The classifiers that have a name: what each is put together from.

One of them comes trained with Skinmap, and names touches on any robot before a user trains one. It
learnt from simulated touches on the iCub that stay and that go on in time; how it does on other
robots and in another physics is in docs/classifiers.md. `scripts/default_model.py` makes it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from skinmap.recognition.classifier import TouchClassifier, calibrated
from skinmap.recognition.descriptors import ContactGeometry, Histograms
from skinmap.recognition.histograms.intersection import IntersectionSVC
from skinmap.recognition.model_file import read_model

# Penalties over three decades; widths around "scale", 1 / (features x variance), scikit-learn's
# own choice, and three powers of ten round the inverse of the squared distances of pressures.
PENALTIES = (1.0, 10.0, 100.0)
WIDTHS = ("scale", 0.01, 0.1, 1.0)
GRID_FOLDS = 3
LINEAR_PENALTY = 10.0
DEFAULT_FILE = Path(__file__).with_name("default.skinmodel")


def default_model() -> TouchClassifier:
    """The model that comes with Skinmap, read anew.

    Returns
    -------
    Classifier
        Trained on simulated touches of four gestures that stay and eight in time.

    Raises
    ------
    MissingFileError, DataFormatError
        An installation that is not whole.

    Examples
    --------
    >>> import skinmap
    >>> len(skinmap.default_model().labels)
    12
    """
    return read_model(DEFAULT_FILE, lambda name: contact_geometry_classifier)


def contact_geometry_classifier() -> TouchClassifier:
    """`contact-geometry`: an RBF machine on logarithms of the contacts' lengths, areas, counts."""
    from skinmap.recognition.rbf_machine import RbfMachine

    # C and gamma by leaving patches out on simulated touches; flat for a factor of 3 around here.
    return TouchClassifier("contact-geometry", ContactGeometry(), RbfMachine())


def histogram_classifier() -> TouchClassifier:
    """`histogram`: the first paper's method, made to carry over between patches.

    Histograms of periodic structures, rest dropped, and the intersection-kernel SVM.
    """
    return TouchClassifier("histogram", Histograms(), calibrated(IntersectionSVC()))


def paper_classifier() -> TouchClassifier:
    """`paper`: the first paper's method to the letter; rest counts, no rotation."""
    return TouchClassifier("paper", Histograms(literal=True), calibrated(IntersectionSVC()))


def raw_rbf_classifier() -> TouchClassifier:
    """`raw-rbf`: RBF SVM on the bare values of one part, by 3 penalties x 4 widths in 3 folds."""
    from sklearn.model_selection import GridSearchCV
    from sklearn.svm import SVC

    from skinmap.recognition.descriptors import RawSamples

    grid = {"C": list(PENALTIES), "gamma": list(WIDTHS)}
    search = GridSearchCV(SVC(), grid, cv=GRID_FOLDS)
    return TouchClassifier("raw-rbf", RawSamples(), calibrated(search))


def raw_intersection_classifier() -> TouchClassifier:
    """`raw-intersection`: intersection-kernel SVM on the bare values of one part."""
    from skinmap.recognition.descriptors import RawSamples

    return TouchClassifier("raw-intersection", RawSamples(), calibrated(IntersectionSVC()))


def chi2_classifier() -> TouchClassifier:
    """`histogram-chi2`: additive chi2 map (Vedaldi and Zisserman, PAMI 2012) and a linear SVM."""
    from sklearn.kernel_approximation import AdditiveChi2Sampler

    return _linear("histogram-chi2", AdditiveChi2Sampler())


def sqrt_classifier() -> TouchClassifier:
    """`histogram-sqrt`: square roots (the map of the Hellinger kernel) and a linear SVM."""
    from sklearn.preprocessing import FunctionTransformer

    return _linear("histogram-sqrt", FunctionTransformer(np.sqrt))


def bovw_classifier() -> TouchClassifier:
    """`bovw`: the second paper's bags of visual words; dense SURF, 130 words, linear SVM."""
    from sklearn.pipeline import make_pipeline
    from sklearn.svm import LinearSVC

    from skinmap.recognition.descriptors import PaperImages
    from skinmap.recognition.images.bag_of_words import BagOfVisualWords

    # Calibrated on the histograms: the words are learnt without labels, and once is enough.
    # Roots of counts have squares that sum to the number of features, a hundred or so, hence C.
    machine = make_pipeline(BagOfVisualWords(), calibrated(LinearSVC(C=0.01, dual=False)))
    return TouchClassifier("bovw", PaperImages(), machine)


def cnn_classifier() -> TouchClassifier:
    """`cnn`: the second paper's network on contact images, 8 kernels a layer on 33 x 50 pixels.

    Training needs torch, naming touches does not.
    """
    from skinmap.recognition.descriptors import PaperImages
    from skinmap.recognition.images.cnn import ContactImageCNN

    return TouchClassifier("cnn", PaperImages(), ContactImageCNN("small"))


def _linear(name: str, feature_map: Any) -> TouchClassifier:
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import MaxAbsScaler
    from sklearn.svm import LinearSVC

    # Scaled so that the solver converges whatever the number of votes.
    machine = LinearSVC(C=LINEAR_PENALTY, random_state=0, max_iter=20_000, dual=False)
    return TouchClassifier(
        name, Histograms(), calibrated(make_pipeline(feature_map, MaxAbsScaler(), machine))
    )

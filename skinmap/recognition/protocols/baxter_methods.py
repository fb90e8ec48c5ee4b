"""The methods that the second paper's protocol compares, and how each is tuned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.recognition.images.bag_of_words import WORDS, count_words, learn_words
from skinmap.recognition.images.cnn import RECIPES, ContactImageCNN
from skinmap.recognition.images.visual_features import local_features
from skinmap.recognition.protocols.baxter_images import ImageSet
from skinmap.recognition.protocols.folds import Names, make_folds

FOLDS = 5
WORD_CHOICES = (30, 65, 130, 200, 300)
RATE_CHOICES = (0.01, 0.02, 0.03)
EPOCH_CHOICES = (30, 60)
PENALTY = 0.01  # of the linear SVM, on roots of counts; flat from here to ten times as much
PENALTIES, WIDTHS = (1.0, 10.0, 100.0, 1000.0), (1e-2, 1e-1, 1.0)  # of the raw baseline
Rows = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class Settings:
    """What tuning decides.

    Attributes
    ----------
    words : int
        Codewords of the bag of visual words.
    network : str
        "small" or "paper".
    learning_rate : float
    epochs : int
    penalty, width : float
        C and gamma of the raw baseline.
    """

    words: int = WORDS
    network: str = "small"
    learning_rate: float = RECIPES["small"].learning_rate
    epochs: int = RECIPES["small"].epochs
    penalty: float = 10.0
    width: float = 1e-2


def default_settings(network: str) -> Settings:
    """Settings as published for the paper's network, ours for the small one."""
    layout = RECIPES[network]
    return Settings(network=network, learning_rate=layout.learning_rate, epochs=layout.epochs)


class Bench:
    """Images with what is computed of them once: their local features.

    Parameters
    ----------
    data : ImageSet
    """

    def __init__(self, data: ImageSet) -> None:
        self.data = data
        self._features: tuple[FloatArray, IntArray] | None = None

    def content(self) -> tuple[ImageSet]:
        """What decides about everything here."""
        return (self.data,)

    @property
    def features(self) -> tuple[FloatArray, IntArray]:
        """Local features of all images, and the image of each."""
        if self._features is None:
            self._features = local_features(self.data.images)
        return self._features


def name_bovw(bench: Bench, train: Rows, test: Rows, settings: Settings, seed: int) -> Names:
    """Labels of the test images by a bag of visual words and a linear SVM."""
    from sklearn.svm import LinearSVC

    features, owner = bench.features
    rng = np.random.default_rng(seed)
    words = learn_words(features[train[owner]], settings.words, rng)
    histograms = count_words(words, features, owner, len(bench.data))
    machine = LinearSVC(C=PENALTY, dual=False)
    machine.fit(histograms[train], bench.data.labels[train])
    return np.asarray(machine.predict(histograms[test]))


def name_cnn(bench: Bench, train: Rows, test: Rows, settings: Settings, seed: int) -> Names:
    """Labels of the test images by a convolutional network."""
    machine = ContactImageCNN(
        settings.network,
        epochs=settings.epochs,
        learning_rate=settings.learning_rate,
        random_state=seed,
    )
    machine.fit(bench.data.table[train], bench.data.labels[train])
    return np.asarray(machine.predict(bench.data.table[test]))


def name_raw(bench: Bench, train: Rows, test: Rows, settings: Settings, seed: int) -> Names:
    """Labels of the test samples by an RBF SVM on the taxel values."""
    from sklearn.svm import SVC

    raw = bench.data.raw / 255.0
    machine = SVC(C=settings.penalty, gamma=settings.width)
    machine.fit(raw[train], bench.data.labels[train])
    return np.asarray(machine.predict(raw[test]))


Method = Callable[[Bench, Rows, Rows, Settings, int], Names]
METHODS: dict[str, Method] = {"bovw": name_bovw, "cnn": name_cnn, "raw_rbf": name_raw}


def mean_diagonal(labels: Names, named: Names) -> float:
    """Mean over the labels of the share named right."""
    return float(np.mean([(named[labels == kind] == kind).mean() for kind in np.unique(labels)]))


def tune(
    bench: Bench,
    method: str,
    settings: Settings,
    *,
    rows: Rows,
    rng: np.random.Generator,
    progress: Callable[[str], None] | None = None,
) -> tuple[Settings, list[dict[str, Any]]]:
    """The best settings of a method by 5-fold cross-validation on some rows, and all tried.

    Folds keep touches together. The network's learning rate is chosen first, at the fewest
    epochs, then the epochs.
    """
    tried: list[dict[str, Any]] = []
    inside = np.flatnonzero(rows)
    data = bench.data
    folds = make_folds("event", data.labels[inside], data.events[inside], folds=FOLDS, rng=rng)

    def best_of(choices: list[dict[str, Any]], settings: Settings) -> Settings:
        for choice in choices:
            scores = []
            for number, (train, test) in enumerate(folds):
                masks = _mask(inside[train], len(data)), _mask(inside[test], len(data))
                named = METHODS[method](bench, *masks, replace(settings, **choice), number)
                scores.append(mean_diagonal(data.labels[masks[1]], named))
            tried.append({**choice, "mean": float(np.mean(scores))})
            if progress is not None:
                progress(f"tune {method}")
        best = max(tried[-len(choices) :], key=lambda row: row["mean"])
        return replace(settings, **{key: best[key] for key in choices[0]})

    if method == "bovw":
        settings = best_of([{"words": k} for k in WORD_CHOICES], settings)
    elif method == "raw_rbf":
        grid = [{"penalty": c, "width": g} for c in PENALTIES for g in WIDTHS]
        settings = best_of(grid, settings)
    elif settings.network == "small":
        few = EPOCH_CHOICES[0]
        rates = [{"learning_rate": rate, "epochs": few} for rate in RATE_CHOICES]
        settings = best_of(rates, settings)
        settings = best_of([{"epochs": epochs} for epochs in EPOCH_CHOICES], settings)
    return settings, tried


def _mask(index: IntArray, n: int) -> Rows:
    mask = np.zeros(n, bool)
    mask[index] = True
    return mask

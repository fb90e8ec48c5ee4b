"""Convolutional networks on contact images: trained with torch, used without it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import validate_data

from skinmap.arrays import FloatArray
from skinmap.classify.bag_of_words import as_images
from skinmap.classify.convolution import Float32, Network
from skinmap.errors import InvalidArrayError, NotFittedError, UnknownNameError
from skinmap.touch.paper_image import SIZE

Schedule = Literal["constant", "step", "cosine"]


@dataclass(frozen=True, slots=True)
class Layout:
    """How large a network is, and how its authors train it.

    Attributes
    ----------
    channels : int
        Kernels of each of the three convolutions.
    shrink : int
        Pixels of the contact image that one of its pixels is the mean of, along each axis.
    epochs, batch, learning_rate, schedule, mirror, shift
        Defaults, see `ContactImageCNN`.
    """

    channels: int
    shrink: int
    epochs: int
    batch: int
    learning_rate: float
    schedule: Schedule
    mirror: bool
    shift: int


LAYOUTS = {
    # Albini, Denei and Cannata, IROS 2017.
    "paper": Layout(50, 1, 50, 128, 1e-3, "constant", False, 0),
    # Of 33 x 50 pixels; trained in half a minute, so that it can be tuned.
    "small": Layout(8, 2, 60, 32, 3e-2, "cosine", True, 4),
}
KERNEL = 5
MOMENTUM = 0.9


class ContactImageCNN(ClassifierMixin, BaseEstimator):
    """Classifier of flattened grey images (n, rows * columns) of 0 to 255.

    Parameters
    ----------
    network : {"small", "paper"}
    epochs, batch, learning_rate : optional
        Of stochastic gradient descent with momentum 0.9; those of the network by default.
    schedule : {"constant", "step", "cosine"}, optional
        Learning rate over the epochs: the same; a tenth after two thirds; or growing in the
        first five epochs, then half a cosine to 0.
    mirror : bool, optional
        Whether each image is mirrored along either axis, by chance, each time it is seen: a
        touch mirrored is the same touch, and few touches then train a network as many do.
    shift : int, optional
        How many of the network's own pixels an image is moved by at most, by chance, each time.
    image_shape : (rows, columns)
    random_state : int
    """

    def __init__(
        self,
        network: str = "small",
        *,
        epochs: int | None = None,
        batch: int | None = None,
        learning_rate: float | None = None,
        schedule: Schedule | None = None,
        mirror: bool | None = None,
        shift: int | None = None,
        image_shape: tuple[int, int] = SIZE,
        random_state: int = 0,
    ) -> None:
        self.network, self.epochs, self.batch = network, epochs, batch
        self.learning_rate, self.schedule, self.mirror = learning_rate, schedule, mirror
        self.shift, self.image_shape, self.random_state = shift, image_shape, random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> ContactImageCNN:
        """Train on images (n, rows * columns) and labels (n,).

        Raises
        ------
        UnknownNameError
            No such network.
        InvalidArrayError
            One label only, grey levels outside 0 to 255, or training that ran away.
        MissingLibraryError
            torch is not installed.
        """
        from skinmap.classify.cnn_training import Recipe, train

        if self.network not in LAYOUTS:
            raise UnknownNameError("network", str(self.network), LAYOUTS)
        layout = LAYOUTS[self.network]
        table, labels = validate_data(self, X, y)
        check_classification_targets(labels)
        self.classes_, number = np.unique(labels, return_inverse=True)
        if len(self.classes_) < 2:
            raise InvalidArrayError(f"training needs two labels, got {len(self.classes_)} class")
        recipe = Recipe(
            layout.channels,
            KERNEL,
            MOMENTUM,
            _or(self.epochs, layout.epochs),
            _or(self.batch, layout.batch),
            _or(self.learning_rate, layout.learning_rate),
            _or(self.schedule, layout.schedule),
            _or(self.mirror, layout.mirror),
            _or(self.shift, layout.shift),
        )
        images = self._images(table)
        names = tuple(map(str, self.classes_))
        self.take(train(images, number, names, recipe, seed=self.random_state))
        return self

    def take(self, network: Network) -> ContactImageCNN:
        """Use a network that was trained before."""
        if not hasattr(self, "classes_"):
            self.classes_ = np.array(network.labels)
            self.n_features_in_ = self.image_shape[0] * self.image_shape[1]
        # Plain arrays, so that a model file needs to know no type of ours.
        self.kernels_, self.biases_ = list(network.kernels), list(network.biases)
        self.weight_, self.bias_ = network.weight, network.bias
        return self

    @property
    def trained(self) -> Network:
        """The network.

        Raises
        ------
        NotFittedError
            Before training.
        """
        if not hasattr(self, "weight_"):
            raise NotFittedError("the network is not trained yet")
        shrink = LAYOUTS[self.network].shrink
        shape = (self.image_shape[0] // shrink, self.image_shape[1] // shrink)
        labels = tuple(map(str, self.classes_))
        kernels, biases = tuple(self.kernels_), tuple(self.biases_)
        return Network(shape, kernels, biases, self.weight_, self.bias_, labels)

    def predict_proba(self, X: ArrayLike) -> FloatArray:
        """(n, classes) softmax."""
        network = self.trained
        return network.probabilities(self._images(validate_data(self, X, reset=False)))

    def predict(self, X: ArrayLike) -> Any:
        """(n,) labels."""
        best = self.predict_proba(X).argmax(axis=1)
        return self.classes_[best]

    def _images(self, table: NDArray[Any]) -> Float32:
        grey = as_images(table, self.image_shape)
        return shrunken(grey, LAYOUTS[self.network].shrink)


def shrunken(images: NDArray[np.uint8], factor: int) -> Float32:
    """(n, rows // factor, columns // factor) means of blocks of pixels, 0 to 1."""
    n, rows, columns = images.shape
    rows, columns = rows // factor, columns // factor
    blocks = images[:, : rows * factor, : columns * factor].astype(np.float32)
    blocks = blocks.reshape(n, rows, factor, columns, factor)
    return np.asarray(blocks.mean(axis=(2, 4), dtype=np.float32) / np.float32(255.0))


def _or(given: Any, default: Any) -> Any:
    return default if given is None else given

"""Convolutional networks on contact images: trained with torch, used without it.

A small convolutional network, evaluated by numpy: what training leaves behind.

Layers: three times [convolution with k x k kernels at the same size, ReLU, maximum over 2 x 2
pixels], then one fully connected layer. Arrays have the axes of torch.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import validate_data

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError, NotFittedError, check_known, unknown_name
from skinmap.imports import import_optional
from skinmap.recognition.images.bag_of_words import as_images
from skinmap.touch.images.contact_image import SIZE

BATCH = 32  # images at a time: their unfolded windows stay in the cache
Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False, slots=True)
class Network:
    """Weights of a network.

    Attributes
    ----------
    shape : (rows, columns)
        Of the images that come in.
    kernels : tuple of (out, in, k, k) arrays of float32
        One a convolution.
    biases : tuple of (out,) arrays of float32
    weight : (classes, features) array of float32
        Of the fully connected layer; features in the order channel, row, column.
    bias : (classes,) array of float32
    labels : tuple of str
    """

    shape: tuple[int, int]
    kernels: tuple[Float32, ...]
    biases: tuple[Float32, ...]
    weight: Float32
    bias: Float32
    labels: tuple[str, ...]

    def __post_init__(self) -> None:
        shapes = [kernel.shape for kernel in self.kernels]
        into, features = 1, self.shape[0] * self.shape[1]
        rows, columns = self.shape
        for kernel, bias in zip(self.kernels, self.biases, strict=True):
            square = kernel.ndim == 4 and kernel.shape[2] == kernel.shape[3]
            if not square or kernel.shape[1] != into or bias.shape != kernel.shape[:1]:
                raise InvalidArrayError(f"kernels of shapes {shapes} do not follow each other")
            into, rows, columns = kernel.shape[0], rows // 2, columns // 2
            features = into * rows * columns
        wanted = (len(self.labels), features)
        if self.weight.shape != wanted or self.bias.shape != wanted[:1] or features == 0:
            raise InvalidArrayError(
                f"the last layer must have shape {wanted}, got {self.weight.shape}"
            )
        arrays = (*self.kernels, *self.biases, self.weight, self.bias)
        if not all(array.dtype == np.float32 and np.isfinite(array).all() for array in arrays):
            raise InvalidArrayError("the weights of a network must be finite float32")

    def logits(self, images: Float32) -> Float32:
        """(n, classes) for images (n, rows, columns)."""
        blocks = [self._logits(images[i : i + BATCH]) for i in range(0, len(images), BATCH)]
        return np.concatenate([np.zeros((0, len(self.labels)), np.float32), *blocks])

    def probabilities(self, images: Float32) -> FloatArray:
        """(n, classes) softmax of the logits."""
        logits = self.logits(images).astype(np.float64)
        share = np.exp(logits - logits.max(axis=1, keepdims=True))
        return np.asarray(share / share.sum(axis=1, keepdims=True))

    def _logits(self, images: Float32) -> Float32:
        maps = images[:, None]
        for kernel, bias in zip(self.kernels, self.biases, strict=True):
            maps = halve(np.maximum(convolve(maps, kernel, bias), 0.0))
        return np.asarray(maps.reshape(len(maps), -1) @ self.weight.T + self.bias)


def convolve(maps: Float32, kernel: Float32, bias: Float32) -> Float32:
    """(n, out, rows, columns) cross-correlation of maps (n, in, rows, columns), zeros around.

    One matrix product: the k x k x in numbers under the kernel are the rows.
    """
    n, into, rows, columns = maps.shape
    k = kernel.shape[2]
    before = (k - 1) // 2
    around = ((0, 0), (0, 0), (before, k - 1 - before), (before, k - 1 - before))
    windows = sliding_window_view(np.pad(maps, around), (k, k), axis=(2, 3))
    unfolded = windows.transpose(0, 1, 4, 5, 2, 3).reshape(n, into * k * k, rows * columns)
    found = kernel.reshape(len(kernel), -1) @ unfolded
    return (found + bias[:, None]).reshape(n, len(kernel), rows, columns)


def halve(maps: Float32) -> Float32:
    """(n, c, rows // 2, columns // 2) maxima over 2 x 2 pixels; an odd last row is left out."""
    rows, columns = maps.shape[2] // 2 * 2, maps.shape[3] // 2 * 2
    even = maps[:, :, :rows, :columns]
    across = np.maximum(even[:, :, :, ::2], even[:, :, :, 1::2])
    return np.maximum(across[:, :, ::2], across[:, :, 1::2])


Schedule = Literal["constant", "step", "cosine"]
NEED = "training a network needs torch: pip install 'skinmap[torch]'"
KERNEL = 5
MOMENTUM = 0.9
WARM_UP = 5  # epochs of the schedule "cosine" in which the rate grows: full steps kill a fresh net
ATTEMPTS = 3  # trainings with another start where one stays at chance
STUCK = 0.95  # of the loss of chance: a net that does not get below has learnt nothing
TELLING = 10  # epochs: after fewer nothing can be said
STEP_AT, STEP_TO = 2 / 3, 0.1  # of the schedule "step": when, and to which share
# Of the first layer's activations, worked on at once: more leave the processor's cache.
CACHED = 12 * 2**20  # bytes
# Kernels from which convolutions are computed in bfloat16, on processors that multiply it at once:
# a step of the paper's network then takes a third of the time with matrix units (AMX), half of it
# with AVX-512 alone. Weights, sums and the loss stay float32.
WIDE = 32
BFLOAT16 = ("_is_amx_tile_supported", "_is_avx512_bf16_supported")


@dataclass(frozen=True, slots=True)
class Recipe:
    """How large a network is, and how its authors train it.

    Attributes
    ----------
    channels : int
        Kernels of each of the three convolutions.
    shrink : int
        Pixels of the contact image that one of its pixels is the mean of, along each axis.
    epochs, batch, learning_rate, schedule, mirror, shift
        Defaults, see `ContactImageCNN`.
    scaled : bool
        Whether pixels are divided by their standard deviation over the training images. Contact
        images are dark: of 0 to 1, it is 0.13, and steps are then 60 times as small for the same
        rate. The first kernels take the factor in, so that a trained network reads 0 to 1.
    """

    channels: int
    shrink: int
    epochs: int
    batch: int
    learning_rate: float
    schedule: Schedule
    mirror: bool
    shift: int
    scaled: bool = False

    def __post_init__(self) -> None:
        if min(self.epochs, self.batch, self.shift + 1) < 1 or not 0 < self.learning_rate < np.inf:
            raise InvalidArrayError(
                f"epochs and batch must be at least 1, shift at least 0 and the learning rate "
                f"above 0, got {self.epochs}, {self.batch}, {self.shift}, {self.learning_rate}"
            )

    def rate(self, epoch: int) -> float:
        """Learning rate of an epoch, 0 first."""
        done = epoch / self.epochs
        share = {
            "constant": 1.0,
            "step": STEP_TO if done >= STEP_AT else 1.0,
            "cosine": 0.5 * (1.0 + np.cos(np.pi * done)) * min(1.0, (epoch + 1) / WARM_UP),
        }
        if self.schedule not in share:
            raise InvalidArrayError(unknown_name("schedule", str(self.schedule), share))
        return self.learning_rate * float(share[self.schedule])


RECIPES = {
    # Albini, Denei and Cannata, IROS 2017. Ours: the rate (1e-3 there, of grey levels that it does
    # not name), and mirrored and shifted images, without which 1,000 of them are learnt by heart.
    "paper": Recipe(50, 1, 50, 128, 5e-3, "constant", True, 8, scaled=True),
    # Of 33 x 50 pixels; trained in half a minute, so that it can be tuned.
    "small": Recipe(8, 2, 60, 32, 3e-2, "cosine", True, 4),
}
# What a user may choose otherwise.
CHOSEN = ("epochs", "batch", "learning_rate", "schedule", "mirror", "shift")


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
        check_known("network", [str(self.network)], RECIPES)
        table, labels = validate_data(self, X, y)
        check_classification_targets(labels)
        self.classes_, number = np.unique(labels, return_inverse=True)
        if len(self.classes_) < 2:
            raise InvalidArrayError(f"training needs two labels, got {len(self.classes_)} class")
        given = {name: getattr(self, name) for name in CHOSEN}
        given = {name: value for name, value in given.items() if value is not None}
        recipe = replace(RECIPES[self.network], **given)
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
        shrink = RECIPES[self.network].shrink
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
        return shrunken(grey, RECIPES[self.network].shrink)


def shrunken(images: NDArray[np.uint8], factor: int) -> Float32:
    """(n, rows // factor, columns // factor) means of blocks of pixels, 0 to 1."""
    n, rows, columns = images.shape
    rows, columns = rows // factor, columns // factor
    blocks = images[:, : rows * factor, : columns * factor].astype(np.float32)
    blocks = blocks.reshape(n, rows, factor, columns, factor)
    return np.asarray(blocks.mean(axis=(2, 4), dtype=np.float32) / np.float32(255.0))


def train(
    images: Float32, labels: IntArray, names: tuple[str, ...], recipe: Recipe, *, seed: int
) -> Network:
    """Train on images (n, rows, columns) of 0 to 1 and labels (n,) of 0 to len(names) - 1.

    Raises
    ------
    InvalidArrayError
        The loss ran away: the learning rate is too large.
    """
    torch = import_optional("torch", NEED)
    with _one_thread(torch), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        share = np.unique(labels, return_counts=True)[1] / len(labels)
        chance = float(-(share * np.log(share)).sum())  # loss of always answering with the shares
        for _ in range(ATTEMPTS):
            net = _build(torch, images.shape[1:], len(names), recipe)
            *_, loss = _descend(torch, net, images, labels, recipe)
            if not np.isfinite(loss):
                raise InvalidArrayError(
                    f"training ran away at a learning rate of {recipe.learning_rate:g}: lower it"
                )
            # A net whose rectifiers all died early gives every image the same answer.
            if recipe.epochs < TELLING or loss < STUCK * chance:
                break
        return _network(net, images, names, recipe)


def train_along(
    images: Float32,
    labels: IntArray,
    names: tuple[str, ...],
    recipe: Recipe,
    *,
    epochs: Sequence[int],
    seed: int,
) -> list[Network | None]:
    """Networks that one training passes after so many epochs, increasing; None once it ran away.

    At a constant rate these are the trainings of so many epochs each. None is started again.
    """
    torch = import_optional("torch", NEED)
    found: list[Network | None] = []
    with _one_thread(torch), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        net = _build(torch, images.shape[1:], len(names), recipe)
        for epoch, loss in enumerate(_descend(torch, net, images, labels, recipe), 1):
            if not np.isfinite(loss):
                break
            if epoch in epochs:
                found.append(_network(net, images, names, recipe))
    return found + [None] * (len(epochs) - len(found))


def _descend(
    torch: Any, net: Any, images: Float32, labels: IntArray, recipe: Recipe
) -> Iterator[float]:
    """Fit a net in place; the mean loss after each epoch."""
    descent = torch.optim.SGD(net.parameters(), lr=recipe.learning_rate, momentum=MOMENTUM)
    scaled = images[:, None] / _spread(images, recipe)
    seen, wanted = torch.from_numpy(scaled), torch.from_numpy(labels.copy())
    seen = seen.to(memory_format=torch.channels_last)
    at_once = max(CACHED // (4 * recipe.channels * images[0].size), 1)
    # Older torch cannot tell.
    mixed = recipe.channels >= WIDE and any(getattr(torch.cpu, unit, bool)() for unit in BFLOAT16)
    for epoch in range(recipe.epochs):
        for group in descent.param_groups:
            group["lr"] = recipe.rate(epoch)
        losses = []
        for batch in torch.randperm(len(seen)).split(recipe.batch):
            shown = _varied(torch, seen[batch], recipe)
            descent.zero_grad()
            whole = 0.0
            # The gradient of a batch is the sum of those of its parts, which stay in the cache.
            for some, label in zip(shown.split(at_once), wanted[batch].split(at_once), strict=True):
                with torch.autocast("cpu", torch.bfloat16, enabled=mixed):
                    logits = net(some)
                loss = torch.nn.functional.cross_entropy(logits.float(), label, reduction="sum")
                loss = loss / len(batch)
                loss.backward()
                whole += float(loss.detach())
            descent.step()
            losses.append(whole)
        yield float(np.mean(losses)) if np.isfinite(losses).all() else np.nan


def _spread(images: Float32, recipe: Recipe) -> np.float32:
    return np.float32((recipe.scaled and images.std()) or 1.0)


def _build(torch: Any, shape: tuple[int, ...], classes: int, recipe: Recipe) -> Any:
    nn = torch.nn
    layers: list[Any] = []
    into, (rows, columns) = 1, shape
    for _ in range(3):
        layers += [nn.Conv2d(into, recipe.channels, KERNEL, padding="same")]
        # Rectified after pooling, which has the same outcome for a quarter of the work.
        layers += [nn.MaxPool2d(2), nn.ReLU()]
        into, rows, columns = recipe.channels, rows // 2, columns // 2
    layers += [nn.Flatten(), nn.Linear(into * rows * columns, classes)]
    for layer in layers:
        if hasattr(layer, "weight"):
            # He et al., "Delving Deep into Rectifiers", ICCV 2015.
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)
    return nn.Sequential(*layers).to(memory_format=torch.channels_last)


def _varied(torch: Any, images: Any, recipe: Recipe) -> Any:
    """Each image (n, 1, rows, columns) mirrored and shifted by chance, as the recipe allows."""
    n, _, rows, columns = images.shape
    for axis in (2, 3) if recipe.mirror else ():
        turned = torch.rand(n) < 0.5
        images = torch.where(turned[:, None, None, None], images.flip(axis), images)
    if recipe.shift == 0:
        return images
    wide = torch.nn.functional.pad(images, [recipe.shift] * 4)
    start = torch.randint(0, 2 * recipe.shift + 1, (2, n, 1))
    row, column = start[0] + torch.arange(rows), start[1] + torch.arange(columns)
    return wide[torch.arange(n)[:, None, None], 0, row[:, :, None], column[:, None, :]][:, None]


def _network(net: Any, images: Float32, names: tuple[str, ...], recipe: Recipe) -> Network:
    arrays = [parameter.detach().numpy().copy() for parameter in net.parameters()]
    arrays[0] /= _spread(images, recipe)
    shape = (images.shape[1], images.shape[2])
    *convolutions, weight, bias = arrays
    return Network(shape, tuple(convolutions[::2]), tuple(convolutions[1::2]), weight, bias, names)


@contextmanager
def _one_thread(torch: Any) -> Iterator[None]:
    """More threads cost more than they give on images as small as these."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)

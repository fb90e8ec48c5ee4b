"""A small convolutional network, evaluated by numpy: what training leaves behind.

Layers: three times [convolution with k x k kernels at the same size, ReLU, maximum over 2 x 2
pixels], then one fully connected layer. Arrays have the axes of torch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError

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

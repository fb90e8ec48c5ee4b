from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import correlate

from skinmap.errors import InvalidArrayError
from skinmap.recognition.images.cnn import ContactImageCNN, Network, convolve, halve, shrunken
from tests.classify.golden_network import golden_network

GOLDEN = Path(__file__).parents[1] / "golden"
# Sums of up to 5 x 5 x 8 = 200 products in single precision, three layers deep, in another order.
ROUNDING = 2e-5


@pytest.fixture(scope="module")
def network() -> Network:
    return golden_network()


@pytest.mark.parametrize("size", [1, 4, 5])
def test_convolve_is_cross_correlation(rng, size):
    maps = rng.standard_normal((2, 3, 9, 7)).astype(np.float32)
    kernel = rng.standard_normal((4, 3, size, size)).astype(np.float32)
    bias = rng.standard_normal(4).astype(np.float32)
    found = convolve(maps, kernel, bias)
    assert found.dtype == np.float32
    before = (size - 1) // 2  # of an even kernel, torch sets the smaller half before
    padded = np.pad(
        maps, ((0, 0), (0, 0), (before, size - 1 - before), (before, size - 1 - before))
    )
    for image, got in zip(padded, found, strict=True):
        for k in range(4):
            expected = correlate(image, kernel[k], mode="valid")[0] + bias[k]
            np.testing.assert_allclose(got[k], expected, atol=1e-5)


def test_halve_takes_maxima_and_leaves_an_odd_row_out():
    maps = np.arange(35, dtype=np.float32).reshape(1, 1, 5, 7)
    np.testing.assert_array_equal(halve(maps)[0, 0], [[8, 10, 12], [22, 24, 26]])


def test_shrunken_takes_means():
    images = np.array([[[0, 255, 7], [255, 0, 9], [1, 2, 3]]], np.uint8)
    np.testing.assert_array_equal(shrunken(images, 2), [[[0.5]]])
    np.testing.assert_array_equal(shrunken(images, 1), images / np.float32(255))


def test_logits_are_those_that_torch_gave(network):
    with np.load(GOLDEN / "contact_cnn_logits.npz", allow_pickle=False) as golden:
        images, expected = shrunken(golden["images"], 2), golden["logits"]
    assert len(images) >= 12
    np.testing.assert_allclose(
        network.logits(images), expected, atol=ROUNDING * np.abs(expected).max()
    )


@pytest.mark.parametrize("channels", [8, 50])
def test_logits_equal_torchs(rng, channels):
    torch = pytest.importorskip("torch", reason="the extra `torch` is not installed")
    nn = torch.nn
    layers, into = [], 1
    for _ in range(3):
        layers += [nn.Conv2d(into, channels, 5, padding="same"), nn.ReLU(), nn.MaxPool2d(2)]
        into = channels
    net = nn.Sequential(*layers, nn.Flatten(), nn.Linear(channels * 4 * 6, 2))
    arrays = [p.detach().numpy().copy() for p in net.parameters()]
    ours = Network(
        (33, 50), tuple(arrays[0:6:2]), tuple(arrays[1:6:2]), arrays[6], arrays[7], ("a", "b")
    )
    images = rng.random((40, 33, 50)).astype(np.float32)
    with torch.no_grad():
        theirs = net(torch.from_numpy(images[:, None])).numpy()
    np.testing.assert_allclose(ours.logits(images), theirs, atol=ROUNDING)
    share = torch.softmax(torch.from_numpy(theirs), 1).numpy()
    np.testing.assert_allclose(ours.probabilities(images), share, atol=ROUNDING)


def test_probabilities_of_huge_logits_are_finite(network):
    loud = replace(network, weight=network.weight * np.float32(1e6))
    share = loud.probabilities(np.ones((3, 33, 50), np.float32))
    np.testing.assert_allclose(share.sum(axis=1), 1.0, atol=1e-12)
    assert loud.probabilities(np.ones((0, 33, 50), np.float32)).shape == (0, 2)


def test_networks_that_do_not_fit_together_are_refused(network):
    kernels = network.kernels
    with pytest.raises(InvalidArrayError, match="do not follow each other"):
        replace(network, kernels=(kernels[1], kernels[0], kernels[2]))
    with pytest.raises(InvalidArrayError, match="last layer must have shape"):
        replace(network, shape=(66, 100))
    with pytest.raises(InvalidArrayError, match="finite float32"):
        replace(network, bias=np.array([np.nan, 0.0], np.float32))


def test_the_saved_network_is_small(network):
    assert (GOLDEN / "contact_cnn.npz").stat().st_size < 50_000
    assert ContactImageCNN("small").take(network).trained.shape == (33, 50)

"""Make the saved network of the tests: `python -m tests.classify.make_golden_network`, by torch.

Trains the small network on simulated touches of the Baxter-like forearm, and writes
tests/golden/contact_cnn.npz beside the logits that torch gives for some images
(contact_cnn_logits.npz), which inference without torch is checked against.
"""

from __future__ import annotations

import json

import numpy as np
import torch

from benchmarks import ROOT
from skinmap.io.robots.manifest import load_robot
from skinmap.recognition.images.cnn import ContactImageCNN, Network, shrunken
from skinmap.recognition.protocols.baxter import PART, ROBOT, simulate_images
from skinmap.touch.prepared_skin import PreparedSkin

GOLDEN = ROOT / "tests" / "golden"
IMAGES, SEED = 3600, 2024


def torch_logits(network: Network, images: np.ndarray) -> np.ndarray:
    """(n, classes) by torch, for images (n, rows, columns)."""
    maps = torch.from_numpy(images[:, None].copy())
    for kernel, bias in zip(network.kernels, network.biases, strict=True):
        weights = torch.from_numpy(kernel.copy()), torch.from_numpy(bias.copy())
        maps = torch.nn.functional.conv2d(maps, *weights, padding="same").relu()
        maps = torch.nn.functional.max_pool2d(maps, 2)
    last = torch.from_numpy(network.weight.copy()), torch.from_numpy(network.bias.copy())
    return torch.nn.functional.linear(maps.flatten(1), *last).numpy()


def main() -> None:
    """Train and write."""
    skin = PreparedSkin(load_robot(ROBOT).skin(PART))
    data = simulate_images(skin, images=IMAGES, rng=np.random.default_rng(SEED))
    machine = ContactImageCNN("small", random_state=SEED).fit(data.table, data.labels)
    network = machine.trained
    head = json.dumps({"shape": network.shape, "labels": network.labels})
    layers = {f"kernel_{k}": kernel for k, kernel in enumerate(network.kernels)}
    layers |= {f"bias_{k}": bias for k, bias in enumerate(network.biases)}
    layers |= {"weight": network.weight, "bias": network.bias}
    np.savez_compressed(
        GOLDEN / "contact_cnn.npz", head=np.frombuffer(head.encode(), np.uint8), **layers
    )
    few = data.images[:: len(data) // 12]
    logits = torch_logits(network, shrunken(few, 2))
    np.savez_compressed(GOLDEN / "contact_cnn_logits.npz", images=few, logits=logits)


if __name__ == "__main__":
    main()

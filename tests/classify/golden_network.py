"""The saved network of the tests, which `python -m tests.classify.make_golden_network` made."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from skinmap.recognition.images.cnn import Network

NETWORK = Path(__file__).parents[1] / "golden" / "contact_cnn.npz"


def golden_network() -> Network:
    with np.load(NETWORK, allow_pickle=False) as arrays:
        head = json.loads(arrays["head"].tobytes())
        layers = range(sum(name.startswith("kernel_") for name in arrays.files))
        return Network(
            tuple(head["shape"]),
            tuple(arrays[f"kernel_{number}"] for number in layers),
            tuple(arrays[f"bias_{number}"] for number in layers),
            arrays["weight"],
            arrays["bias"],
            tuple(head["labels"]),
        )

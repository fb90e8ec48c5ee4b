"""Messages of the server as a page reads them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray


def unpack(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and flat arrays of a message."""
    length = int.from_bytes(message[:4], "little")
    header = json.loads(message[4 : 4 + length])
    start = 4 + length + -(4 + length) % 8
    arrays = {
        name: np.frombuffer(message, "<" + kind, count, start + offset)
        for name, (kind, offset, count) in header.pop("arrays").items()
    }
    return header, arrays

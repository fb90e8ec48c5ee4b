"""How a skin is recognised again: by the name of its part and where its taxels are."""

from __future__ import annotations

import hashlib

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.skin.skin import Skin

SAME = 1e-6  # [m]; tables are written to a micrometre


def layout_fingerprint(part: str, positions: FloatArray) -> str:
    """SHA-256 of a part's name and its taxels (n, 3) [m] in micrometres."""
    whole = np.round(positions / SAME).astype("<i8")
    return hashlib.sha256(part.encode() + b"\0" + whole.tobytes()).hexdigest()


def fingerprint(skin: Skin) -> str:
    """SHA-256 of a part's name and layout."""
    return layout_fingerprint(skin.part, skin.positions)

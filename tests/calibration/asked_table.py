"""Tables of touched places, for tests of the check-up."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np


def write_places(paths: Sequence[np.ndarray], file: Path) -> None:
    """Write the places of touches (p, 3) [m], counted from 1."""
    lines = ["touch,x,y,z"]
    for number, path in enumerate(paths, start=1):
        lines += [f"{number}," + ",".join(map(repr, point)) for point in path.tolist()]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")

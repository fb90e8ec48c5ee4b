"""Description of a Skinmap recording in MCAP: skin, widths, rate."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.errors import DataFormatError
from skinmap.io.recordings.mcap_recording import FORMAT
from skinmap.io.recordings.mcap_scan import Scan

MAX_CHANNELS = 1_000_000  # a skin of more is damage


def read_head(found: Scan) -> dict[str, str]:
    """What the file says of itself, from wherever it survived."""
    tables = [*found.metadata.values(), *(channel.metadata for channel in found.copies)]
    copies = [table for table in tables if table.get("format") == FORMAT]
    if not copies:
        why = f" ({found.damage[0]})" if found.damage else ""
        raise DataFormatError(f"not a Skinmap recording: it names no skin{why}", found.path)
    return _agreed(copies, found)


def _agreed(copies: list[dict[str, str]], found: Scan) -> dict[str, str]:
    """What most copies say: these records carry no checksum, but they repeat each other."""
    agreed = {}
    for key in sorted({key for copy in copies for key in copy}):
        said = Counter(copy.get(key) for copy in copies)
        ((value, _),) = said.most_common(1)
        if len(said) > 1:
            found.damage.append(f"its copies of {key!r:.40} differ")
        if value is not None:
            agreed[key] = value
    return agreed


def head_value(head: dict[str, str], key: str, kind: type[Any], path: Path) -> Any:
    """A value that stands in the head as JSON; DataFormatError if it is no such."""
    try:
        value = json.loads(head.get(key, "null"))
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, kind):
        raise DataFormatError(f"its {key} are damaged", path)
    return value


def head_words(head: dict[str, str], key: str, path: Path) -> dict[str, str]:
    """Words by name that stand in the head as JSON."""
    return {str(name): str(word) for name, word in head_value(head, key, dict, path).items()}


def head_number(head: dict[str, str], key: str, path: Path) -> float:
    """A number of the head, not negative; 0 where it is not there."""
    try:
        number = float(head.get(key, "0"))
    except ValueError:
        number = float("nan")
    if not 0 <= number < np.inf:
        raise DataFormatError(f"its {key} is damaged", path)
    return number


def check_widths(widths: Any, parts: tuple[str, ...], path: Path) -> tuple[int, ...]:
    """Columns of each part, if that can be."""
    whole = isinstance(widths, list) and all(type(width) is int for width in widths)
    if not whole or len(widths) != len(parts) or not parts or len(set(parts)) != len(parts):
        raise DataFormatError(f"{len(parts)} parts with widths {widths!r:.60}", path)
    if min(widths) < 1 or sum(widths) > MAX_CHANNELS:
        raise DataFormatError(f"a skin of {sum(widths)} channels", path)
    return tuple(widths)

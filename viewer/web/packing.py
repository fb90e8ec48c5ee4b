"""One message of a header and arrays: what the server sends and `page/packing.js` reads.

    [4 bytes] length of the header, little-endian
    [n bytes] header, JSON
    [padding] to a multiple of 8
    [arrays]  each at a multiple of 8, little-endian

The header's `arrays` names each array with its type, first byte (counted behind the padding) and
number of elements, so that the page reads them in place.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

TYPES = ("u1", "i1", "u2", "u4", "i4", "f4")  # what a page has typed arrays for


def pack(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """A message of a header (JSON) and arrays.

    Raises
    ------
    TypeError
        An array of a type that a page cannot read in place.
    """
    table, blobs, offset = {}, [], 0
    for name, array in arrays.items():
        kind = array.dtype.kind + str(array.dtype.itemsize)
        if kind not in TYPES:
            raise TypeError(f"array {name!r} of type {array.dtype}, expected one of {TYPES}")
        blob = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()
        table[name] = [kind, offset, array.size]
        blobs.append(blob + bytes(-len(blob) % 8))
        offset += len(blobs[-1])
    text = json.dumps({**header, "arrays": table}, separators=(",", ":"), allow_nan=False).encode()
    head = len(text).to_bytes(4, "little") + text
    return b"".join([head, bytes(-len(head) % 8), *blobs])


def finite(value: float | None) -> float | None:
    """A number for JSON: None where it is not known."""
    return None if value is None or not np.isfinite(value) else float(value)

"""Results as text and back, to the same bits, without anything that a file could run.

Python's JSON writes each float so that it is read as the same one; arrays, tuples, bytes and keys
that are no texts are marked by a tag.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from typing import Any

import numpy as np

from skinmap.errors import InvalidArrayError

KINDS = "biufcSUMm"  # of arrays: no objects, which would be pickled
MOST = 1 << 31  # bytes that a packed array may claim to be
LEVEL = 1  # samples of touches are mostly zeros


def pack(value: Any) -> str:
    """A result as one line of text.

    Raises
    ------
    InvalidArrayError
        Something other than numbers, texts, bytes, arrays, lists, tuples and dicts of them.
    """
    return json.dumps(_plain(value), separators=(",", ":"))


def unpack(text: str | bytes) -> Any:
    """What `pack` made a line of.

    Raises
    ------
    ValueError, LookupError, TypeError, RecursionError, zlib.error, MemoryError
        A line that it did not make.
    """
    return _whole(json.loads(text))


def _plain(value: Any) -> Any:
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return _plain_array(value)
    if type(value) is list:
        return [_plain(item) for item in value]
    if type(value) is tuple:
        return {"tuple": [_plain(item) for item in value]}
    if type(value) is dict:
        return {"dict": [[_plain(key), _plain(item)] for key, item in value.items()]}
    if type(value) is bytes:
        return {"bytes": _text(value)}
    raise InvalidArrayError(f"a result holds a {type(value).__qualname__}, which cannot be kept")


def _plain_array(value: np.ndarray[Any, Any] | np.generic) -> dict[str, Any]:
    array = np.asarray(value)
    if array.dtype.kind not in KINDS or array.dtype.names:
        raise InvalidArrayError(f"a result holds an array of {array.dtype}, which cannot be kept")
    tag = "array" if isinstance(value, np.ndarray) else "number"
    data = np.ascontiguousarray(array).tobytes()
    return {tag: [array.dtype.str, list(array.shape), _text(data)]}


def _whole(value: Any) -> Any:
    if isinstance(value, list):
        return [_whole(item) for item in value]
    if not isinstance(value, dict):
        return value
    ((tag, inner),) = value.items()
    if tag == "tuple":
        return tuple(_whole(item) for item in inner)
    if tag == "dict":
        return {_whole(key): _whole(item) for key, item in inner}
    if tag == "bytes":
        return _bytes(inner)
    if tag in ("array", "number"):
        array = _whole_array(*inner)
        return array if tag == "array" else array[()]
    raise ValueError(f"no tag {tag!r}")


def _whole_array(kind: str, shape: list[int], text: str) -> np.ndarray[Any, Any]:
    dtype = np.dtype(kind)
    if dtype.kind not in KINDS or math.prod(shape) * dtype.itemsize > MOST:
        raise ValueError(f"an array of {kind} {shape} was not packed here")
    return np.frombuffer(bytearray(_bytes(text)), dtype).reshape(shape)


def _text(data: bytes) -> str:
    return base64.b85encode(zlib.compress(data, LEVEL)).decode()


def _bytes(text: str) -> bytes:
    opened = zlib.decompressobj()
    data = opened.decompress(base64.b85decode(text), MOST)
    if opened.unconsumed_tail or not opened.eof:
        raise ValueError("more bytes than were packed here, or fewer")
    return data

"""A key for what a task holds: the same content has the same key in every process."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from skinmap.errors import InvalidArrayError

SIZE = 16  # bytes: two of a million million tasks share one with a chance of 1e-15
Digest = bytes
# By id, with the object itself: as long as it is held here no other one can have its id.
Known = dict[int, tuple[Any, Digest]]


def content_key(work: Callable[..., Any], task: Any) -> str:
    """Hexadecimal key of a function and what it is called with.

    Numbers, texts, arrays, paths, sequences, mappings, sets, dataclasses and functions count by
    what they are; any other object says what it consists of by a method `content()`.

    Raises
    ------
    InvalidArrayError
        An object that does not say what it consists of.
    """
    # Objects that a task holds many times (the skin of each touch) are read once.
    return _digest((work, task), {}).hex()


def _digest(value: Any, known: Known) -> Digest:
    if isinstance(value, str | bytes | int | float | None):
        return _sum(*_parts(value, known))
    if id(value) not in known:
        known[id(value)] = value, _sum(*_parts(value, known))
    return known[id(value)][1]


def _parts(value: Any, known: Known) -> list[bytes]:
    """What a value consists of; the first part tells its kind."""
    if value is None or isinstance(value, bool | int | float | complex | str):
        return [type(value).__name__.encode(), repr(value).encode()]
    if isinstance(value, bytes | bytearray):
        return [b"bytes", bytes(value)]
    if isinstance(value, PurePath):
        return [b"path", str(value).encode()]
    if isinstance(value, np.ndarray | np.generic):
        return _array_parts(np.asarray(value), known)
    if isinstance(value, Mapping):
        pairs = [(_digest(key, known), _digest(item, known)) for key, item in value.items()]
        return [b"mapping", *(part for pair in pairs for part in pair)]
    if isinstance(value, Set):
        return [b"set", *sorted(_digest(item, known) for item in value)]
    if isinstance(value, Sequence):
        return [b"sequence", *(_digest(item, known) for item in value)]
    return _object_parts(value, known)


def _array_parts(array: np.ndarray[Any, Any], known: Known) -> list[bytes]:
    if array.dtype.hasobject:
        return [b"objects", str(array.shape).encode(), _digest(array.ravel().tolist(), known)]
    head = f"{array.dtype.str} {array.shape}"
    return [b"array", head.encode(), np.ascontiguousarray(array).tobytes()]


def _object_parts(value: Any, known: Known) -> list[bytes]:
    if callable(value) and hasattr(value, "__qualname__"):
        if "<" in value.__qualname__:  # a lambda's name says nothing of what it does
            raise InvalidArrayError(f"{value.__qualname__} has no name to key a result by")
        return [b"function", f"{value.__module__}.{value.__qualname__}".encode()]
    kind = f"{type(value).__module__}.{type(value).__qualname__}".encode()
    if hasattr(value, "content"):
        return [b"object", kind, _digest(value.content(), known)]
    if is_dataclass(value):
        own = [getattr(value, field.name) for field in fields(value)]
        return [b"object", kind, *(_digest(item, known) for item in own)]
    raise InvalidArrayError(
        f"a task holds a {type(value).__qualname__}, which does not say what it consists of"
    )


def _sum(*parts: bytes) -> Digest:
    found = hashlib.blake2b(digest_size=SIZE)
    for part in parts:
        found.update(len(part).to_bytes(8, "little"))  # so that parts cannot run into each other
        found.update(part)
    return found.digest()
